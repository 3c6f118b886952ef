# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Signals become pulses and force samples."""

from dataclasses import dataclass

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import (
    MAGNETIC_PULSE_WIDTH,
    NANOSECONDS_PER_SECOND,
    FloatArray,
    ForceTrace,
    IntArray,
    PulseTrain,
)
from rpms_ros.recording.importing.event_lists import SAMPLES, stamps_of_numbers
from rpms_ros.recording.importing.gates import GateSettings, gate_pulses
from rpms_ros.recording.importing.guess import Guess
from rpms_ros.recording.importing.signals import SENSOR_UNITS, TIME_UNITS, Signal, SignalFile

# No muscle shows a pulse for longer.
_ACTS_NS = 3 * NANOSECONDS_PER_SECOND // 2


@dataclass(frozen=True)
class ImportChoices:
    """What a file does not tell.

    Attributes
    ----------
    gate : GateSettings
        Threshold and edge of a sampled gate, and the intensity of every pulse.
    sampling_rate_hz : float or None
        Rate of a table without times [Hz].
    force_scale : float or None
        Newtons of one unit of the force signal; None for those of its unit.
    """

    gate: GateSettings
    sampling_rate_hz: float | None = None
    force_scale: float | None = None

    def __post_init__(self) -> None:
        for name in ('sampling_rate_hz', 'force_scale'):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value != 0.0):
                raise RecordingError(f'expected a finite {name} that is not 0, got {value}')
        if self.sampling_rate_hz is not None and self.sampling_rate_hz < 0.0:
            raise RecordingError(
                f'expected a sampling rate above 0 Hz, got {self.sampling_rate_hz}'
            )


def converted(
    file: SignalFile, guess: Guess, choices: ImportChoices
) -> tuple[PulseTrain, ForceTrace]:
    """Return pulses and force.

    Raises
    ------
    RecordingError
        If times do not rise, a gate is not finite or never rises, or there is no pulse.
    """
    signals = {signal.name: signal for signal in file.signals}
    force = signals[guess.force]
    scale = choices.force_scale
    newton = SENSOR_UNITS[guess.force_unit] if scale is None else scale
    stamp_ns = stamps_of(file, force, guess, choices)
    if not np.isfinite(force.values).any():
        raise RecordingError(
            f'expected numbers in column {guess.force!r} of {file.path}, got none that is finite'
        )
    trace = ForceTrace(stamp_ns, newton * force.values)
    events = {one.name: one.time for one in file.events}
    if guess.pulse in events:
        return _of_events(_rounded(np.sort(events[guess.pulse])), choices.gate, file), trace
    if guess.pulse_unit is not None:
        return _of_events(_of_list(file, guess, stamp_ns), choices.gate, file), trace
    gate = signals[guess.pulse]
    _finite(file, guess.pulse, gate.values)
    pulses = gate_pulses(stamps_of(file, gate, guess, choices), gate.values, choices.gate)
    if pulses.sequence[0]:
        # what the pulse of unknown onset acts on, as far as no other one does
        first_ns = min(int(pulses.onset_ns[0]), int(stamp_ns[0]) + _ACTS_NS)
        kept = stamp_ns >= first_ns
        trace = ForceTrace(trace.stamp_ns[kept], trace.force[kept])
    return pulses, trace


def _of_list(file: SignalFile, guess: Guess, stamp_ns: IntArray) -> IntArray:
    """Return the stamps [ns] of a list of times or numbers of samples."""
    signal = next(one for one in file.signals if one.name == guess.pulse)
    if guess.pulse_unit == SAMPLES:
        return stamps_of_numbers(signal, stamp_ns)
    assert guess.pulse_unit is not None
    return _rising(file, signal.name, signal.values, TIME_UNITS[guess.pulse_unit])


def _rounded(seconds: FloatArray) -> IntArray:
    return np.rint(seconds * NANOSECONDS_PER_SECOND).astype(np.int64)


def stamps_of(file: SignalFile, signal: Signal, guess: Guess, choices: ImportChoices) -> IntArray:
    """Return the stamps of a signal [ns]."""
    name = guess.time
    if name is not None:
        column = next(one for one in file.signals if one.name == name)
        _finite(file, name, column.values)
        return _rising(file, name, column.values, TIME_UNITS[guess.time_unit])
    if signal.time is not None:
        return _rising(file, signal.name, signal.time, 1.0)
    rate = choices.sampling_rate_hz or file.sampling_rate_hz
    assert rate is not None
    steps = np.arange(len(signal.values)) * (NANOSECONDS_PER_SECOND / rate)
    stamps: IntArray = np.rint(steps).astype(np.int64)
    return stamps


def _finite(file: SignalFile, name: str, values: FloatArray) -> None:
    if not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values))[0])
        raise RecordingError(
            f'expected finite numbers in column {name!r} of {file.path}, '
            f'got {values[row]} in row {row + 1}'
        )


def _rising(file: SignalFile, name: str, values: FloatArray, unit: float) -> IntArray:
    if (missing := np.flatnonzero(np.isnan(values))).size:
        raise RecordingError(
            f'expected a time in each row of column {name!r} of {file.path}, got none in row '
            f'{missing[0] + 1}'
        )
    if (late := np.flatnonzero(np.diff(values) <= 0)).size:
        raise RecordingError(
            f'expected rising times in column {name!r} of {file.path}, '
            f'got {values[late[0]]} and then {values[late[0] + 1]}'
        )
    seconds = values * unit
    # Beyond that nanoseconds do not fit into 64 bits.
    if len(seconds) and not np.abs(seconds).max() < 9e9:
        raise RecordingError(
            f'expected times below 9e9 s in {file.path}, got {np.abs(seconds).max():g} s: '
            '--time-unit decides'
        )
    return _rounded(seconds)


def _of_events(onset: IntArray, gate: GateSettings, file: SignalFile) -> PulseTrain:
    if not len(onset):
        raise RecordingError(f'expected pulses in {file.path}, got an empty list of events')
    count = len(onset)
    return PulseTrain(
        onset,
        np.full(count, gate.intensity, dtype=np.float64),
        np.arange(count, dtype=np.int64),
        np.full(count, MAGNETIC_PULSE_WIDTH),
    )
