# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The excitations of the paper and the everyday ones, ready made.

Schedules of the paper's experiments on the muscle itself (Sec. 2).

Twitches at intensities (Tables 1 and 2, Fig. 5), trains at rates (Figs. 6 to 8), and the staircase
of intensities at several rates that the recruitment field is made of (Figs. 9 and 10).
"""

from collections.abc import Iterable, Sequence

import numpy as np

from rpms_ros.errors import StimulationError, check_seed
from rpms_ros.stimulation.schedule.schedule import Pause, Repeat, Schedule, Segment
from rpms_ros.stimulation.schedule.segments import (
    LEVELS,
    Constant,
    PulseBurst,
    Single,
    Sinusoid,
    Staircase,
    UniformRandom,
)

PAPER_RATE_HZ = 20.0
PAPER_DURATION_S = 90.0


def paper_random(
    duration_s: float = PAPER_DURATION_S, rate_hz: float = PAPER_RATE_HZ, seed: int = 1
) -> Schedule:
    """Return uniform random intensities from 0 to 100 % (Eq. 29, Sec. 3.3.1)."""
    segment = UniformRandom(rate_hz=rate_hz, duration_s=duration_s)
    return Schedule((segment,), name=UniformRandom.kind, seed=seed)


def paper_sinusoid(
    duration_s: float = PAPER_DURATION_S,
    rate_hz: float = PAPER_RATE_HZ,
    catch_share: float | None = None,
    seed: int = 0,
) -> Schedule:
    """Return a sinusoidal change of intensity from 0 to 100 %, period 9 s (Sec. 3.3.1).

    The paper has no catch pulses among it; see `Gradual`.
    """
    segment = Sinusoid(rate_hz, duration_s, catch_share=catch_share)
    return Schedule((segment,), name=Sinusoid.kind, seed=seed)


def staircase(
    levels: Sequence[float] = LEVELS,
    step_s: float = 3.0,
    rate_hz: float = PAPER_RATE_HZ,
    catch_share: float | None = None,
    seed: int = 0,
) -> Schedule:
    """Return levels of ``step_s`` seconds each, one after another."""
    length = step_s * max(1, len(levels))
    segment = Staircase(rate_hz, length, levels=tuple(levels), catch_share=catch_share)
    return Schedule((segment,), name=Staircase.kind, seed=seed)


def constant(
    intensity: float = 1.0, duration_s: float = 10.0, rate_hz: float = PAPER_RATE_HZ
) -> Schedule:
    """Return pulses of one intensity."""
    segment = Constant(rate_hz=rate_hz, duration_s=duration_s, intensity=intensity)
    return Schedule((segment,), name=Constant.kind)


TWITCH_INTENSITIES = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
TRAIN_RATES_HZ = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0)
FIELD_RATES_HZ = (15.0, 19.0, 23.0, 27.0, 31.0, 35.0)
# 21 intensities at 6 rates: 126 levels, 882 data sets of 7 subjects (Sec. 2.2).
FIELD_LEVELS = tuple(round(float(level), 3) for level in np.linspace(0.0, 1.0, 21))
REST = Pause(1.0)


def twitches(
    intensities: tuple[float, ...] = TWITCH_INTENSITIES, repetitions: int = 10, seed: int = 0
) -> Schedule:
    """Return single pulses at several intensities, in an order that does not follow fatigue.

    Parameters
    ----------
    intensities : tuple of float
        Shares of the maximum.
    repetitions : int
        Pulses at each intensity.
    seed : int
        Of the order.

    Raises
    ------
    StimulationError
        If there is nothing to give, the seed is none, or twitches would run into each other.
    """
    if not intensities or repetitions < 1:
        fault = f'expected intensities and repetitions, got {len(intensities)} and {repetitions}'
        raise StimulationError(fault)
    check_seed(seed, StimulationError)
    order = np.random.default_rng(seed).permutation(np.repeat(intensities, repetitions))
    pulses: list[Segment] = [Single(float(level)) for level in order]
    return Schedule((REST, *pulses), name='twitches', seed=seed)


def _with_rests(segments: Iterable[Segment], rest_s: float) -> list[Segment]:
    """Return segments with a pause behind each [s]."""
    return [item for segment in segments for item in (segment, Pause(rest_s))]


def trains(
    rates_hz: tuple[float, ...] = TRAIN_RATES_HZ, duration_s: float = 1.5, rest_s: float = 3.0
) -> Schedule:
    """Return trains at several rates, single pulses and doublets before them as a reference.

    Parameters
    ----------
    rates_hz : tuple of float
        Repetition rates [Hz].
    duration_s : float
        Length of each train [s].
    rest_s : float
        Silence after each [s].
    """
    bursts = tuple(PulseBurst(1.0, count, 0.02, rest_s) for count in (2, 4))
    given = _with_rests((Constant(rate, duration_s, 1.0) for rate in rates_hz), rest_s)
    return Schedule((REST, Repeat((Single(1.0, rest_s),), 3), *bursts, *given), name='trains')


def recruitment(
    rates_hz: tuple[float, ...] = FIELD_RATES_HZ,
    levels: tuple[float, ...] = FIELD_LEVELS,
    step_s: float = 1.2,
    rest_s: float = 3.0,
) -> Schedule:
    """Return a staircase of intensities at each of several rates.

    Parameters
    ----------
    rates_hz : tuple of float
        Repetition rates [Hz].
    levels : tuple of float
        Shares of the maximum, in their order.
    step_s : float
        Length of each level [s]: half a second to settle, the rest to measure.
    rest_s : float
        Silence after each staircase [s].
    """
    length = step_s * max(1, len(levels))
    given = _with_rests((Staircase(rate, length, levels=levels) for rate in rates_hz), rest_s)
    return Schedule((REST, *given), name='recruitment')


def muscle(seed: int = 0) -> Schedule:
    """Return twitches, trains and staircases, one after another: the whole of Sec. 2."""
    parts = (twitches(seed=seed), trains(), recruitment())
    segments = tuple(segment for part in parts for segment in part.segments)
    return Schedule(segments, name='muscle', seed=seed)
