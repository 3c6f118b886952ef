# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables of text, and exports of LabChart, whatever separators and encoding."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.printable import counted
from rpms_ros.pulses import FloatArray
from rpms_ros.recording.importing.signals import TIME_OF_DAY, Signal, SignalFile, unit_of

_MARKS = {b'\xef\xbb\xbf': 'utf-8-sig', b'\xff\xfe': 'utf-16', b'\xfe\xff': 'utf-16'}
_SEPARATORS = {'\t': 'tab', ';': 'semicolon', '|': 'bar', ',': 'comma', ' ': 'spaces'}
_CLOCK = re.compile(r'^(?:(\S+)[T ])?(\d{1,2}):(\d{2}):(\d{2}(?:[.,]\d+)?)\s*Z?$')
_UNITS = re.compile(
    r'^[\[(]?\s*(?:s|sec|seconds?|ms|us|µs|μs|min|[Nn]ewtons?|m?k?N|m?V|[Vv]olts?|g|kg|gf|kgf|lbf|'
    r'm?k?N[ ·*.-]?m|kg ?m|ft[ -]lb[fs]?|'
    r'm|mm|%|1|-|a\.?u\.?|)\s*[\])]?$'
)
_THOUSANDS = re.compile(
    r'^[-+]?[1-9]\d{0,2}(?:(?:\.\d{3})+(?:,\d*)?|(?:,\d{3})+(?:\.\d*)?|'
    r"(?:['’\s]\d{3})+(?:[.,]\d*)?)$"
)
_WHOLE, _SOME = re.compile(r'-?\d+'), 20
# Lines above the titles: the rate, with its unit before or behind it, and the unit of all.
_RATE = re.compile(r'(?i)^(?=.*\bk?hz\b)\W*(sampl|acquisition|scan)[^\d]*(\d+(?:\.\d+)?)\D*$')
_VOLTS = re.compile(r'(?i)\bdata in volts?\b|\bunits?\W+v(?:olts?)?\W*$')
_INTERVAL = re.compile(r'(\d*\.?\d+(?:[eE]-?\d+)?) s')
_OLD_OFFICE = b'\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1'
_LOOKED_AT = 200
_LABCHART = ('Interval=', 'ChannelTitle=', 'ExcelDateTime=', 'TimeFormat=', 'DateFormat=')
_MISSING = {'', 'nan', 'na', 'n/a', '-', 'null', '#n/a', '#nv'}


def _decoded(path: Path) -> tuple[str, str]:
    """Return the text of a file and the name of its encoding.

    Raises
    ------
    RecordingError
        If the file holds no text.
    """
    raw = path.read_bytes()
    if raw.startswith(_OLD_OFFICE):
        fault = f'expected a table of text or a workbook .xlsx in {path}'
        raise RecordingError(f'{fault}, got one of the old format .xls; save it as .xlsx')
    text, name = _text(raw)
    head = text[:4096]
    strange = any(letter < ' ' and letter not in '\t\n\f\r' for letter in head)
    if strange or '\ufffd' in head:
        raise RecordingError(f'expected a table of text in {path}, got bytes that are no text')
    return text, name


def _text(raw: bytes) -> tuple[str, str]:
    for mark, name in _MARKS.items():
        if raw.startswith(mark):
            return raw.decode(name, errors='replace'), name.removesuffix('-sig').upper()
    head = raw[:4096]
    # Without a mark, every other byte of UTF-16 numbers is nothing.
    for place, name in ((1, 'utf-16-le'), (0, 'utf-16-be')):
        if len(head) > 3 and head[place::2].count(0) > 0.8 * len(head[place::2]):
            return raw.decode(name, errors='replace'), 'UTF-16'
    try:
        return raw.decode('utf-8'), 'UTF-8'
    except UnicodeDecodeError:
        return raw.decode('latin-1'), 'Latin-1'


def read_text(path: Path, block: int | None = None) -> SignalFile:
    """Return the columns of a table of text, or the channels of an export of LabChart.

    Parameters
    ----------
    path : Path
        The file.
    block : int, optional
        Block of a LabChart file, from 1; needed if there are several.

    Raises
    ------
    RecordingError
        If the file is no such table; the message says what was found and what was expected.
    """
    text, encoding = _decoded(path)
    if sum(line.startswith(_LABCHART) for line in text[:2000].splitlines()[:12]) >= 2:
        return _labchart(path, text, encoding, block)
    if block is not None:
        raise RecordingError(f'expected a LabChart file with --block, got {path}')
    return _table(path, text, encoding)


def _table(path: Path, text: str, encoding: str) -> SignalFile:
    every = text.strip('\r\n').splitlines()
    lines = [line for line in every if line.strip()]
    if not lines:
        raise RecordingError(f'expected a table in {path}, got an empty file')
    separator = _separator(lines)
    rows = list(map(_splitter(separator), lines))
    comma = separator != ',' and _decimal_comma(rows)
    first = first_row(path, rows, comma)
    if separator == ',' and first:
        _refuse_decimal_commas(path, rows[first - 1], rows[first : first + _LOOKED_AT])
    volts = any(_VOLTS.search(line) for line in lines[:first])
    signals = signals_of(path, rows, first, comma, 'V' if volts else '')
    facts = [encoding, f'separated by {_SEPARATORS[separator]}']
    facts += ['decimal comma'] if comma else []
    facts += [] if first else ['no header']
    # by a rate, what comes after one is too early
    empty = len(every) - len(lines)
    facts += [f'{counted(empty, "empty line")} left out'] if empty else []
    rate = None if any('time' in one.name.lower() for one in signals) else _rate(lines[:first])
    return SignalFile(path, 'table of text', signals, sampling_rate_hz=rate, facts=tuple(facts))


def signals_of(
    path: Path, rows: Sequence[list[str]], first: int, comma: bool = False, usual: str = ''
) -> tuple[Signal, ...]:
    """Return the columns of a table as signals.

    Parameters
    ----------
    path : Path
        The file, for messages.
    rows : sequence of list of str
        Cells of the table: lines above the numbers, then the numbers.
    first : int
        The first row of numbers.
    comma : bool
        Whether the decimal mark is a comma.
    usual : str
        Unit of what states none.

    Raises
    ------
    RecordingError
        If a row has another length, or a cell is no number.
    """
    width = len(rows[first])
    names, units = _header(rows[:first], width)
    columns = _columns(path, rows[first:], width, comma)
    units = [
        TIME_OF_DAY if _CLOCK.match(cell) else unit or unit_of(name) or usual
        for name, unit, cell in zip(names, units, rows[first], strict=True)
    ]
    return tuple(map(Signal, names, columns, units))


def _rate(above: Sequence[str]) -> float | None:
    """Return the rate of the samples [Hz] that a header states."""
    stated = filter(None, map(_RATE.match, above))
    rates = {float(one[2]) * (1e3 if 'khz' in one[0].lower() else 1.0) for one in stated}
    # of several none is that of the force for certain
    return rates.pop() if len(rates) == 1 else None


def _separator(lines: Sequence[str]) -> str:
    """Return the separator that cuts most lines of the data into equally many cells."""
    sample = lines[-_LOOKED_AT:]
    for separator in _SEPARATORS:
        counts = Counter(len(_splitter(separator)(line)) for line in sample)
        width, often = counts.most_common(1)[0]
        if width > 1 and often >= 0.8 * len(sample):
            return separator
    return ','


def _splitter(separator: str) -> Callable[[str], list[str]]:
    if separator == ' ':
        return str.split

    def split(line: str) -> list[str]:
        if '"' not in line:
            return [cell.strip() for cell in line.split(separator)]
        cells = re.findall(rf'(?:^|{re.escape(separator)})("(?:[^"]|"")*"|[^{separator}]*)', line)
        bare = (cell.strip().removeprefix('"').removesuffix('"') for cell in cells)
        return [cell.replace('""', '"').strip() for cell in bare]

    return split


def _decimal_comma(rows: Sequence[list[str]]) -> bool:
    cells = [cell for row in rows[-_LOOKED_AT:] for cell in row]
    return any(re.fullmatch(r'[-+]?\d*,\d+(?:[eE][-+]?\d+)?', cell) for cell in cells)


def _refuse_decimal_commas(path: Path, titles: list[str], sample: list[list[str]]) -> None:
    """Refuse a table whose separators are commas, as its decimal marks: two cells a number."""
    count, width = len(titles), len(sample[0])
    if count < 2 or width != 2 * count:
        return
    halves = (r'[-+]?\d+', r'\d+(?:[eE][-+]?\d+)?')
    if all(
        re.fullmatch(half, cell)
        for place, half in enumerate(halves)
        for row in sample
        for cell in row[place::2]
    ):
        got = f'{count} titles, {width} cells a row: comma as decimal mark and as separator?'
        how = 'Export it with semicolons or tabs between the cells, or with decimal points'
        raise RecordingError(f'expected a cell for each title of {path}, got {got} {how}')


def _has_point(cell: str) -> bool:
    """Return whether a number has a point; that of a time of day ends its seconds."""
    return '.' in cell and ':' not in cell


def _refuse_thousands(path: Path, cells: Sequence[str]) -> None:
    """Refuse a table with marks between thousands: 1.000 would be read as one."""
    for cell in filter(_THOUSANDS.match, cells):
        fault = f'expected numbers without marks between thousands in {path}'
        raise RecordingError(f'{fault}, got {cell!r}; export it without them')


def _refuse_marked(path: Path, cells: Sequence[str]) -> None:
    """Refuse whole numbers of which the large ones have marks, which read as decimals."""
    # the first number with other decimals than three ends this
    if all(_WHOLE.fullmatch(cell) or _THOUSANDS.match(cell) for cell in cells):
        marked = list(filter(_THOUSANDS.match, cells))
        # decimals are seldom three each, and never beside whole numbers
        others = set(cells) - set(marked)
        if len(marked) > _SOME and any(len(cell.lstrip('-')) > 1 for cell in others):
            _refuse_thousands(path, marked)


def number(cell: str, comma: bool) -> float | None:
    """Return the number of a cell, not a number where it is missing; None for other text."""
    if cell.lower() in _MISSING:
        return float('nan')
    if clock := _CLOCK.match(cell):
        hours, minutes, seconds = clock[2], clock[3], clock[4].replace(',', '.')
        return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)
    try:
        # Python reads 1_0 as ten
        return float((cell.replace(',', '.') if comma else cell).replace('_', 'x'))
    except ValueError:
        return None


def first_row(path: Path, rows: Sequence[list[str]], comma: bool = False) -> int:
    """Return the first row that holds numbers only, and as many as most rows.

    Raises
    ------
    RecordingError
        If there is none.
    """
    width = Counter(len(row) for row in rows[-_LOOKED_AT:]).most_common(1)[0][0]
    titled = False
    for index, cells in enumerate(rows):
        numbers = [number(cell, comma) for cell in cells]
        known = [value is not None and not np.isnan(value) for value in numbers]
        if len(cells) == width and any(known):
            if None not in numbers:
                return index
            # below the titles, and no units
            if titled and known[0] and not all(map(_UNITS.match, cells)):
                raise RecordingError(
                    f'expected numbers in {path}, got {cells[numbers.index(None)][:40]!r} in the '
                    f'row that begins with {cells[0]}'
                )
        titled |= len(cells) == width and not any(known)
    cells = [cell for row in rows[-_LOOKED_AT:] for cell in row]
    points = [cell for cell in cells if comma and _has_point(cell)]
    _refuse_thousands(path, points + [cell for cell in cells if number(cell, comma) is None])
    fault = f'expected rows of numbers below the header of {path}'
    raise RecordingError(f'{fault}, got none among {len(rows)} lines')


def _header(above: Sequence[list[str]], width: int) -> tuple[list[str], list[str]]:
    """Return names and units of the columns from the lines above the numbers."""
    # a row in which everything is missing names nothing
    wide = [row for row in above if len(row) == width and {*map(str.lower, row)} - _MISSING]
    units = [''] * width
    if len(wide) > 1:
        titles, last = ([bool(cell and _UNITS.match(cell)) for cell in row] for row in wide[-2:])
        # where most are units, and fewer above, others are units that are not known
        if all(map(_UNITS.match, wide[-1])) or sum(last) > max(width / 2, sum(titles)):
            units = [cell.strip('[]() ') for cell in wide.pop()]
    return (wide[-1] if wide else [''] * width), units


def _columns(path: Path, rows: Sequence[list[str]], width: int, comma: bool) -> list[FloatArray]:
    table = np.empty((len(rows), width))
    days: set[str] = set()
    for index, cells in enumerate(rows):
        if len(cells) != width:
            fault = f'expected {width} cells in each row of {path}'
            raise RecordingError(f'{fault}, got {len(cells)} in row {index + 1} of the numbers')
        for column, cell in enumerate(cells):
            value = number(cell, comma)
            if value is None or (comma and _has_point(cell)):
                _refuse_thousands(path, [cell])
                raise RecordingError(
                    f'expected numbers in {path}, got {cell[:40]!r} in row {index + 1}'
                    + (', where others have a decimal comma' if comma and '.' in cell else '')
                )
            if ':' in cell and (clock := _CLOCK.match(cell)):
                days.add(clock[1] or '')
            table[index, column] = value
    for column in range(width):
        _refuse_marked(path, [row[column] for row in rows])
    if len(days) > 1:
        fault = f'expected the times of one day in {path}, got those of {len(days)} dates'
        raise RecordingError(fault)
    return [np.ascontiguousarray(column) for column in table.T]


def _labchart(path: Path, text: str, encoding: str, block: int | None) -> SignalFile:
    """Return the channels of one block: lines of ``Name=``, then time and channels."""
    blocks = _blocks(text.splitlines())
    if block is None and len(blocks) > 1:
        fault = f'expected one block in {path}, got {len(blocks)}'
        raise RecordingError(f'{fault}: --block 1 to {len(blocks)} decides')
    chosen = 1 if block is None else block
    if not 1 <= chosen <= len(blocks):
        raise RecordingError(f'expected a block from 1 to {len(blocks)} of {path}, got {chosen}')
    head, rows = blocks[chosen - 1]
    width = max(map(len, rows), default=0)
    if width < 2:
        raise RecordingError(f'expected time and channels in {path}, got no such rows')

    def padded(name: str) -> list[str]:
        return [*head.get(name, []), *[''] * width][: width - 1]

    # the range has the unit of the numbers, too
    stated = zip(padded('UnitName'), padded('Range'), strict=True)
    units = [unit.strip('*') or span.strip('*').rpartition(' ')[2] for unit, span in stated]
    # what is missing at the end of a row is not written
    whole = [[*row, *[''] * (width - len(row))] for row in rows]
    time, *channels = _columns(path, whole, width, _decimal_comma(rows))
    if interval := _INTERVAL.fullmatch(head.get('Interval', [''])[0].replace(',', '.')):
        # times with few decimals are those of this grid, rounded to milliseconds
        exact = time[0] + float(interval[1]) * np.arange(len(time))
        time = exact if np.abs(exact - time).max() < 1e-3 else time
    named = zip(padded('ChannelTitle'), channels, units, strict=True)
    signals = tuple(Signal(*one, time) for one in named)
    return SignalFile(path, 'LabChart text', signals, facts=(encoding, f'block {chosen}'))


def _blocks(lines: list[str]) -> list[tuple[dict[str, list[str]], list[list[str]]]]:
    """Return header and rows of each block."""
    blocks: list[tuple[dict[str, list[str]], list[list[str]]]] = []
    for line in lines:
        name, equals, rest = line.partition('=')
        if equals and name.isalpha():
            if not blocks or blocks[-1][1]:
                blocks.append(({}, []))
            blocks[-1][0][name] = [cell.strip() for cell in rest.removeprefix('\t').split('\t')]
        elif line.strip() and blocks:
            # a comment follows the numbers of a row, behind #
            cells = [cell.strip() for cell in line.split('#')[0].rstrip('\t ').split('\t')]
            blocks[-1][1].append(cells)
    return blocks
