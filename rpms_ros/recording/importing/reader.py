# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Any file of a laboratory as signals: the format is told by the content, then by the ending."""

from pathlib import Path

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing.excel import read_excel
from rpms_ros.recording.importing.labchart import is_labchart
from rpms_ros.recording.importing.labchart import read_labchart
from rpms_ros.recording.importing.matlab import read_matlab
from rpms_ros.recording.importing.signals import SignalFile
from rpms_ros.recording.importing.spike2 import is_spike2
from rpms_ros.recording.importing.spike2 import read_spike2
from rpms_ros.recording.importing.text import decoded
from rpms_ros.recording.importing.text import read_table
from rpms_ros.recording.importing.xdf import read_xdf

_ZIP, _XDF, _HDF5, _MATLAB = b'PK\x03\x04', b'XDF:', b'\x89HDF', b'MATLAB'


def read_signals(path: Path, block: int | None = None, sheet: str | None = None) -> SignalFile:
    """Return what a file holds.

    Parameters
    ----------
    path : Path
        Table of text, LabChart or Spike2 text, MATLAB, Excel or XDF file.
    block : int, optional
        Block of a LabChart file, from 1.
    sheet : str, optional
        Sheet of a workbook.

    Raises
    ------
    RecordingError
        If it cannot be read; the message says what was expected and which option decides.
    """
    # A pipe would be waited for without end.
    if not path.exists():
        raise RecordingError(f'expected a file at {path}, got no such file')
    if not path.is_file():
        raise RecordingError(f'expected a file at {path}, got no regular file')
    try:
        with path.open('rb') as file:
            head = file.read(1024)
    except OSError as error:
        raise RecordingError(f'expected a file at {path}, got {error}') from error
    if head.startswith(_ZIP):
        _unused(path, 'a LabChart file with --block', block)
        return read_excel(path, sheet)
    _unused(path, 'a workbook with --sheet', sheet)
    known = read_xdf if head.startswith(_XDF) else None
    if head.startswith((_HDF5, _MATLAB)) or path.suffix.lower() == '.mat':
        known = read_matlab
    if known is not None:
        _unused(path, 'a LabChart file with --block', block)
        return known(path)
    text, _ = decoded(path)
    if is_labchart(text):
        return read_labchart(path, block)
    _unused(path, 'a LabChart file with --block', block)
    if is_spike2(text):
        return read_spike2(path)
    return read_table(path)


def _unused(path: Path, expected: str, given: object) -> None:
    """Refuse an option that has no meaning for a file."""
    if given is not None:
        raise RecordingError(f'expected {expected}, got {path}')
