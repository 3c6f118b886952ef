# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of laboratories that are damaged, or unpack into much: refused in one line."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing import read_signals

h5py = pytest.importorskip('h5py')
openpyxl = pytest.importorskip('openpyxl')


def repacked(path: Path, change: dict[str, bytes]) -> None:
    """Write other content into parts of a workbook."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        for name, content in {**parts, **change}.items():
            archive.writestr(name, content)


@pytest.mark.parametrize('part', ['xl/worksheets/sheet1.xml', 'xl/workbook.xml', 'xl/styles.xml'])
@pytest.mark.parametrize('content', [b'', b'<a', b'<a/>', b'\xff\xfe'])
def test_a_workbook_with_a_damaged_part_is_refused(
    tmp_path: Path, part: str, content: bytes
) -> None:
    path = tmp_path / 'session.xlsx'
    openpyxl.Workbook().save(path)
    repacked(path, {part: content})
    with pytest.raises(RecordingError, match=r'session\.xlsx'):
        read_signals(path)


def test_a_workbook_with_a_flipped_bit_is_refused(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    for row in np.arange(600.0).reshape(-1, 3).tolist():
        book.active.append(row)
    path = tmp_path / 'session.xlsx'
    book.save(path)
    clean = path.read_bytes()
    place = clean.index(b'xl/worksheets/sheet1.xml') + 300
    path.write_bytes(clean[:place] + bytes([clean[place] ^ 16]) + clean[place + 1 :])
    with pytest.raises(RecordingError, match=r'expected an Excel workbook at .*session\.xlsx'):
        read_signals(path)


def test_small_files_that_unpack_into_much_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a limit that a test can reach."""
    monkeypatch.setattr('rpms_ros.recording.importing.formats.LEAST', 1_000_000)
    monkeypatch.setattr('rpms_ros.recording.importing.formats._LARGEST_WORKBOOK', 1_000_000)
    zeros = np.zeros(500_000)
    savemat(tmp_path / 'a.mat', {'force': zeros}, do_compression=True)
    with h5py.File(tmp_path / 'b.mat', 'w', userblock_size=512) as file:
        file.create_dataset('force', data=zeros, compression='gzip')
    for name in ('a.mat', 'b.mat'):
        with pytest.raises(
            RecordingError, match=r'expected a file that unpacks into 0.001.* GB at most'
        ):
            read_signals(tmp_path / name)
    path = tmp_path / 'c.xlsx'
    openpyxl.Workbook().save(path)
    repacked(path, {'xl/worksheets/sheet1.xml': bytes(2_000_000)})
    with pytest.raises(RecordingError, match=r'expected a workbook of at most 1000000 bytes'):
        read_signals(path)


@pytest.mark.parametrize('streams', ['', 'empty'])
def test_an_xdf_file_without_samples_is_refused(tmp_path: Path, streams: str) -> None:
    pytest.importorskip('pyxdf')
    header = (
        '<?xml version="1.0"?><info><name>force</name><type>F</type><channel_count>1'
        '</channel_count><nominal_srate>1000</nominal_srate><channel_format>double64'
        '</channel_format></info>'
    )
    body = (2).to_bytes(2, 'little') + (1).to_bytes(4, 'little') + header.encode()
    stream = b'\x04' + len(body).to_bytes(4, 'little') + body
    path = tmp_path / 'session.xdf'
    path.write_bytes(b'XDF:' + (stream if streams else b''))
    with pytest.raises(RecordingError, match=r'expected a sampled stream in .*session\.xdf'):
        read_signals(path)
