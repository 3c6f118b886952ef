# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables whose numbers have marks between thousands."""

from pathlib import Path

import pytest

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing.text import read_text


@pytest.mark.parametrize(
    ('separator', 'row', 'cell'),
    [
        (';', '1.058,403;0,500', '1.058,403'),
        ('\t', '1,058.403\t0.500', '1,058.403'),
        (',', '"1,058.403",0.500', '1,058.403'),
        (';', "1'058.403;0.500", "1'058.403"),
        (';', '1\N{NARROW NO-BREAK SPACE}058,403;0,500', '1\N{NARROW NO-BREAK SPACE}058,403'),
        (';', '-1.058.403;0,500', '-1.058.403'),
        # would be read as a little more than one
        (';', '1.058;0,500', '1.058'),
    ],
)
def test_marks_between_thousands_are_named(
    tmp_path: Path, separator: str, row: str, cell: str
) -> None:
    path = tmp_path / 'trial.csv'
    path.write_text(f'time [ms]{separator}force [N]\n{row}\n{row}\n', encoding='utf-8')
    with pytest.raises(RecordingError) as refused:
        read_text(path)
    assert str(refused.value) == (
        f'expected numbers without marks between thousands in {path}, got {cell!r}; '
        'export it without them'
    )


def test_a_point_among_decimal_commas_is_refused(tmp_path: Path) -> None:
    path = tmp_path / 'trial.csv'
    path.write_text('time;force\n0,5;1,5\n0,6;1.5\n', encoding='utf-8')
    with pytest.raises(RecordingError, match=r"got '1\.5' in row 2, where others have a decimal"):
        read_text(path)


def test_times_of_day_with_a_point_stay_times(tmp_path: Path) -> None:
    path = tmp_path / 'trial.csv'
    path.write_text('time;force\n10:00:00.5;1,5\n10:00:00.6;1,6\n', encoding='utf-8')
    assert read_text(path).signals[0].values[0] == 36000.5


def test_other_texts_are_not_taken_for_marks_between_thousands(tmp_path: Path) -> None:
    path = tmp_path / 'results.csv'
    path.write_text('recording,duration\nmonday,19.999\ntuesday,20.125\n', encoding='utf-8')
    with pytest.raises(RecordingError, match='expected rows of numbers below the header'):
        read_text(path)
    path.write_text('at;force\n0,5;0.005\n', encoding='utf-8')
    with pytest.raises(RecordingError, match=r"got '0\.005' in row 1, where others have"):
        read_text(path)
