# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Gates as laboratories have them: low while a pulse lasts, without levels, bouncing."""

from pathlib import Path

import numpy as np
import pytest

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import FloatArray
from rpms_ros.recording.importing import Ambiguous
from rpms_ros.recording.importing import GateSettings
from rpms_ros.recording.importing import Imported
from rpms_ros.recording.importing import ImportOptions
from rpms_ros.recording.importing import import_file
from rpms_ros.recording.importing.gates import gate_pulses

COUNT = 4000
TIME = np.arange(COUNT) / 1000.0
PLACES = np.arange(500, 3500, 50)
NOISE = np.random.default_rng(1).normal(0.0, 0.02, COUNT)


def gate(width: int = 3, level: float = 5.0) -> FloatArray:
    high = np.zeros(COUNT)
    for place in PLACES:
        high[place : place + width] = level
    return high


def imported(path: Path, values: FloatArray, **options: object) -> Imported:
    columns = np.column_stack((TIME, np.sin(30.0 * TIME), values))
    np.savetxt(path, columns, delimiter=',', header='Time [s],Force [N],Trigger', comments='')
    return import_file(path, ImportOptions(**options))  # type: ignore[arg-type]


def places(found: Imported) -> list[int]:
    return (found.pulses.onset_ns // 1_000_000).tolist()


def test_a_gate_that_rests_high_falls_with_a_pulse(tmp_path: Path) -> None:
    found = imported(tmp_path / 'a.csv', 5.0 - gate() + NOISE)
    assert places(found) == PLACES.tolist()
    np.testing.assert_allclose(found.pulses.width, 3e-3)
    told = "'Trigger', falling edges, as it is high 96 % of the time (--edge decides)"
    assert dict(found.facts)['pulses'] == told
    assert found.guessed
    found = imported(tmp_path / 'a.csv', 5.0 - gate() + NOISE, edge='rising')
    assert places(found) == (PLACES + 3).tolist()
    assert dict(found.facts)['pulses'] == "'Trigger', rising edges (--edge)"


def test_a_gate_that_is_mostly_low_rises_unless_it_is_stated(tmp_path: Path) -> None:
    found = imported(tmp_path / 'a.csv', gate(40) + NOISE)
    assert places(found) == PLACES.tolist()
    assert dict(found.facts)['pulses'] == "'Trigger'"
    found = imported(tmp_path / 'a.csv', gate(40) + NOISE, edge='falling')
    assert places(found) == (PLACES + 40).tolist()


def test_edges_of_a_gate() -> None:
    stamp_ns = np.arange(100, dtype=np.int64)
    low = np.full(100, 5.0)
    low[[20, 60]] = 0.0
    assert gate_pulses(stamp_ns, low, GateSettings()).onset_ns.tolist() == [20, 60]
    rising = GateSettings(edge='rising')
    assert gate_pulses(stamp_ns, low, rising).onset_ns.tolist() == [21, 61]
    with pytest.raises(RecordingError, match=r'a gate that falls through 9, got levels 0 to 5'):
        gate_pulses(stamp_ns, low, GateSettings(9.0, edge='falling'))
    with pytest.raises(RecordingError, match=r"expected an edge rising or falling, got 'up'"):
        GateSettings(edge='up')


def test_noise_is_no_gate(tmp_path: Path) -> None:
    with pytest.raises(
        Ambiguous,
        match=r"expected a gate with two levels in .*, got 'Trigger', \d+ % of it half-way "
        r'between -0\.0\d+ and 0\.0\d+: --threshold LEVEL or --pulse COL decides',
    ):
        imported(tmp_path / 'a.csv', NOISE)
    with pytest.raises(Ambiguous, match='two levels'):
        imported(tmp_path / 'a.csv', NOISE, pulse='Trigger')
    assert len(imported(tmp_path / 'a.csv', NOISE, threshold=0.04).pulses)


def test_hum_does_not_hide_a_gate(tmp_path: Path) -> None:
    hum = 1.5 * np.sin(100.0 * np.pi * TIME)
    assert places(imported(tmp_path / 'a.csv', gate(1) + hum)) == PLACES.tolist()


def test_pulses_to_both_sides_need_a_threshold(tmp_path: Path) -> None:
    both = gate(1) - np.roll(gate(1), 1) + NOISE
    with pytest.raises(Ambiguous, match='two levels'):
        imported(tmp_path / 'a.csv', both)
    assert places(imported(tmp_path / 'a.csv', both, threshold=2.5)) == PLACES.tolist()


def test_a_trigger_that_bounces_is_told(tmp_path: Path) -> None:
    bouncing = np.maximum(gate(1), np.roll(gate(1), 2))
    found = imported(tmp_path / 'a.csv', bouncing, time='Time [s]', force='Force [N]')
    assert len(found.pulses) == 120
    warning = '60 of 120 pulses begin less than 4 ms after the one before: '
    assert dict(found.remarks)['warning'].startswith(warning)
    assert set(found.remarks) <= set(found.facts)
    assert found.guessed
    assert not imported(tmp_path / 'a.csv', gate()).remarks
