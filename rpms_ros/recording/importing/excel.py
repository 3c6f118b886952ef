# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Excel workbooks: one sheet as a table, its numbers below a header."""

from importlib import import_module
from pathlib import Path
from zipfile import ZipFile

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing.signals import Signal, SignalFile, needed, unit_of
from rpms_ros.recording.importing.text import header

# A sheet has a million rows at most: of a few columns about a hundred megabytes of XML [bytes].
_LARGEST = 300_000_000


def read_excel(path: Path, sheet: str | None = None) -> SignalFile:
    """Return the columns of a sheet.

    Parameters
    ----------
    path : Path
        The workbook.
    sheet : str, optional
        Name of the sheet; needed if there are several with numbers.

    Raises
    ------
    RecordingError
        If openpyxl is not installed, the file is damaged or no sheet can be chosen.
    """
    openpyxl = needed(import_module, 'openpyxl', f'an Excel workbook ({path})')
    try:
        _refuse_bomb(path)
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        names = book.sheetnames
        chosen = _chosen(path, names, sheet)
        rows = [row for row in book[chosen].iter_rows(values_only=True) if any(_told(row))]
        book.close()
    except RecordingError:
        raise
    # openpyxl raises whatever the damage leads to: of the archive, of XML, of a part that lacks
    except Exception as error:
        raise RecordingError(f'expected an Excel workbook at {path}, got {error}') from error
    first = next((index for index, row in enumerate(rows) if _numbers(row)), None)
    if first is None:
        got = ', '.join(str(cell)[:40] for cell in rows[-1] if cell is not None) if rows else ''
        raise RecordingError(
            f'expected rows of numbers in {path}, got none; the last row is: {got or "empty"}'
        )
    width = max(len(row) for row in rows[first:])
    titles, units = header([_titles(row, width) for row in rows[:first]], width)
    table = np.array(
        [
            [_value(path, cell, first + index + 1) for cell in row]
            for index, row in enumerate(rows[first:])
        ]
    )
    return SignalFile(
        path,
        'Excel workbook',
        tuple(
            Signal(name, np.ascontiguousarray(column), unit or unit_of(name))
            for name, unit, column in zip(titles, units, table.T, strict=True)
        ),
        facts=(f'sheet {chosen}',),
    )


def _refuse_bomb(path: Path) -> None:
    """Raise `RecordingError` if the workbook unpacks into more than a laboratory records."""
    with ZipFile(path) as archive:
        size = sum(part.file_size for part in archive.infolist())
    if size > _LARGEST:
        raise RecordingError(
            f'expected a workbook of at most {_LARGEST} bytes unpacked at {path}, got {size}'
        )


def _chosen(path: Path, names: list[str], sheet: str | None) -> str:
    """Return the name of the sheet that is read."""
    if sheet is None and len(names) != 1:
        raise RecordingError(
            f'expected one sheet in {path}, got {", ".join(names)}: --sheet NAME decides'
        )
    if sheet is not None and sheet not in names:
        raise RecordingError(f'expected a sheet of {", ".join(names)} in {path}, got {sheet!r}')
    return sheet or names[0]


def _told(row: tuple[object, ...]) -> list[bool]:
    return [cell is not None for cell in row]


def _numbers(row: tuple[object, ...]) -> bool:
    told = [cell for cell in row if cell is not None]
    return bool(told) and all(isinstance(cell, int | float) for cell in told)


def _titles(row: tuple[object, ...], width: int) -> list[str]:
    cells = ['' if cell is None else str(cell).strip() for cell in row]
    return [*cells, *[''] * width][:width]


def _value(path: Path, cell: object, row: int) -> float:
    if cell is None:
        return float('nan')
    if not isinstance(cell, int | float):
        raise RecordingError(
            f'expected numbers in {path}, got {str(cell)[:40]!r} in row {row} of those that are '
            'not empty'
        )
    return float(cell)
