# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""True state of a simulated muscle, for comparison with what was identified."""

from dataclasses import dataclass

import numpy as np

from rpms_ros.muscle.state import Muscle
from rpms_ros.muscle.state import MuscleState
from rpms_ros.muscle.subject import REFERENCE_RATE
from rpms_ros.muscle.surroundings import Surroundings
from rpms_ros.pulses import FloatArray

CURVE_POINTS = 41


@dataclass(frozen=True)
class Truth:
    """The muscle and its surroundings at one time.

    Attributes
    ----------
    stamp_ns : int
        When [ns].
    state : MuscleState
        Gain, dynamics, thresholds.
    repetition_rate : float
        Repetition rate for which the curve is stated [Hz].
    curve_intensity, curve_force : ndarray, shape (points,)
        Recruitment curve: steady mean force [N] over intensity (share).
    effort : float
        Force that the stimulation does not cause [N].
    """

    stamp_ns: int
    state: MuscleState
    repetition_rate: float
    curve_intensity: FloatArray
    curve_force: FloatArray
    effort: float


def truth_at(muscle: Muscle, surroundings: Surroundings, stamp_ns: int) -> Truth:
    """Return the true state at a time [ns] up to which the force has been computed."""
    intensity = np.linspace(0.0, 1.0, CURVE_POINTS)
    return Truth(
        stamp_ns=stamp_ns,
        state=muscle.state(stamp_ns),
        repetition_rate=REFERENCE_RATE,
        curve_intensity=intensity,
        curve_force=muscle.steady_force(stamp_ns, intensity, REFERENCE_RATE),
        effort=float(surroundings.effort(np.array([stamp_ns]))[0]),
    )
