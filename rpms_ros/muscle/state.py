# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Interface and true state of simulated muscles, steady or changing."""

from typing import NamedTuple, Protocol

import numpy.typing as npt

from rpms_ros.muscle.subject import Subject
from rpms_ros.pulses import FloatArray


class MuscleState(NamedTuple):
    """True state of a muscle at one time.

    Attributes
    ----------
    gain : float
        Steady force relative to the rested, unchanged subject, by scripted changes, fatigue and
        potentiation together.
    time_constant : float
        T_a [s].
    latency : float
        From the pulse to the onset of its twitch [s].
    threshold, saturation : float
        u_thr and u_sat, share of the maximum intensity.
    fatigue : float
        Steady force relative to the rested muscle, by fatigue alone.
    potentiation : float
        Growth of the twitch, as a share of the rested one.
    """

    gain: float
    time_constant: float
    latency: float
    threshold: float
    saturation: float
    fatigue: float
    potentiation: float


class Muscle(Protocol):
    """Pulses in, isometric force out."""

    @property
    def subject(self) -> Subject:
        """The muscle at rest."""

    def begin(self, start_ns: int) -> None:
        """Count the times of scripted changes from `start_ns` [ns]."""

    def add_pulses(self, onset_ns: npt.ArrayLike, intensity: npt.ArrayLike) -> None:
        """Add pulses (pulses,) at onsets [ns] with intensities (share 0..1)."""

    def force(self, stamp_ns: npt.ArrayLike) -> FloatArray:
        """Return the force [N] (samples,) at times [ns]."""

    def state(self, stamp_ns: int) -> MuscleState:
        """Return the true state at a time [ns]."""

    def steady_force(self, stamp_ns: int, intensity: FloatArray, rate_hz: float) -> FloatArray:
        """Return the true recruitment curve at a time: steady mean force [N] (intensities,)."""
