# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Spike2's export to MATLAB: a structure for each channel, waveforms by start and interval."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing.signals import Events
from rpms_ros.recording.importing.signals import Signal
from rpms_ros.recording.importing.signals import SignalFile
from rpms_ros.recording.importing.signals import as_samples
from rpms_ros.recording.importing.signals import unlike

_WAVEFORM = {'interval', 'start', 'values'}
_EVENTS = {'title', 'length', 'times'}


def spike2_channels(path: Path, content: Mapping[str, Any]) -> SignalFile | None:
    """Return the channels of a MATLAB file that Spike2 has written; None if it is another one.

    Channels that are neither waveforms nor events, such as wavemarks, are left out.

    Parameters
    ----------
    path : Path
        The file.
    content : mapping
        Its variables, structures as objects with ``_fieldnames``.

    Raises
    ------
    RecordingError
        If the interval of a waveform is not above zero.
    """
    channels = {name: set(getattr(value, '_fieldnames', ())) for name, value in content.items()}
    if not any(found >= _WAVEFORM for found in channels.values()):
        return None
    signals: list[Signal] = []
    events: list[Events] = []
    for name, found in channels.items():
        channel = content[name]
        title = _text(channel, 'title') or name
        if found >= _WAVEFORM:
            if (values := as_samples(channel.values)) is not None:
                signals.append(_waveform(path, title, channel, values))
        elif found >= _EVENTS and 'values' not in found:
            times = np.atleast_1d(np.asarray(channel.times, dtype=np.float64)).ravel()
            events.append(Events(title, times))
    names = unlike([one.name for one in signals] + [one.name for one in events])
    count = len(signals)
    return SignalFile(
        path,
        'Spike2 MATLAB',
        tuple(
            Signal(name, one.values, one.unit, one.time)
            for name, one in zip(names[:count], signals, strict=True)
        ),
        tuple(Events(name, one.time) for name, one in zip(names[count:], events, strict=True)),
    )


def _waveform(path: Path, title: str, channel: Any, values: Any) -> Signal:
    start, interval = float(channel.start), float(channel.interval)
    if not (np.isfinite(start) and 0.0 < interval < np.inf):
        raise RecordingError(
            f'expected a waveform with an interval above 0 s in {path}, got {interval} of '
            f'{title!r}'
        )
    time = start + interval * np.arange(len(values), dtype=np.float64)
    return Signal(title, values, _text(channel, 'units'), time)


def _text(channel: Any, name: str) -> str:
    """Return a text of a channel; MATLAB's empty one is an empty array."""
    value = getattr(channel, name, '')
    return value if isinstance(value, str) else ''
