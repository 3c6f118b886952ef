# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of laboratories with something odd or damaged: read, or refused at once in one line."""

import zipfile

import numpy as np
import pytest
from scipy.io import savemat

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing import ImportOptions, import_file
from rpms_ros.recording.importing.whole_file import read_signals

openpyxl = pytest.importorskip('openpyxl')

ROWS = [(k / 1000, 0.5 * k, 5.0 * (k % 10 == 5)) for k in range(40)]


def table(path, head, form='{:.3f}'):
    lines = [','.join(form.format(cell).replace('.', ',') for cell in row) for row in ROWS]
    path.write_text('\n'.join([*head.splitlines(), *lines]))
    return path


@pytest.mark.parametrize('form', ['{:.3f}', '{:+.3f}', '{:.3e}'])
def test_a_comma_for_both_separator_and_decimal_mark_is_told(tmp_path, form):
    path = table(tmp_path / 'trial.csv', 'Time [s],Force [N],Trigger [V]', form)
    with pytest.raises(
        RecordingError,
        match=r'expected a cell for each title of .*trial\.csv, got 3 titles, 6 cells a row: '
        r'comma as decimal mark and as separator\? Export it with semicolons or tabs',
    ):
        read_signals(path)


@pytest.mark.parametrize(
    ('begun', 'match'),
    [
        (False, r'expected a MATLAB file at .*, got .*corrupt'),
        (True, r'expected a MATLAB file at .*zeros\.mat, got '),
    ],
    ids=['zeros', 'zeros behind a header'],
)
def test_zeros_are_no_matlab_file(tmp_path, begun, match):
    """To step on through so many, which take no room, would last longer than a test may."""
    path = tmp_path / 'zeros.mat'
    if begun:
        savemat(path, {})
    with path.open('ab') as file:
        file.truncate(1 << 34)
    with pytest.raises(RecordingError, match=match):
        read_signals(path)


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
def test_marks_between_thousands_are_named(tmp_path, separator, row, cell):
    path = tmp_path / 'trial.csv'
    path.write_text(f'time [ms]{separator}force [N]\n{row}\n{row}\n', encoding='utf-8')
    with pytest.raises(RecordingError) as refused:
        read_signals(path)
    assert str(refused.value) == (
        f'expected numbers without marks between thousands in {path}, got {cell!r}; '
        'export it without them'
    )


def test_a_point_among_decimal_commas_is_refused(tmp_path):
    path = tmp_path / 'trial.csv'
    path.write_text('time;force\n0,5;1,5\n0,6;1.5\n', encoding='utf-8')
    with pytest.raises(RecordingError, match=r"got '1\.5' in row 2, where others have a decimal"):
        read_signals(path)


def workbook(path, *rows):
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    book.save(path)
    return path


def test_a_row_of_units_below_the_titles_counts(tmp_path):
    """A force in mN would else be a thousand times as large."""
    rows = [[at, 1000.0 + at % 7, 5.0 if at % 50 == 10 else 0.0] for at in range(1000)]
    path = workbook(tmp_path / 'leg.xlsx', ['Time', 'Force', 'Trigger'], ['ms', 'mN', 'V'], *rows)
    found = import_file(path, ImportOptions())
    assert found.forces.force[0] == pytest.approx(1.0)
    assert ('force', "'Force' in mN, as the file says") in found.facts
    assert ('time', "'Time' in ms, as the file says") in found.facts
    assert ('pulses', "'Trigger'") in found.facts


def test_a_workbook_of_the_old_format_is_told_what_to_become(tmp_path):
    path = tmp_path / 'leg.xls'
    path.write_bytes(bytes.fromhex('d0cf11e0a1b11ae1') + bytes(504))
    with pytest.raises(RecordingError, match=r'old format \.xls; save it as \.xlsx'):
        import_file(path, ImportOptions())


def repacked(path, change):
    """Write other content into parts of a workbook."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        for name, content in {**parts, **change}.items():
            archive.writestr(name, content)


@pytest.mark.parametrize('part', ['xl/worksheets/sheet1.xml', 'xl/workbook.xml', 'xl/styles.xml'])
@pytest.mark.parametrize('content', [b'', b'<a', b'<a/>', b'\xff\xfe'])
def test_a_workbook_with_a_damaged_part_is_refused(tmp_path, part, content):
    path = workbook(tmp_path / 'session.xlsx')
    repacked(path, {part: content})
    with pytest.raises(RecordingError, match=r'session\.xlsx'):
        read_signals(path)


def test_small_files_that_unpack_into_much_are_refused(tmp_path, monkeypatch):
    """With a limit that a test can reach."""
    zeros = np.zeros(500_000)
    savemat(tmp_path / 'a.mat', {'force': zeros}, do_compression=True)
    repacked(workbook(tmp_path / 'd.xlsx'), {'xl/worksheets/sheet1.xml': bytes(2_000_000)})
    monkeypatch.setattr('rpms_ros.recording.importing.whole_file._LARGEST', 1_000_000)
    for name in ('a.mat', 'd.xlsx'):
        with pytest.raises(
            RecordingError, match=r'expected a file that unpacks into 0.001.* GB at most'
        ):
            import_file(tmp_path / name, ImportOptions())
