# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of laboratories that cannot be read: said at once, and with what to do."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing import read_signals

ROWS = [(k / 1000, 0.5 * k, 5.0 * (k % 10 == 5)) for k in range(40)]


def table(path: Path, head: str, form: str = '{:.3f}') -> Path:
    lines = [','.join(form.format(cell).replace('.', ',') for cell in row) for row in ROWS]
    path.write_text('\n'.join([*head.splitlines(), *lines]))
    return path


@pytest.mark.parametrize('form', ['{:.3f}', '{:+.3f}', '{:.3e}'])
def test_a_comma_for_both_separator_and_decimal_mark_is_told(tmp_path: Path, form: str) -> None:
    path = table(tmp_path / 'trial.csv', 'Time [s],Force [N],Trigger [V]', form)
    with pytest.raises(
        RecordingError,
        match=r'expected a cell for each title of .*trial\.csv, got 3 titles, 6 cells a row: '
        r'comma as decimal mark and as separator\? Export it with semicolons or tabs',
    ):
        read_signals(path)


def test_whole_numbers_below_a_note_are_a_table(tmp_path: Path) -> None:
    path = tmp_path / 'trial.csv'
    lines = [f'{k},{k % 7 - 3},{5 * (k % 10 == 5)},{-k}' for k in range(40)]
    path.write_text('\n'.join(['left leg, room 3', *lines]))
    assert len(read_signals(path).signals) == 4
    path.write_text('\n'.join(['Mon,3,2024', *(f'{line},1.5,0' for line in lines)]))
    assert len(read_signals(path).signals) == 6


@pytest.mark.parametrize(
    ('begun', 'match'),
    [
        (False, r'expected a MATLAB file at .*, got .*corrupt'),
        (True, r'expected a MATLAB file at .*zeros\.mat, got '),
    ],
    ids=['zeros', 'zeros behind a header'],
)
def test_zeros_are_no_matlab_file(tmp_path: Path, begun: bool, match: str) -> None:
    """To step on through so many, which take no room, would last longer than a test may."""
    path = tmp_path / 'zeros.mat'
    if begun:
        savemat(path, {})
    with path.open('ab') as file:
        file.truncate(1 << 34)
    with pytest.raises(RecordingError, match=match):
        read_signals(path)


@pytest.mark.parametrize('form', ['4', '5'])
def test_matlab_files_of_both_versions_are_read(tmp_path: Path, form: str) -> None:
    path = tmp_path / 'session.mat'
    savemat(path, {'force': np.arange(10.0), 'gate': np.arange(10.0)}, format=form)
    assert [one.name for one in read_signals(path).signals] == ['force', 'gate']
