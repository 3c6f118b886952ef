# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that a library reads: MATLAB up to version 7, Excel workbooks, XDF.

Of MATLAB every vector and every column of a matrix, in structures too; of Excel one sheet as a
table, its numbers below a header; of XDF the streams of the Lab Streaming Layer, put on one clock.
"""

import logging
import pickle
import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import FloatArray
from rpms_ros.recording.importing.signals import Events, Signal, SignalFile, needed, unit_of
from rpms_ros.recording.importing.text import first_row, signals_of

# the rate of a stimulator is that of its pulses
_RATES = re.compile(
    r'(?i)(.*\.)?(fs|sampl(e|ing)_?rate|srate)|(?!.*(stim|puls|trig|train))(.*\.)?rate'
)
_MOST_COLUMNS = 64
_WAVEFORM = {'interval', 'start', 'values'}
_EVENTS = {'title', 'length', 'times'}

_LOADMAT = """\
import pickle, sys
import scipy.io
try:
    found = scipy.io.loadmat(sys.argv[1], squeeze_me=True, struct_as_record=False)
except Exception as error:
    sys.exit(str(error) or repr(error))
pickle.dump(found, sys.stdout.buffer, protocol=5)
"""


def _loadmat(path: Path) -> Any:
    """Return what SciPy reads of a file, in a process of its own: damage may crash it.

    Raises
    ------
    ValueError
        If the file is damaged.
    """
    command = [sys.executable, '-P', '-W', 'ignore', '-c', _LOADMAT, str(path)]
    done = subprocess.run(command, capture_output=True, check=False)
    if done.returncode < 0:
        name = signal.Signals(-done.returncode).name
        raise ValueError(f'damage on which SciPy crashes ({name})')
    if done.returncode:
        raise ValueError(done.stderr.decode(errors='replace').strip().splitlines()[-1])
    return pickle.loads(done.stdout)


@contextmanager
def _read_as(what: str, path: Path) -> Iterator[None]:
    """Refuse what a library cannot read: it raises whatever the damage leads to."""
    try:
        yield
    except RecordingError:
        raise
    except Exception as error:
        # of a lack of memory there is no text
        got = str(error) or repr(error)
        raise RecordingError(f'expected {what} at {path}, got {got}') from error


def read_matlab(path: Path) -> SignalFile:
    """Return every vector of numbers in the file, named by its place; of Spike2 its channels.

    Raises
    ------
    RecordingError
        If the file is damaged.
    """
    with _read_as('a MATLAB file', path):
        content = _loadmat(path)
        if (channels := _spike2_channels(path, content)) is not None:
            return channels
        items = list(_from_structure(content))
    vectors = [vector for name, array in items for vector in _vectors(name, array)]
    signals = tuple(Signal(name, values, unit_of(name)) for name, values in vectors)
    single = (item for item in items if item[1].size == 1)
    rates = {float(one.ravel()[0]): name for name, one in single if _RATES.fullmatch(name)}
    # of several none is that of the force for certain
    rate, place = rates.popitem() if len(rates) == 1 else (0.0, '')
    stated = rate if rate > 0.0 else None
    # it may be that of another signal
    facts = (f'sampling rate from {place}',) if stated else ()
    return SignalFile(path, 'MATLAB', signals, sampling_rate_hz=stated, facts=facts)


def _vectors(name: str, array: Any) -> Iterator[tuple[str, FloatArray]]:
    values = np.squeeze(array)
    if values.ndim == 1 and len(values) > 1:
        yield name, np.ascontiguousarray(values, dtype=np.float64)
    elif values.ndim == 2:
        tall = values if values.shape[0] >= values.shape[1] else values.T
        if tall.shape[1] <= _MOST_COLUMNS:
            for index, column in enumerate(tall.T):
                yield f'{name} {index + 1}', np.ascontiguousarray(column, dtype=np.float64)


def _from_structure(content: Mapping[str, Any], place: str = '') -> Iterator[tuple[str, Any]]:
    """Yield the arrays of numbers in a structure and in those within it, named by their places."""
    for name, value in content.items():
        if not name.startswith('__'):
            yield from _from_structure(_fields(value), f'{place}{name}.')
            array = np.asarray(value)
            if array.dtype.kind in 'fiub':
                yield f'{place}{name}', array


def _fields(value: Any) -> dict[str, Any]:
    return {name: getattr(value, name) for name in getattr(value, '_fieldnames', ())}


def _spike2_channels(path: Path, content: Mapping[str, Any]) -> SignalFile | None:
    """Return the channels of a MATLAB file that Spike2 has written; None if it is another one.

    Channels that are neither waveforms nor events, such as wavemarks, are left out.
    """
    channels = {name: _fields(value) for name, value in content.items()}
    if not any(found.keys() >= _WAVEFORM for found in channels.values()):
        return None
    signals: list[Signal] = []
    events: list[Events] = []
    for name, channel in channels.items():
        title = _text(channel, 'title') or name
        if channel.keys() >= _WAVEFORM:
            values = np.squeeze(np.asarray(channel['values']))
            if values.dtype.kind in 'fiub' and values.ndim == 1 and len(values) > 1:
                signals.append(_waveform(path, title, channel, values.astype(np.float64)))
        elif channel.keys() >= _EVENTS and 'values' not in channel:
            times = np.atleast_1d(np.asarray(channel['times'], dtype=np.float64)).ravel()
            level = np.ravel(channel.get('level', ()))
            # a channel of levels has the times at which it goes up and those at which it goes down
            times = times[level > 0] if len(level) == len(times) and level.any() else times
            events.append(Events(title, times))
    return SignalFile(path, 'Spike2 MATLAB', tuple(signals), tuple(events))


def _waveform(path: Path, title: str, channel: Mapping[str, Any], values: FloatArray) -> Signal:
    start, interval = float(channel['start']), float(channel['interval'])
    if not (np.isfinite(start) and 0.0 < interval < np.inf):
        fault = f'expected a waveform with an interval above 0 s in {path}'
        raise RecordingError(f'{fault}, got {interval} of {title!r}')
    time = start + interval * np.arange(len(values), dtype=np.float64)
    return Signal(title, values, _text(channel, 'units'), time)


def _text(channel: Mapping[str, Any], name: str) -> str:
    """Return a text of a channel; MATLAB's empty one is an empty array."""
    value = channel.get(name, '')
    return value if isinstance(value, str) else ''


def read_excel(path: Path, sheet: str | None = None) -> SignalFile:
    """Return the columns of a sheet, as those of a table of text.

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
    openpyxl = needed('openpyxl', f'an Excel workbook ({path})')
    with _read_as('an Excel workbook', path):
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        chosen = _chosen(path, book.sheetnames, sheet)
        found = [row for row in book[chosen].iter_rows(values_only=True) if set(row) - {None}]
        book.close()
    width = max(map(len, found), default=0)
    rows = [['' if cell is None else str(cell).strip() for cell in row] for row in found]
    rows = [[*row, *[''] * (width - len(row))] for row in rows]
    if not rows:
        raise RecordingError(f'expected rows of numbers in {path}, got an empty sheet')
    signals = signals_of(path, rows, first_row(path, rows))
    return SignalFile(path, 'Excel workbook', signals, facts=(f'sheet {chosen}',))


def _chosen(path: Path, names: list[str], sheet: str | None) -> str:
    """Return the name of the sheet that is read."""
    if sheet is None and len(names) != 1:
        fault = f'expected one sheet in {path}, got {", ".join(names)}: --sheet NAME decides'
        raise RecordingError(fault)
    if sheet is not None and sheet not in names:
        raise RecordingError(f'expected a sheet of {", ".join(names)} in {path}, got {sheet!r}')
    return sheet or names[0]


def read_xdf(path: Path) -> SignalFile:
    """Return channels as signals and irregular streams as events, in the recorder's clock.

    Raises
    ------
    RecordingError
        If pyxdf is not installed or the file is damaged.
    """
    pyxdf = needed('pyxdf', f'an XDF file ({path})')
    # a straight line is drawn through the stamps between breaks, where samples are lost
    breaks = {'jitter_break_threshold_seconds': 0.2, 'jitter_break_threshold_samples': 2}
    logger = logging.getLogger('pyxdf.pyxdf')
    with _read_as('an XDF file', path), ExitStack() as stack:
        logger.addFilter(_told_by_pyxdf)
        stack.callback(logger.removeFilter, _told_by_pyxdf)
        streams, _ = pyxdf.load_xdf(str(path), verbose=False, **breaks)
        signals, events = _sorted(streams)
    begins = [one.time[0] for one in signals if one.time is not None and len(one.time)]
    if not begins:
        raise RecordingError(f'expected a sampled stream in {path}, got {len(events)} of events')
    start = float(min(begins))
    sampled = (replace(one, time=one.time - start) for one in signals if one.time is not None)
    marks = (replace(one, time=one.time - start) for one in events)
    return SignalFile(path, 'XDF', tuple(sampled), tuple(marks))


def _told_by_pyxdf(record: logging.LogRecord) -> bool:
    """Refuse damage, of which pyxdf gives the rest; drop what else it says."""
    if record.levelno >= logging.ERROR and 'footer' not in record.getMessage():
        raise ValueError('damage: ' + record.getMessage().partition(',')[0])
    return False


def _sorted(streams: list[dict[str, Any]]) -> tuple[list[Signal], list[Events]]:
    """Return the channels of sampled streams, and the others as events."""
    signals: list[Signal] = []
    events: list[Events] = []
    for stream in streams:
        name = str(stream['info']['name'][0])
        time = np.asarray(stream['time_stamps'], dtype=np.float64)
        series = stream['time_series']
        if isinstance(series, list) or not float(stream['info']['nominal_srate'][0]) > 0.0:
            events.append(Events(name, time))
            continue
        values = np.asarray(series, dtype=np.float64)
        for index, (label, unit) in enumerate(_channels(stream, values.shape[1])):
            title = f'{name} {label}' if label else name
            signals.append(Signal(title, np.ascontiguousarray(values[:, index]), unit, time))
    return signals, events


def _channels(stream: dict[str, Any], count: int) -> list[tuple[str, str]]:
    """Return label and unit of each channel, empty where they are not stated."""
    try:
        listed = stream['info']['desc'][0]['channels'][0]['channel']
        found = [(_told(one, 'label'), _told(one, 'unit')) for one in listed]
    except (KeyError, IndexError, TypeError):
        found = []
    plain = [(str(index + 1) if count > 1 else '', '') for index in range(count)]
    return found if len(found) == count else plain


def _told(item: dict[str, Any], key: str) -> str:
    value = item.get(key)
    return str(value[0]) if value and value[0] else ''
