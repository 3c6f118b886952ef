# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What stands above and among the numbers of sheets and exports."""

import datetime as dt
from pathlib import Path
from typing import Any

import openpyxl
import pytest

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing import ImportOptions, import_file


def workbook(path: Path, *rows: list[Any]) -> Path:
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    book.save(path)
    return path


def test_a_row_of_units_below_the_titles_counts(tmp_path: Path) -> None:
    """A force in mN would else be a thousand times as large."""
    rows = [[at, 1000.0 + at % 7, 5.0 if at % 50 == 10 else 0.0] for at in range(1000)]
    path = workbook(tmp_path / 'leg.xlsx', ['Time', 'Force', 'Trigger'], ['ms', 'mN', 'V'], *rows)
    found = import_file(path, ImportOptions())
    assert found.forces.force[0] == pytest.approx(1.0)
    assert ('force', "'Force' in mN, as the file says") in found.facts
    assert ('time', "'Time' in ms, as the file says") in found.facts
    assert ('pulses', "'Trigger'") in found.facts


def test_a_cell_that_is_no_number_is_named_with_its_row(tmp_path: Path) -> None:
    head = ['Time [s]', 'Force [N]', 'Trigger']
    path = workbook(tmp_path / 'leg.xlsx', head, [0.0, 1.0, 0], [0.1, '#DIV/0!', 0])
    with pytest.raises(RecordingError, match=r"leg\.xlsx, got '#DIV/0!' in row 3 of those"):
        import_file(path, ImportOptions())


@pytest.mark.parametrize('cell', ['0,5', dt.time(10, 0, 1)])
def test_rows_without_numbers_are_shown(tmp_path: Path, cell: object) -> None:
    path = workbook(tmp_path / 'leg.xlsx', ['Time', 'Force', 'Trigger'], [cell, 1.5, 0])
    with pytest.raises(RecordingError) as refused:
        import_file(path, ImportOptions())
    assert str(refused.value) == (
        f'expected rows of numbers in {path}, got none; the last row is: {cell}, 1.5, 0'
    )


def test_a_row_without_a_time_is_named(tmp_path: Path) -> None:
    head = 'Interval=\t0.001 s\nTimeFormat=\tStartOfBlock\nChannelTitle=\tForce\tStim\n'
    rows = [f'{at / 1000 if at != 5 else "NaN"}\t1.0\t{5 * (at % 50 == 10)}' for at in range(200)]
    path = tmp_path / 'labchart.txt'
    path.write_text(head + '\n'.join(rows), encoding='utf-8')
    with pytest.raises(RecordingError, match=r"column 'Force' of .*, got none in row 6"):
        import_file(path, ImportOptions())


def test_a_workbook_of_the_old_format_is_told_what_to_become(tmp_path: Path) -> None:
    path = tmp_path / 'leg.xls'
    path.write_bytes(bytes.fromhex('d0cf11e0a1b11ae1') + bytes(504))
    with pytest.raises(RecordingError, match=r'old format \.xls; save it as \.xlsx'):
        import_file(path, ImportOptions())
