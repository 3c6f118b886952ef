# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Spike2's export as text: a section for each channel, waveforms by start and period, events."""

from pathlib import Path

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing.signals import Events
from rpms_ros.recording.importing.signals import Signal
from rpms_ros.recording.importing.signals import SignalFile
from rpms_ros.recording.importing.signals import unlike
from rpms_ros.recording.importing.text import decoded


def is_spike2(text: str) -> bool:
    """Return whether a text begins as Spike2's exports do."""
    return text[:200].lstrip().startswith('"INFORMATION"') and '"CHANNEL"' in text


def read_spike2(path: Path) -> SignalFile:
    """Return waveforms and events of the channels.

    Raises
    ------
    RecordingError
        If a channel's numbers cannot be read.
    """
    text, encoding = decoded(path)
    signals: list[Signal] = []
    events: list[Events] = []
    for section in text.split('"CHANNEL"')[1:]:
        lines = [line.strip() for line in section.splitlines()]
        kind, title = (_quoted(lines, place) for place in (1, 3))
        start = next((line for line in lines if line.startswith('"START"')), None)
        values = [line.split('\t')[0] for line in lines[4:] if line and not line.startswith('"')]
        try:
            numbers = np.array([float(value) for value in values])
            begin, period = (float(cell) for cell in start.split()[1:3]) if start else (0.0, 0.0)
        except ValueError as error:
            raise RecordingError(
                f'expected numbers in channel {title!r} of {path}, got {error}'
            ) from error
        if start:
            time = begin + period * np.arange(len(numbers), dtype=np.float64)
            signals.append(Signal(title, numbers, _unit(lines), time))
        elif len(numbers) and kind.lower().startswith(('evt', 'event', 'level', 'marker')):
            events.append(Events(title, numbers))
    if not signals:
        raise RecordingError(f'expected a waveform with "START" in {path}, got none')
    names = unlike([signal.name for signal in signals] + [one.name for one in events])
    return SignalFile(
        path,
        'Spike2 text',
        tuple(
            Signal(name, one.values, one.unit, one.time)
            for name, one in zip(names, signals, strict=False)
        ),
        tuple(
            Events(name, one.time) for name, one in zip(names[len(signals) :], events, strict=True)
        ),
        facts=(encoding,),
    )


def _quoted(lines: list[str], place: int) -> str:
    return lines[place].strip('"') if place < len(lines) else ''


def _unit(lines: list[str]) -> str:
    """Return the unit: the first quoted text of the line of scales, before ``START``."""
    for line in lines[4:]:
        if line.startswith('"START"'):
            break
        if line.startswith('"') and '\t' in line:
            return line.split('\t')[0].strip('"')
    return ''
