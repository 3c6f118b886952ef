# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""XDF files of the Lab Streaming Layer: streams with their own clocks, put on one by pyxdf."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing.signals import Events, Signal, SignalFile, needed, unlike


def read_xdf(path: Path) -> SignalFile:
    """Return channels as signals and irregular streams as events, in the recorder's clock.

    Raises
    ------
    RecordingError
        If pyxdf is not installed or the file is damaged.
    """
    pyxdf = needed(import_module, 'pyxdf', f'an XDF file ({path})')
    try:
        streams, _ = pyxdf.load_xdf(str(path), verbose=False)
        signals, events = _sorted(streams)
    # pyxdf raises whatever the damage leads to, and gives streams that lack any part
    except Exception as error:
        raise RecordingError(f'expected an XDF file at {path}, got {error}') from error
    begins = [float(one.time[0]) for one in signals if one.time is not None and len(one.time)]
    if not begins:
        raise RecordingError(f'expected a sampled stream in {path}, got {len(events)} of events')
    start = min(begins)
    names = unlike([one.name for one in signals])
    return SignalFile(
        path,
        'XDF',
        tuple(
            Signal(name, one.values, one.unit, one.time - start if one.time is not None else None)
            for name, one in zip(names, signals, strict=True)
        ),
        tuple(Events(one.name, one.time - start) for one in events),
    )


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
        found = [(_first(one, 'label'), _first(one, 'unit')) for one in listed]
    except (KeyError, IndexError, TypeError):
        found = []
    plain = [(str(index + 1) if count > 1 else '', '') for index in range(count)]
    return found if len(found) == count else plain


def _first(item: dict[str, Any], key: str) -> str:
    value = item.get(key)
    return str(value[0]) if value and value[0] else ''
