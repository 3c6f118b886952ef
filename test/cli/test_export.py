# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""rpms export: other readers find the same numbers in it."""

import csv
import json
from array import array
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from rpms_ros import estimate_messages, messages
from rpms_ros.identification import CONVERGED, Estimate
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import FurtherTopic, read_recording, write_recording
from rpms_ros.recording.rosbag.definitions import known_types

Rpms = Callable[..., tuple[int, str, str]]
HOSTILE = '=HYPERLINK("http://x","a")\t\nb'
NOTE = '=Ada Lovelace'
START = 1_700_000_000_123_456_789


def estimate(stamp_ns: int, name: str = 'u_thr') -> Estimate:
    return Estimate(
        stamp_ns=stamp_ns,
        estimator=HOSTILE,
        nonlinear_names=(name, 'u_sat'),
        nonlinear=np.array([0.5, 0.9]),
        nonlinear_covariance=np.diag([0.01, 0.04]),
        nonlinear_identifiability=np.array([CONVERGED, 0]),
        linear_names=(),
        linear=np.empty(0),
        repetition_rate=20.0,
        curve_intensity=np.linspace(0.0, 1.0, 5),
        curve_force=np.linspace(0.0, 8.0, 5),
        curve_lower=np.linspace(0.0, 7.0, 5),
        curve_upper=np.linspace(0.0, 9.0, 5),
        response_time=np.array([0.0, 0.1]),
        response_force=np.array([0.0, 1.0]),
        physiology_names=('latency_s',),
        physiology=np.array([0.009]),
        physiology_lower=np.array([0.008]),
        physiology_upper=np.array([0.010]),
        confidence=0.95,
        output_error=0.02,
        samples=100,
        pulses=3,
        faults={HOSTILE: 2},
    )


def estimates_topic(estimates: list[Estimate]) -> FurtherTopic:
    types = known_types()
    built = [estimate_messages.estimate_message(one, types.types) for one in estimates]
    for message in built:
        # rosbags takes arrays of NumPy only
        for name, value in vars(message).items():
            if isinstance(value, array):
                setattr(message, name, np.array(value))
    kind = messages.MUSCLE_ESTIMATE
    encoded = [bytes(types.serialize_cdr(message, kind)) for message in built]
    return FurtherTopic('/estimate', kind, [one.stamp_ns for one in estimates], encoded)


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """A short session of an awkward start, with odd numbers, a gap and estimates."""
    random = np.random.default_rng(1)
    stamps = START + np.cumsum(random.integers(900_000, 1_100_000, 200))
    force = random.normal(size=200)
    force[[3, 7]] = np.nan, 1e-300
    pulses = PulseTrain(
        stamps[[0, 50, 120]] - [250_000_000, 1, -1],
        np.array([0.07, 1 / 3, 1.0]),
        np.array([7, 8, 10]),
        np.array([1e-4, 2.5e-4, 1e-4]),
    )
    path = tmp_path / 'session'
    estimates = [estimate(int(stamps[99]), HOSTILE), estimate(int(stamps[199]))]
    further = [estimates_topic(estimates)]
    custom = {'patient': NOTE}
    write_recording(path, pulses, ForceTrace(stamps, force), custom=custom, further=further)
    return path


def exported(rpms: Rpms, session: Path, *options: object) -> Path:
    place = session.with_name('exported')
    code, out, err = rpms('export', session, '--out', place, *options)
    assert (code, err) == (0, '')
    assert out == f'{place}: 3 pulses, 200 samples, 2 estimates\n'
    return place


def table(place: Path, name: str) -> dict[str, Any]:
    """Return a table as another program reads it, its times in ns as the session has them."""
    origin = int(json.loads((place / 'session.json').read_text())['origin_ns'])
    with (place / f'{name}.csv').open(newline='') as file:
        head, *rows = csv.reader(file)
    times, *columns = zip(*rows, strict=True)
    stamps = [int(Decimal(time).scaleb(9)) + origin for time in times]
    found = dict(zip(head[1:], (np.array(one, float) for one in columns), strict=True))
    return {**found, 'stamp_ns': np.array(stamps)}


def test_every_number_is_there_with_all_of_its_digits(rpms: Rpms, session: Path) -> None:
    place, before = exported(rpms, session), read_recording(session)
    for name, expected in (
        ('force', {'stamp_ns': before.forces.stamp_ns, 'force_N': before.forces.force}),
        (
            'pulses',
            {
                'stamp_ns': before.pulses.onset_ns,
                'intensity': before.pulses.intensity,
                'width_s': before.pulses.width,
                'sequence': before.pulses.sequence,
            },
        ),
    ):
        found = table(place, name)
        assert found.keys() == expected.keys()
        for column, values in expected.items():
            np.testing.assert_array_equal(found[column], values)


def test_estimates_are_a_table_that_no_spreadsheet_runs(rpms: Rpms, session: Path) -> None:
    folder = exported(rpms, session)
    with (folder / 'estimates.csv').open(newline='') as file:
        rows = list(csv.reader(file))
    assert all(not cell.startswith(('=', '+', '@', '\t')) for row in rows for cell in row)
    assert all(name.isidentifier() and name.isascii() for name in rows[0])
    table = pd.read_csv(folder / 'estimates.csv')
    assert table['u_thr'].isna().tolist() == [True, False]
    assert table['u_sat_deviation'].tolist() == [0.2, 0.2]
    assert table['u_sat_determined'].tolist() == ['not informed'] * 2
    assert table['steady_force_50'].tolist() == [4.0, 4.0]
    assert table['steady_force_100_upper'].tolist() == [9.0, 9.0]
    assert table['latency_s_lower'].tolist() == [0.008, 0.008]
    assert json.loads(table['faults'][0]) == {HOSTILE: 2}


def test_anonymous_leaves_out_date_name_and_notes(rpms: Rpms, session: Path) -> None:
    named = session.rename(session.with_name('Ada'))
    place = exported(rpms, named, '--anonymous')
    content = b'\n'.join(one.read_bytes() for one in place.iterdir())
    for secret in (b'Ada', b'1700000000', b'2023-11'):
        assert secret not in content
    assert table(place, 'pulses')['stamp_ns'][0] == 0
    steps = np.diff(table(place, 'force')['stamp_ns'])
    np.testing.assert_array_equal(steps, np.diff(read_recording(named).forces.stamp_ns))


def test_nothing_is_replaced_and_nothing_is_half_written(
    rpms: Rpms, session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = session.with_name('there')
    place.write_text('mine')
    code, _, err = rpms('export', session, '--out', place)
    assert code == 2
    assert 'expected nothing at' in err
    assert place.read_text() == 'mine'
    place.unlink()
    before = sorted(session.parent.iterdir())

    def full(*_: object, **__: object) -> None:
        raise OSError('disk full')

    monkeypatch.setattr('rpms_ros.recording.export.csv.writer', full)
    code, _, err = rpms('export', session, '--out', place)
    assert code == 2
    assert err.endswith('got disk full\n')
    assert sorted(session.parent.iterdir()) == before


def test_a_torque_is_named_as_one(rpms: Rpms, session: Path, tmp_path: Path) -> None:
    recording = read_recording(session)
    further = [estimates_topic([replace(estimate(int(START)), unit='N m')])]
    path = tmp_path / 'torque'
    write_recording(path, recording.pulses, recording.forces, further=further, quantity='torque')
    place = tmp_path / 'exported'
    assert rpms('export', path, '--out', place, '--quantity', 'torque')[0] == 0
    np.testing.assert_array_equal(table(place, 'force')['torque_Nm'], recording.forces.force)
    # the force of a recording whose estimates are of a torque
    code, _, err = rpms('export', path, '--out', tmp_path / 'force')
    assert code == 1
    assert 'expected estimates in N, got N m (--quantity?)' in err
