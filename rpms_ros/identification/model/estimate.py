# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The estimate of a muscle, and the interface of estimators."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Protocol, runtime_checkable

import numpy as np

from rpms_ros.muscle.recruitment import (
    PARAMETER_NAMES,
    RecruitmentParameters,
    identified_recruitment,
)
from rpms_ros.pulses import BoolArray, FloatArray, IntArray

NOT_INFORMED = 0
INFORMED = 1
CONVERGED = 2

CURVE_INTENSITY: FloatArray = np.linspace(0.0, 1.0, 101)
CURVE_INTENSITY.flags.writeable = False
DEFAULT_RATE = 20.0
LOWEST_RATE, HIGHEST_RATE = 0.1, 1000.0
"""Rates for which a recruitment curve may be stated [Hz]; nobody is stimulated beyond."""
# Intensities that differ by less than this show one point of the curve, not its course.
SMALLEST_INTENSITY_SPAN = 0.05


def _empty() -> FloatArray:
    return np.empty(0)


@dataclass(frozen=True)
class Estimate:
    """Estimate of a muscle; arrays that an estimator does not offer are empty.

    Attributes
    ----------
    stamp_ns : int
        Time of the newest force sample that was processed [ns].
    estimator : str
        Name of the algorithm.
    nonlinear_names, nonlinear : tuple of str, ndarray (p,)
        Nonlinear parameters.
    nonlinear_covariance : ndarray (p, p)
        Their covariance.
    nonlinear_identifiability : ndarray of int (p,)
        `NOT_INFORMED`, `INFORMED` or `CONVERGED`.
    linear_names, linear : tuple of str, ndarray (n,)
        Linear parameters.  ``basis_*``: [N s^(1/2)] with Laguerre functions, which are in
        s^(-1/2), [N] with the paper's distorted sines; ``baseline_*``: [N].
    repetition_rate : float
        Rate for which the curve is stated [Hz].
    curve_intensity, curve_force, curve_lower, curve_upper : ndarray (intensities,)
        Recruitment curve K rho(u) as steady mean force [N]; the force is empty if the data show
        one intensity only.
    response_time, response_force, response_lower, response_upper : ndarray (times,)
        Response to one pulse at full intensity [s], [N].
    physiology_names, physiology, physiology_lower, physiology_upper
        Parameters of the twitch fitted to the response; the unit is part of the name.
    confidence : float
        Level of the intervals; 0 if there are none.
    output_error : float
        A-priori error over the last second, L2, relative to the force.
    damping, condition_number : float
        State of the Levenberg-Marquardt step.
    samples, pulses : int
        How many were used.
    faults : mapping of str to int
        Faults of the data since the start, and how often each.
    doubts : tuple of str
        Faults that affect so many samples that the numbers above may be wrong by more than their
        intervals; empty if there are none.
    rate_names, rate, rate_lower, rate_upper : tuple of str, ndarray (rates,)
        Slow changes, per minute; the unit is part of the name.
    changes : int
        Sudden changes of the muscle that were found since the start.
    change_kinds, change_ago : tuple of str, ndarray (newest changes,)
        What changed, and how long before the stamp [s]; the newest last.  There may be fewer than
        `changes`: only the newest are kept, and what was before a jump of the clock is forgotten.
    disturbance, disturbance_deviation : float
        Force that the stimulation does not cause, and its standard deviation [N].
    reasons : tuple of str
        Why intervals are wide, a parameter is not informed or the response not seen, in sentences.
    unit : str
        Of every force above: ``N``, or ``N m`` where the sensor measures a torque.
    """

    stamp_ns: int
    estimator: str
    nonlinear_names: tuple[str, ...]
    nonlinear: FloatArray
    linear_names: tuple[str, ...]
    linear: FloatArray
    repetition_rate: float
    curve_intensity: FloatArray
    curve_force: FloatArray
    response_time: FloatArray
    response_force: FloatArray
    output_error: float
    samples: int
    pulses: int
    damping: float = 0.0
    condition_number: float = 0.0
    nonlinear_covariance: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    nonlinear_identifiability: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    curve_lower: FloatArray = field(default_factory=_empty)
    curve_upper: FloatArray = field(default_factory=_empty)
    response_lower: FloatArray = field(default_factory=_empty)
    response_upper: FloatArray = field(default_factory=_empty)
    physiology_names: tuple[str, ...] = ()
    physiology: FloatArray = field(default_factory=_empty)
    physiology_lower: FloatArray = field(default_factory=_empty)
    physiology_upper: FloatArray = field(default_factory=_empty)
    confidence: float = 0.0
    faults: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    doubts: tuple[str, ...] = ()
    rate_names: tuple[str, ...] = ()
    rate: FloatArray = field(default_factory=_empty)
    rate_lower: FloatArray = field(default_factory=_empty)
    rate_upper: FloatArray = field(default_factory=_empty)
    changes: int = 0
    change_kinds: tuple[str, ...] = ()
    change_ago: FloatArray = field(default_factory=_empty)
    disturbance: float = 0.0
    disturbance_deviation: float = 0.0
    reasons: tuple[str, ...] = ()
    unit: str = 'N'

    def relative_recruitment(self, intensity: FloatArray) -> FloatArray:
        """Return rho(u) / rho(1) of intensities (n,), NaN where the estimate cannot tell."""
        if self.curve_known and self.curve_force[-1]:
            share = np.interp(intensity, self.curve_intensity, self.curve_force)
            return share / float(self.curve_force[-1])
        if self.nonlinear_names != PARAMETER_NAMES:
            return np.full(len(intensity), np.nan)
        parameters = RecruitmentParameters(*self.nonlinear.tolist())
        full = float(identified_recruitment(parameters, 1.0))
        share = identified_recruitment(parameters, intensity)
        return share / full if full else np.full(len(intensity), np.nan)

    @property
    def curve_known(self) -> bool:
        """Whether the data determine the recruitment curve."""
        return len(self.curve_force) > 0


class Estimator(Protocol):
    """Interface of every estimator, on line and off line."""

    @property
    def name(self) -> str:
        """Name of the algorithm, as in `Estimate.estimator`."""

    @property
    def memory(self) -> float:
        """Longest time for which a pulse acts on the model's output [s]."""

    @property
    def on_line(self) -> bool:
        """Whether the cost of an estimate does not grow with the length of the session."""

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending, none before one that was already added [ns, 1]."""

    def forget_pulses(self) -> None:
        """Drop the pulses that still act: the clock has jumped, their lag is unknown."""

    def update(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        """Learn from samples (samples,), ascending, none before one that was already given.

        Every pulse up to the last stamp must have been added.  Samples that are not usable are
        predicted only.  Returns the a-priori prediction of each (samples,) [N].  However the
        samples are cut into blocks, the result is the same to the bit.
        """

    def estimate(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Return the present estimate."""


@runtime_checkable
class PredictingEstimator(Estimator, Protocol):
    """An estimator that predicts samples before it sees them, so that outliers are found."""

    def predict(self, stamp_ns: IntArray) -> FloatArray:
        """Return the prediction of the next samples (samples,), ascending [N].

        The state does not change; every pulse up to the last stamp has been added.
        """


def recruiting_range(intensity: FloatArray, known: tuple[float, float]) -> tuple[float, float]:
    """Return the least and the highest intensity above 0 of some pulses (pulses,) and of `known`.

    Recruitment at intensity 0 is 0 for all parameters, so it does not inform about them.
    """
    low, high = known
    recruiting = intensity[intensity > 0.0]
    return float(recruiting.min(initial=low)), float(recruiting.max(initial=high))
