# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Grades of a verdict, and their thresholds."""

from dataclasses import dataclass

from rpms_ros.errors import IdentificationError

GOOD, DOUBTFUL, NO = 'good', 'doubtful', 'no'
GRADES = (GOOD, DOUBTFUL, NO)

Reason = tuple[str, str]
"""Grade and sentence."""


@dataclass(frozen=True)
class VerdictSettings:
    """Thresholds of the verdict.

    Attributes
    ----------
    expected_force : float
        Largest force of the muscle at a sensor [N].  200 N are far above that of a hand, a
        forearm or a foot; a strong leg at a dynamometer needs more.
    least_force : float
        Least range of the force [N].  Sensors for people resolve 0.01 to 0.1 N, and muscles of
        rats pull with some newtons; in kN a force of 10 N is 0.01.
    least_explained, good_explained : float
        Share of the force's variance, noise apart, that the estimate has to explain, or it is
        not used, or doubted.  Equal pulses explain about 0.98 of trains of real muscle, whose
        pulses are not equal (docs/analysis.md); muscle that
        tires explains no less than 0.95 over twenty seconds.
    largest_error : float
        Error of the simulated force, noise excluded, as a share of the range of the force.
    deepest_swing, worst_swing : float
        How far the response to a pulse may go below zero, as a share of its peak, before the
        result is doubtful, or not used: a muscle does not push.
    largest_residual : float
        Residual that is no white noise, as a share of the range of the force.
    held_out_times, largest_held_out : float
        The error on the end of the session with an earlier estimate may be so many times that
        with the final one, or this share of the range of the force.
    largest_drift : float
        Change of the baseline over the time that is judged, as a share of the range of the force.
    largest_change : float
        Change of the force that pulses cause over a session that is explained by one muscle, as a
        share of it.
    widest_interval : float
        Half the interval of the curve at the highest intensity that was used, as a share of it.

    Raises
    ------
    IdentificationError
        If `expected_force` is not above 0.
    """

    expected_force: float = 200.0
    least_force: float = 0.05
    least_explained: float = 0.7
    good_explained: float = 0.9
    largest_error: float = 0.08
    deepest_swing: float = 0.15
    worst_swing: float = 0.5
    largest_residual: float = 0.03
    held_out_times: float = 3.0
    largest_held_out: float = 0.05
    largest_drift: float = 0.1
    largest_change: float = 0.05
    widest_interval: float = 0.2

    def __post_init__(self) -> None:
        if not self.expected_force > 0.0:
            raise IdentificationError(
                f'expected a largest force above 0 N, got {self.expected_force}'
            )
