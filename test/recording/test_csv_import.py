# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables with a sampled gate become pulses and forces."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing import ImportOptions, import_file
from rpms_ros.recording.importing.gates import gate_pulses

HEADER = 'Time [s],STIM [ ],"fGM [N]"\n'
COLUMNS = ImportOptions(
    time='Time [s]', force='fGM [N]', pulse='STIM [ ]', time_unit='s', force_unit='N'
)
MILLISECOND = 1_000_000


def table(tmp_path, rows, header=HEADER):
    path = tmp_path / 'trial.csv'
    path.write_text(header + ''.join(f'{row}\n' for row in rows))
    return path


@given(
    st.lists(st.tuples(st.integers(1, 9), st.integers(1, 9)), min_size=1, max_size=20),
    st.integers(0, 2**32 - 1),
    st.floats(-5.0, 5.0),
    st.floats(0.01, 10.0),
)
def test_pulses_are_found_whatever_the_level_and_noise(spans, seed, rest, height):
    levels = np.concatenate([[0.0] * low + [1.0] * high for low, high in spans] + [[0.0]])
    stamp_ns = np.arange(len(levels), dtype=np.int64) * MILLISECOND
    # A fifth of the height, either way: the two thresholds lie 45 % from either level.
    noise = np.random.default_rng(seed).uniform(-0.2, 0.2, len(levels))
    pulses = gate_pulses(stamp_ns, rest + height * (levels + noise), ImportOptions(intensity=0.4))
    low, high = np.array(spans).T
    onset = np.cumsum(low + high) - high
    assert pulses.onset_ns.tolist() == (onset * MILLISECOND).tolist()
    assert pulses.width.tolist() == (high / 1000).tolist()
    assert set(pulses.intensity) == {0.4}


def test_chatter_at_the_threshold_is_one_pulse():
    gate = np.array([0.0, 0.45, 0.53, 0.6, 0.48, 0.52, 0.49, 1.0, 0.51, 0.2, 0.0])
    stamp_ns = np.arange(len(gate), dtype=np.int64) * MILLISECOND
    pulses = gate_pulses(stamp_ns, gate, ImportOptions())
    assert pulses.onset_ns.tolist() == [3 * MILLISECOND]
    assert pulses.width.tolist() == [0.006]


@pytest.mark.parametrize(
    ('rows', 'message'),
    [
        ([], 'expected rows of numbers below the header of .*trial.csv, got none'),
        (['0,0,1', '0,8,1'], 'expected rising times in column .Time .s.. of .*, got 0.0 and then'),
        (['0,0,1', 'nan,8,1'], 'expected finite numbers in column .Time .s.. .* got nan in row 2'),
        (['0,0,1', '1,inf,1'], 'expected finite numbers in column .STIM . .. .* got inf in row 2'),
        (['0,0,1', '1,0,1'], 'expected a gate that rises through 0, got levels 0 to 0'),
        (
            ['0,0,1', '1,0,high'],
            "expected numbers in .*trial.csv, got 'high' in row 2",
        ),
        (['0,0,1', '1,0'], 'expected 3 cells in each row of .*trial.csv, got 2'),
    ],
)
def test_bad_tables_are_refused(tmp_path, rows, message):
    with pytest.raises(RecordingError, match=message):
        import_file(table(tmp_path, rows), COLUMNS)
