# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Force of a simulated muscle in memory, to try the analysis where the truth is known."""

from dataclasses import dataclass

import numpy as np

from rpms_ros.muscle import Contraction, Disturbances, Sensor, Subject
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, ForceTrace, PulseTrain

_BLOCK = 1000
# At this rate twitches do not overlap.
_ALONE_HZ = 0.1


@dataclass(frozen=True)
class SensorShares:
    """Disturbances, relative to the peak of a twitch at full intensity.

    Attributes
    ----------
    noise : float
        Standard deviation of white noise.
    artifact : float
        Peak of the artifact at full intensity.
    drift : float
        Amplitude of a baseline of period 120 s.
    """

    noise: float = 0.01
    artifact: float = 1.0
    drift: float = 0.0


def twitch_peak(subject: Subject) -> float:
    """Return the peak of a single twitch at full intensity [N]."""
    return float(subject.pulse_weight(1.0, _ALONE_HZ))


def simulated_force(
    subject: Subject,
    pulses: PulseTrain,
    duration: float,
    shares: SensorShares | None = None,
    sample_rate_hz: float = 1000.0,
    seed: int = 0,
) -> ForceTrace:
    """Return the samples of a force sensor from time 0 on.

    Parameters
    ----------
    subject : Subject
        The muscle.
    pulses : PulseTrain
        Ascending in onset.
    duration : float
        Length [s].
    shares : SensorShares, optional
        Disturbances; by default 1 % noise and artifacts as high as a twitch.
    sample_rate_hz : float
        Rate of the samples [Hz].
    seed : int
        Of the noise.
    """
    shares = shares or SensorShares()
    count = round(duration * sample_rate_hz)
    step = NANOSECONDS_PER_SECOND / sample_rate_hz
    stamps = np.rint(np.arange(count) * step).astype(np.int64)
    muscle = Contraction(subject)
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    blocks = np.array_split(stamps, max(1, count // _BLOCK))
    force = np.concatenate([muscle.force(block) for block in blocks])
    peak = twitch_peak(subject)
    sensor = Sensor(
        Disturbances(
            noise=shares.noise * peak, artifact=shares.artifact * peak, drift=shares.drift * peak
        ),
        seed,
    )
    shown = sensor.measure(stamps, force, pulses.onset_ns, pulses.intensity)
    return ForceTrace(stamps, shown)
