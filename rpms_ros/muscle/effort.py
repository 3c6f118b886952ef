# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Force that the stimulation does not cause: voluntary effort, spasm, tremor, a bumped sensor.

Each depends on time alone, so the result does not depend on how samples are cut into blocks.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from rpms_ros.errors import MuscleError
from rpms_ros.pulses import FloatArray


class Effort(Protocol):
    """One kind of force that the stimulation does not cause."""

    kind: ClassVar[str]
    """Name in a scenario."""

    def force(self, time: FloatArray) -> FloatArray:
        """Return the force [N] at times from the start of the session (samples,) [s]."""


@dataclass(frozen=True)
class VoluntaryEffort:
    """A voluntary contraction that rises and falls as a squared sine.

    Attributes
    ----------
    at : float
        Beginning [s].
    duration : float
        Length [s].
    peak : float
        Largest force [N].
    every : float or None
        Repeats with this period [s]; None for once.
    """

    kind: ClassVar[str] = 'voluntary'
    at: float
    duration: float
    peak: float
    every: float | None = None

    def __post_init__(self) -> None:
        _require_event(self.at, self.duration, self.every)
        _require_finite('peak', self.peak)

    def force(self, time: FloatArray) -> FloatArray:
        """Return the force [N] (samples,)."""
        return self.peak * _half_sine(time, self.at, self.duration, self.every) ** 2


@dataclass(frozen=True)
class Spasm:
    """An involuntary contraction: a fast rise, then an exponential decay.

    Attributes
    ----------
    at : float
        Beginning [s].
    peak : float
        Largest force [N].
    rise : float
        Time to the peak [s].
    decay : float
        Time constant after the peak [s].
    every : float or None
        Repeats with this period [s]; None for once.
    """

    kind: ClassVar[str] = 'spasm'
    at: float
    peak: float
    rise: float = 0.15
    decay: float = 1.0
    every: float | None = None

    def __post_init__(self) -> None:
        _require_event(self.at, self.rise, self.every, 'rise')
        _require_finite('peak', self.peak)
        if not 0.0 < self.decay < math.inf:
            raise MuscleError(f'expected a finite decay above 0 s, got {self.decay}')

    def force(self, time: FloatArray) -> FloatArray:
        """Return the force [N] (samples,)."""
        since = _since(time, self.at, self.every)
        rising = self.peak * np.sin(0.5 * math.pi * np.clip(since / self.rise, 0.0, 1.0)) ** 2
        falling = np.exp(-np.maximum(since - self.rise, 0.0) / self.decay)
        return np.where(since >= 0.0, rising * falling, 0.0)


@dataclass(frozen=True)
class Tremor:
    """A sinusoidal force.

    Attributes
    ----------
    amplitude : float
        Half of the peak-to-peak force [N].
    frequency : float
        [Hz].
    at : float
        Beginning [s].
    duration : float or None
        Length [s]; None: to the end of the session.
    """

    kind: ClassVar[str] = 'tremor'
    amplitude: float
    frequency: float = 8.0
    at: float = 0.0
    duration: float | None = None

    def __post_init__(self) -> None:
        _require_event(self.at, 1.0 if self.duration is None else self.duration, None)
        _require_finite('amplitude', self.amplitude)
        if not 0.0 < self.frequency <= 1000.0:
            raise MuscleError(f'expected a frequency above 0 up to 1000 Hz, got {self.frequency}')

    def force(self, time: FloatArray) -> FloatArray:
        """Return the force [N] (samples,)."""
        since = time - self.at
        length = math.inf if self.duration is None else self.duration
        inside = (since >= 0.0) & (since < length)
        wave = self.amplitude * np.sin(2.0 * math.pi * self.frequency * since)
        return np.where(inside, wave, 0.0)


@dataclass(frozen=True)
class Bump:
    """A knock on the sensor: half a sine.

    Attributes
    ----------
    at : float
        Beginning [s].
    peak : float
        Largest force [N], of either sign.
    duration : float
        Length [s].
    every : float or None
        Repeats with this period [s]; None for once.
    """

    kind: ClassVar[str] = 'bump'
    at: float
    peak: float
    duration: float = 0.03
    every: float | None = None

    def __post_init__(self) -> None:
        _require_event(self.at, self.duration, self.every)
        _require_finite('peak', self.peak)

    def force(self, time: FloatArray) -> FloatArray:
        """Return the force [N] (samples,)."""
        return self.peak * _half_sine(time, self.at, self.duration, self.every)


EFFORTS: dict[str, type[Effort]] = {
    effort.kind: effort for effort in (VoluntaryEffort, Spasm, Tremor, Bump)
}
"""Kinds of effort by their names in a scenario."""


def total_effort(efforts: Sequence[Effort], time: FloatArray) -> FloatArray:
    """Return the sum of all efforts [N] at times from the start (samples,) [s]."""
    total = np.zeros(len(time))
    for effort in efforts:
        total += effort.force(time)
    return total


def _since(time: FloatArray, at: float, every: float | None) -> FloatArray:
    """Return the time since the newest beginning (samples,) [s]; negative before the first."""
    since: FloatArray = time - at
    if every is None:
        return since
    return np.where(since >= 0.0, np.mod(since, every), since)


def _half_sine(time: FloatArray, at: float, duration: float, every: float | None) -> FloatArray:
    """Return half a sine from 0 over 1 to 0 during an event, 0 outside (samples,)."""
    since = _since(time, at, every)
    inside = (since >= 0.0) & (since < duration)
    return np.where(inside, np.sin(math.pi * since / duration), 0.0)


def _require_event(
    at: float, duration: float, every: float | None, name: str = 'duration'
) -> None:
    """Raise `MuscleError` unless an event is possible; `name` is the key of its length."""
    if not 0.0 <= at < math.inf:
        raise MuscleError(f'expected a finite at of at least 0 s, got {at}')
    if not 0.0 < duration < math.inf:
        raise MuscleError(f'expected a finite {name} above 0 s, got {duration}')
    if every is not None and not duration <= every < math.inf:
        raise MuscleError(f'expected a finite every of at least {duration:g} s, got {every}')


def _require_finite(name: str, value: float) -> None:
    if not math.isfinite(value):
        raise MuscleError(f'expected a finite {name}, got {value}')
