# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the batch and the tracking estimator, and the data of a fit.

`Problem` has block statistics and baseline in one object.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.estimation.blocks import BlockStatistics
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.history_law import TemporalSummation
from rpms_ros.identification.model.recruitment import PARAMETERS, SUMMATION
from rpms_ros.identification.model.settings import BOUNDS, SIMULATION_START, check_start
from rpms_ros.muscle.recruitment import SMALLEST_SEPARATION, RateRecruitment, RecruitmentParameters
from rpms_ros.pulses import FloatArray


class Baseline(NamedTuple):
    """Straight baseline through its values at two knots, which are linear unknowns.

    Attributes
    ----------
    origin_ns, spacing_ns : int
        First knot and distance of the second [ns].
    """

    origin_ns: int
    spacing_ns: int


class Prior(NamedTuple):
    """Prior and bounds.

    Attributes
    ----------
    mean, deviation : ndarray (4,)
        Weak physiological prior of theta, alpha as logarithms.
    lower, upper : ndarray (4,)
        Bounds of theta.
    separation : float
        u_sat is at least this far above u_thr.
    """

    mean: FloatArray
    deviation: FloatArray
    lower: FloatArray
    upper: FloatArray
    separation: float


class Problem(NamedTuple):
    """A separable least-squares problem over the blocks of a recording.

    Attributes
    ----------
    blocks : BlockStatistics
        Sums over the samples.
    first : int
        Blocks before this one only advance the state and are not fitted.
    input_gain : float
        Increase of each state by a pulse of recruitment 1 [s^-1/2].
    baseline : Baseline
        Baseline of the predictions.
    """

    blocks: BlockStatistics
    first: int
    input_gain: float
    baseline: Baseline


# Further starts of a fit: alternate corners of the range of u_thr, u_sat and alpha_sat.
_CORNERS = ((0.40, 0.80, 3.0), (0.40, 1.00, 12.0), (0.65, 0.80, 12.0), (0.65, 1.00, 3.0))
# kappa of people is between that of a sum of twitches, 0, and that of Eq. (10), 1.
_OF_PEOPLE, _OF_A_LAW = (0.5, 0.5), (1.0, 0.05)
PRIOR = Prior(
    mean=np.array([0.60, 0.90, math.log(8.0), math.log(5.5)]),
    deviation=np.array([0.2, 0.2, 0.8, 0.25]),
    lower=np.array([*(low for low, _ in BOUNDS.values()), 2.0]),
    upper=np.array([*(high for _, high in BOUNDS.values()), 15.0]),
    separation=SMALLEST_SEPARATION,
)
"""Of people: means of the paper's Tables 3 and 6, deviations about twice their spread."""


@dataclass(frozen=True)
class ProjectionSettings:
    """Model and numerics of `batch`, `tracking` and `recursive` (`PaperSettings`: the paper's).

    Attributes
    ----------
    basis : LaguerreBasis
        Functions of the response, behind the latency.
    start : RecruitmentParameters
        Start of the nonlinear parameters.
    deviation : bool
        Whether the recruitment may deviate from the arctangents of the paper.
    by_rate : RateRecruitment or None
        How the weight of a pulse depends on the interval to the one before it (Eq. 10); None:
        all weights are 1.
    history : TemporalSummation or None
        How the weight of a pulse depends on all pulses before it, instead of `by_rate`.
    choose_basis : bool
        Batch: choose latency and time constant by the samples; the search begins at `basis`.
    confidence : float
        Level of the intervals.

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    basis: LaguerreBasis = field(default_factory=lambda: LaguerreBasis(7, 38e-3, 8e-3))
    start: RecruitmentParameters = SIMULATION_START
    deviation: bool = True
    by_rate: RateRecruitment | None = field(default_factory=RateRecruitment)
    history: TemporalSummation | None = None
    choose_basis: bool = False
    confidence: float = 0.95

    def __post_init__(self) -> None:
        if not 0 < self.confidence < 1:
            raise IdentificationError(f'expected 0 < confidence < 1, got {self.confidence}')
        check_start(self.start)

    def starts(self, sines: int) -> list[FloatArray]:
        """Return the starts, theta (4 + sines + 2,) each, of a fit that tries several."""
        alpha_thr = self.start.alpha_thr
        found = []
        for start in (self.start[:3], *_CORNERS):
            theta = np.zeros(PARAMETERS + sines + 2)
            theta[:PARAMETERS], theta[SUMMATION] = [*start, alpha_thr], self.summation[0]
            found.append(theta)
        return found

    @property
    def summation(self) -> tuple[float, float]:
        """Mean and standard deviation of kappa: a history law was measured, Eq. (10) elsewhere."""
        return _OF_PEOPLE if self.history is None else _OF_A_LAW
