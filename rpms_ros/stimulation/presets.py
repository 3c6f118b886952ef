# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The excitations of the paper and the everyday ones, ready made."""

from collections.abc import Sequence

from rpms_ros.stimulation.repetitive import Constant
from rpms_ros.stimulation.repetitive import Sinusoid
from rpms_ros.stimulation.repetitive import Staircase
from rpms_ros.stimulation.repetitive import UniformRandom
from rpms_ros.stimulation.schedule import Schedule

PAPER_RATE_HZ = 20.0
PAPER_DURATION_S = 90.0
PAPER_PERIOD_S = 9.0


def paper_random(
    duration_s: float = PAPER_DURATION_S, rate_hz: float = PAPER_RATE_HZ, seed: int = 1
) -> Schedule:
    """Return uniform random intensities from 0 to 100 % (Eq. 29, Sec. 3.3.1)."""
    segment = UniformRandom(rate_hz=rate_hz, duration_s=duration_s)
    return Schedule((segment,), name=UniformRandom.kind, seed=seed)


def paper_sinusoid(
    duration_s: float = PAPER_DURATION_S,
    rate_hz: float = PAPER_RATE_HZ,
    period_s: float = PAPER_PERIOD_S,
) -> Schedule:
    """Return a sinusoidal change of intensity from 0 to 100 %, period 9 s (Sec. 3.3.1)."""
    segment = Sinusoid(rate_hz=rate_hz, duration_s=duration_s, period_s=period_s)
    return Schedule((segment,), name=Sinusoid.kind)


def staircase(
    levels: Sequence[float] = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0),
    step_s: float = 3.0,
    rate_hz: float = PAPER_RATE_HZ,
) -> Schedule:
    """Return levels of ``step_s`` seconds each, one after another."""
    segment = Staircase(
        rate_hz=rate_hz, duration_s=step_s * max(1, len(levels)), levels=tuple(levels)
    )
    return Schedule((segment,), name=Staircase.kind)


def constant(
    intensity: float = 1.0, duration_s: float = 10.0, rate_hz: float = PAPER_RATE_HZ
) -> Schedule:
    """Return pulses of one intensity."""
    segment = Constant(rate_hz=rate_hz, duration_s=duration_s, intensity=intensity)
    return Schedule((segment,), name=Constant.kind)
