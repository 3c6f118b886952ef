# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The fit of a window: present muscle, its slow change and the disturbance.

The standard deviations of the slow change and of the disturbance are not settings.  Each has a
scale on a coarse grid; at every step the present value is compared with its neighbours, and that
of the disturbance with the one of an effort, by the evidence, the probability of the samples with
everything else integrated out (Laplace's approximation, exact except for theta).
"""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.estimation.blocks import ring_order
from rpms_ros.identification.estimation.estimate_builder import Uncertainty
from rpms_ros.identification.estimation.prior import (
    ROUNDING,
    Terms,
    WindowPrior,
    add_prior,
    scaled_inverse,
    walk_information,
)
from rpms_ros.identification.estimation.settings import Problem
from rpms_ros.identification.estimation.window_equations import (
    MOVING,
    Equations,
    Intervals,
    Origin,
    Point,
    Reduced,
    Roughness,
    ages_in_knots,
    assembled,
    at_ages,
    condensed,
    disturbance_at,
    eliminated,
    log_determinant_of_prior,
    shares_of_prior,
    steady,
    time_scaled,
    unknowns_of,
)
from rpms_ros.identification.model.recruitment import (
    MOST_SINES,
    PARAMETERS,
    SUMMATION,
    coordinates,
    deviation_variance,
    from_coordinates,
)
from rpms_ros.pulses import FloatArray, IntArray

INTERVAL_NS = 125_000_000
"""Length of an interval of the disturbance [ns]."""
KNOT_INTERVALS = 40
"""Distance of two knots of the slow change, in intervals: the unit of time of its prior."""
# The model's error is at least this share of the force's mean square, for so many samples.
MODEL_ERROR = 1e-4
MODEL_ERROR_SAMPLES = 200.0


@numba.njit(cache=True)
def _left(
    intervals: Intervals,
    theta: FloatArray,
    thresholds: FloatArray,
    point: Point,
    gain: FloatArray,
    delay: FloatArray,
    levels: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return what the linear model after a step leaves: scores (intervals, columns) and squares.

    `theta` is the step of theta now, `point` is after it; what is added to it for u_thr and u_sat,
    gain and logarithm of the relative time constant have a value for each interval.
    """
    count, columns = intervals.right.shape
    nonlinear, functions = len(theta), len(point.linear)
    scores = np.zeros((count, columns))
    squares = np.zeros(count)
    coefficients = np.zeros(columns)
    for index in range(count):
        coefficients[:nonlinear] = gain[index] * theta
        for place in range(len(thresholds)):
            coefficients[place] += gain[index] * thresholds[place, index]
        response = time_scaled(point.linear, delay[index])
        for function in range(functions):
            coefficients[nonlinear + function] = gain[index] * response[function]
        coefficients[columns - 2] = levels[index]
        coefficients[columns - 1] = levels[index + 1]
        right, left = intervals.right[index], scores[index]
        left[:] = right
        for row in range(columns):
            for column in range(columns):
                left[column] -= coefficients[row] * intervals.gram[index, row, column]
        squares[index] = intervals.energy[index] - coefficients @ (right + left)
    return scores, squares


# Standard deviation of the disturbance's second difference over an interval, as a share of the
# force: from a sensor that drifts to a voluntary effort.
LIVELINESS: FloatArray = 10.0 ** np.arange(-6.0, -0.4, 0.5)
# Of its increment over an interval, the first practically none: what moves all the time, as heart
# and breath do, need not wander.
INCREMENTS: FloatArray = np.concatenate(([1e3], 10.0 ** np.arange(-0.5, -5.1, -0.5)))
# Of its distance from its mean: noise of a sensor that grows towards low frequencies wanders, but
# not far.
EXTENTS: FloatArray = np.concatenate(([np.inf], 10.0 ** np.arange(-0.5, -3.1, -0.5)))
# They have one from this place in `LIVELINESS` on; below it a sensor may drift.
_LEAST_MOVING = 8
# Change of force and time constant (relative) and of thresholds over the distance of two knots.
CHANGES: FloatArray = np.concatenate(([1e-5], 10.0 ** np.arange(-4.0, -0.9, 0.5)))
DRIFTS: FloatArray = np.concatenate(([1e-6], 10.0 ** np.arange(-4.0, -1.4, 0.5)))
# Size of the deviation of the recruitment from the arctangents, the first practically none, and
# its length in units of the intensity.
SIZES: FloatArray = np.concatenate(([1e-5], 10.0 ** np.arange(-3.0, 0.1, 0.5)))
LENGTHS: FloatArray = np.array([0.08, 0.16, 0.32])
# Standard deviation of the level of a knot, as a multiple of the force: practically no prior.
_LEVEL = 30.0
# A response is not quite a sum of the functions, and a change not quite linear between its knots:
# deviation of each coefficient as a share of their length, and of the force as a share of its
# change over a distance of knots.
_BASIS_ERROR, _BETWEEN_KNOTS = 2e-4, 0.03
_LARGEST_STEP: FloatArray = np.array([0.1, 0.1, 0.7, 0.5])
_LARGEST_SLOWING_STEP = 0.05
_RIDGE = 1e-2
_MOST_INFLATION = 3.0
# Above this factor neighbouring residuals are more alike than a muscle of the model leaves them,
# which is 1.1 at most once it is known: a lively disturbance then takes up what is the muscle's.
_DOUBTED_INFLATION = 1.5
# Standard deviations and intervals from which the gain is said to follow the disturbance,
# and samples in each.
_SURE_SWING, _LEAST_SWING_INTERVALS, _LEAST_RIPPLE = 5.0, 80, 8
# An event is intervals in which the muscle leaves so many times the mean square of the median; so
# many intervals with those after it, with gaps in between of less than so many, and all of them
# this share of the window at most.
_UNEXPLAINED = 2.5
_LONGEST_EVENT, _AFTER, _BETWEEN, _MOST_EVENTS = 8, 3, 3, 0.2
# A pulse may be missing where two are so many times as far apart as usual, and fewer than this
# share are.
GAP, RARE = 1.5, 0.1
# That is a pause; what is missing acts until so long after the next one [ns]; with it no more than
# this share of the window is left out.
_PAUSE, _LASTS_NS, _MOST_LEFT_OUT = 4.0, 400_000_000, 0.4
NO_EVENTS: IntArray = np.zeros(0, dtype=np.int64)
# A step that gains less than this is as good as exact [nat]; a longer one is tried so often, with
# a damping that rises from trial to trial and falls from step to step.
_CERTAIN, _TRIALS = 2.0, 5
# Share of the largest step, and step of c, within which the model is linear, along a valley of the
# cost too.
_NEAR, _STRAIGHT = 0.02, 1e-3
_LEAST_DAMPING, _RISES, _FALLS = 1e-7, 30.0, 0.1
# A response that has changed by no more than this share leaves the equations as they are.
_SAME = 1e-3
LEAST_ENERGY = 1e-18
# Standard deviations by which w has to differ from zero to count as known.
_SHOWN = 8.0
# Scales whose evidence is this much smaller do not count [nat].
_LIKELY = 4.0
# Degrees of freedom of the Student distributions of increments and second differences of the
# disturbance: the first are alike but for an effort, the second mostly small and some large.
_FREEDOM: FloatArray = np.array([[4.0], [1.0]])
# An effort begins from one step to the next: it is so many places livelier than a drift.
_EFFORT = 6
# One explains samples so much better [nat]; what is less may be a latency that jitters.
_SURE = 100.0
# Variance of unknowns that could not be solved for.
_UNKNOWN = 1e12
# Squares of both, relative to their variances, that are assumed where none were estimated yet.
_UNKNOWN_RATIO: FloatArray = np.array([[1.0], [25.0]])


class StartLevels(NamedTuple):
    """Prior of the first two knots of the disturbance: mean and standard deviation [N]."""

    levels: FloatArray
    deviation: FloatArray


@dataclass(frozen=True)
class Window:
    """Samples of a fit.

    Attributes
    ----------
    first_ns, now_ns : int
        Beginning of the first block and newest sample [ns].
    length_ns : int
        Length of an interval [ns].
    knots : ndarray (1 + knots,)
        When an interval would show the muscle of now, and the knots of its past, newest first, in
        intervals.  Force acts some time after its pulse: the newest samples show an older muscle.
    pauses : tuple of bool (knots,)
        Whether the muscle rested between a knot and the next newer one.
    origin : Origin
        The change of the muscle at which the window begins, if there was one.
    start : StartLevels or None
        Prior of the disturbance at the beginning.
    liveliest : int
        Last index in `LIVELINESS` that the disturbance may have.
    changes : bool
        Whether the muscle may change.
    """

    first_ns: int
    now_ns: int
    length_ns: int
    knots: FloatArray
    pauses: tuple[bool, ...]
    origin: Origin
    start: StartLevels | None = None
    liveliest: int = len(LIVELINESS) - 1
    changes: bool = True

    @property
    def without_past(self) -> 'Window':
        """The same without knots."""
        return replace(self, knots=self.knots[:1], pauses=())

    def walks(self) -> FloatArray:
        """Return the priors of the slow change of force and of thresholds, see `Terms`."""
        lengths = tuple((-np.diff(self.knots) / KNOT_INTERVALS).tolist())
        return walk_information(lengths, self.pauses)


@dataclass(frozen=True)
class Scales:
    """Indices in `LIVELINESS`, `INCREMENTS`, `EXTENTS`, `CHANGES`, `DRIFTS`, `SIZES`, `LENGTHS`.

    Three of the disturbance, three of slow change, two of the deviation.
    """

    disturbance: int = 2
    increment: int = 0
    extent: int = 0
    gain: int = 0
    slowing: int = 0
    thresholds: int = 0
    size: int = 0
    length: int = 1

    @property
    def lively(self) -> int:
        """Place in `LIVELINESS` of second differences, where the others bound them too."""
        bound = min(INCREMENTS[self.increment], EXTENTS[self.extent])
        return min(self.disturbance, int(np.searchsorted(LIVELINESS, 2.0 * bound)))


@dataclass
class WindowFit:
    """State of the fit of a window.

    Attributes
    ----------
    point : Point
        The present muscle and its slow change.
    levels : ndarray (knots,)
        Disturbance at the ends of the intervals [N], the newest last.
    covariance : ndarray (unknowns, unknowns)
        Of x, alpha as logarithms.
    moved : ndarray (4,)
        Last step of theta, alpha as logarithms.
    scales : Scales
        Scales with the largest evidence.
    variance : float
        Variance of the residuals [N^2].
    inflation : float
        Factor on the variance by the correlation of neighbouring residuals.
    first : int
        Number of the interval whose beginning is the first knot.
    level_deviation : float
        Standard deviation of the newest knot [N].
    failures : int
        Steps that could not be solved.
    evidence : float
        Of the last step [nat].
    misfit : float
        Mean square of what the last step leaves, against the variance.
    likelihood : float
        Logarithm of that of the samples at the last step's x, the disturbance integrated out.
    penalty : float
        By how much the evidence, which counts every x, is below the likelihood [nat].
    most_inflation : float
        Limit of `inflation` where samples are weighted by it.
    colour : float
        By how much the noise of the sensor is stronger where the muscle moves than in the mean.
    damping : float
        Of the next step of theta.
    residual_spread : float
        Mean of (sum of residuals)^2 / samples in the intervals [N^2].
    swing : float
        By how much the gain follows the disturbance, see `gain_swing`.
    left_out : ndarray of int64 (events,)
        Numbers of the intervals that are not learnt from, see `short_events`.
    known_at : Point or None
        Where the covariance is that of the linearised equations; None: at `point`.
    """

    point: Point
    levels: FloatArray
    covariance: FloatArray
    moved: FloatArray
    scales: Scales = Scales()
    variance: float = 0.0
    inflation: float = 1.0
    first: int = 0
    level_deviation: float = 0.0
    failures: int = 0
    evidence: float = -math.inf
    misfit: float = 1.0
    likelihood: float = -math.inf
    penalty: float = 0.0
    most_inflation: float = _MOST_INFLATION
    colour: float = 1.0
    damping: float = 0.0
    residual_spread: float = 0.0
    swing: float = 0.0
    left_out: IntArray = field(default_factory=lambda: NO_EVENTS)
    known_at: Point | None = None

    @property
    def weighting_variance(self) -> float:
        """Variance that weights the samples [N^2].

        The factor of correlation is limited: if residuals are correlated because a scale is too
        small, the samples must keep enough weight to show it.
        """
        return self.variance * max(min(self.inflation, self.most_inflation), self.colour)

    @property
    def residuals_alike(self) -> bool:
        """Whether neighbouring residuals are more alike than a muscle of the model leaves them."""
        return self.inflation > _DOUBTED_INFLATION * self.colour

    @property
    def shows_response(self) -> bool:
        """Whether the response differs significantly from zero."""
        first = len(self.point.theta)
        part = slice(first, first + len(self.point.linear))
        uncertain = float(np.sum(np.diag(self.covariance)[part]))
        size = float(self.point.linear @ self.point.linear)
        return self.variance > 0.0 and uncertain > 0.0 and size > _SHOWN**2 * uncertain

    def uncertainty(self, confidence: float, spread: FloatArray) -> Uncertainty | None:
        """Return the uncertainty of theta and w, None before the first fit.

        `spread` (functions, functions) is that of w among likely bases, relative to its length.
        """
        if self.variance <= 0.0 or not self.covariance.any():
            return None
        linear = self.point.linear
        first = len(self.point.theta)
        joint = first + len(linear)
        covariance = self.covariance[:joint, :joint].copy()
        rest = covariance[first:, first:]
        newest = float(self.point.gain[0]) if len(self.point.gain) else 0.0
        rest += (_BETWEEN_KNOTS * newest) ** 2 * np.outer(linear, linear)
        rest += float(linear @ linear) * (_BASIS_ERROR**2 * np.eye(len(linear)) + spread)
        here = self.known_at or self.point
        return Uncertainty(covariance, confidence, here.theta[: SUMMATION.start], here.linear)


def fresh_fit(theta: FloatArray, functions: int) -> WindowFit:
    """Return a fit without data."""
    point = steady(theta, np.zeros(functions))
    unknowns = len(theta) + functions
    return WindowFit(point, np.zeros(2), np.zeros((unknowns, unknowns)), np.ones(len(theta)))


class Linearised:
    """A window linearised at a point, with its priors."""

    def __init__(
        self, problem: Problem, fit: WindowFit, knowledge: WindowPrior, window: Window
    ) -> None:
        point = fit.point.at_times(window.knots)
        self.problem, self.point, self.knowledge, self.window = problem, point, knowledge, window
        span = window.first_ns, window.now_ns, window.length_ns, window.origin
        # that of the intervals which are left out, too
        self.every: Intervals = condensed(problem, point, *span)
        first, count = int(self.every.first[0]), len(self.every.samples)
        self.intervals = self.every.without(fit.left_out - first)
        self.differences = _differences(fit, first, count + 1)
        self.ages = ages_in_knots(window.knots, first, count)
        self.equations: Equations = assembled(self.intervals, point, self.ages)
        self.samples = float(self.intervals.samples.sum())
        self.power = float(self.intervals.energy.sum()) / max(self.samples, 1.0)
        # w is solvable where nothing has been stimulated.  An earlier result makes it so, too, and
        # would be outweighed where there is hardly any force
        ridge = 0.0 if knowledge.has_result else _RIDGE / (self.power + LEAST_ENERGY)
        self.terms: Terms = knowledge.terms_at(point, ridge, window.walks())

    def reduced(self, variance: float, scales: Scales) -> Reduced:
        """Eliminate the disturbance with its three scales."""
        force = math.sqrt(self.power) + 1e-9
        level = np.full(self.differences.shape[1], 1.0 / (_LEVEL * force) ** 2)
        about = np.zeros(len(level))
        if self.window.start is not None:
            level[:2] = 1.0 / self.window.start.deviation**2
            about[:2] = self.window.start.levels
        rough, logarithm = self._roughness(scales, force, level)
        reduced = eliminated(self.equations, variance, rough, level, about)
        reduced.evidence[0] += logarithm
        return reduced

    def _roughness(
        self, scales: Scales, force: float, level: FloatArray
    ) -> tuple[Roughness, float]:
        """Return the prior of the course, and the logarithm that it gives to the evidence.

        Differences have Student distributions, replaced by normal ones with the most likely
        precision for the last values, which is a lower bound of the evidence.
        """
        widths = INCREMENTS[scales.increment], LIVELINESS[scales.disturbance]
        deviation = force * np.array(widths)[:, None]
        ratio = np.square(self.differences / deviation)
        ratio = np.where(np.isnan(ratio), _UNKNOWN_RATIO, ratio)
        precision = (_FREEDOM + 1.0) / (_FREEDOM + ratio)
        extent = float((EXTENTS[scales.extent] * force) ** -2.0)
        moves = scales.increment > 0 and self.window.start is None
        if moves:
            first, second = precision / deviation**2
            shares, _ = shares_of_prior(Roughness(first, second, extent))
            precision = (_FREEDOM + shares) / (_FREEDOM + ratio)
        first, second = precision / deviation**2
        # twice the logarithm of their densities, 0 where a precision is 1
        bound = _FREEDOM * (np.log(precision) - precision + 1.0)
        # without increments offset and slope have the prior of `level` alone
        rough = Roughness(first if moves else np.zeros(len(level)), second, extent)
        student = bound[1, 1:-1].sum() + (bound[0, :-1].sum() if moves else 0.0)
        if extent > 0.0:
            logarithm = log_determinant_of_prior(rough, level)
        elif moves:
            logarithm = shares_of_prior(rough)[1] + math.log(level[0])
        else:
            logarithm = np.log(second[1:-1]).sum() + np.log(level[:2]).sum()
        return rough, 0.5 * float(logarithm + student)


class _Solution(NamedTuple):
    """A step of x from a point at given scales, with its evidence.

    Attributes
    ----------
    step, right : ndarray (unknowns,)
        Step, and minus half the gradient of the cost at the point.
    hessian : ndarray (unknowns, unknowns)
        Information.
    evidence, left : float
        Logarithm of the evidence, and cost after the step.
    here : float
        Cost at the point.
    reduced : Reduced
        Equations without the prior.
    nonlinear, moving : int
        Elements of theta, and of its slow change.
    """

    step: FloatArray
    right: FloatArray
    hessian: FloatArray
    evidence: float
    left: float
    here: float
    reduced: Reduced
    nonlinear: int
    moving: int

    def with_cost(self, left: float) -> '_Solution':
        """Return the same with the exact cost after the step."""
        return self._replace(left=left, evidence=self.evidence - 0.5 * (left - self.left))

    def damped(self, damping: float) -> FloatArray:
        """Return the Levenberg-Marquardt step with the recruitment, now and before, damped.

        Not the weights of pulses, kappa: arctangents and deviation can stand in for each other,
        and where damping holds them in their valley it would hold kappa where it began.
        """
        hessian = self.hessian.copy()
        last = len(hessian)
        place = np.r_[: self.nonlinear + SUMMATION.start, last - self.moving : last]
        hessian[place, place] *= 1.0 + damping
        return _solved(hessian, self.right)[0]

    def projected(self) -> tuple[float, FloatArray]:
        """Return the cost with theta as it goes and all else at its best, and the step to it."""
        step, rest = np.zeros_like(self.step), slice(self.nonlinear, len(self.step) - self.moving)
        step[rest], gained, _ = _solved(
            np.ascontiguousarray(self.hessian[rest, rest]), self.right[rest]
        )
        return self.here - gained, step


# Prior variances of c by places in `SIZES` and `LENGTHS`.
DEVIATION_VARIANCES = {
    (size, length): deviation_variance(SIZES[size], LENGTHS[length])
    for size in range(len(SIZES))
    for length in range(len(LENGTHS))
}


def beyond_the_sines(scales: Scales, sines: int) -> float:
    """Return the standard deviation of a recruitment by what these sines do not show of it.

    As a share of the recruitment at full intensity.  Their variances fall with the sixth power of
    the frequency, so all beyond the last have a fifth of the number of sines times its own.
    """
    last = DEVIATION_VARIANCES[scales.size, scales.length][sines - 1]
    return math.sqrt(0.5 * sines / 5.0 * last)


_NO_PRIOR: FloatArray = np.full(MOST_SINES, np.inf)


def _solution(at: Linearised, reduced: Reduced, scales: Scales) -> _Solution | None:
    """Solve for the step; None if the equations are not positive."""
    drift = DRIFTS[scales.thresholds]
    widths = np.array([CHANGES[scales.gain], CHANGES[scales.slowing], drift, drift])
    # an earlier result holds the prior of the deviation already
    earlier = at.knowledge.has_result
    variance = _NO_PRIOR if earlier else DEVIATION_VARIANCES[scales.size, scales.length]
    hessian, right = reduced.matrix.copy(), reduced.right.copy()
    try:
        cost, logarithm = add_prior(at.terms, widths, variance, hessian, right)
        step, gained, determinant = _solved(hessian, right)
    except np.linalg.LinAlgError:
        return None
    here = float(reduced.cost[0]) + cost
    left = here - gained
    evidence = -0.5 * (left + determinant - logarithm) + float(reduced.evidence[0])
    sizes = len(at.point.theta), at.point.thresholds.size
    return _Solution(step, right, hessian, evidence, left, here, reduced, *sizes)


@numba.njit(cache=True)
def _solved(hessian: FloatArray, right: FloatArray) -> tuple[FloatArray, float, float]:
    """Return the solution (unknowns,), what it gains of the cost, and the log-determinant."""
    count = len(right)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    scaled = np.empty_like(hessian)
    for row in range(count):
        for column in range(count):
            scaled[row, column] = scale[row] * hessian[row, column] * scale[column]
        scaled[row, row] += ROUNDING
    factor = np.linalg.cholesky(scaled)
    step = scale * right
    determinant = 0.0
    for row in range(count):
        for column in range(row):
            step[row] -= factor[row, column] * step[column]
        step[row] /= factor[row, row]
        determinant += 2.0 * (np.log(factor[row, row]) - np.log(scale[row]))
    gained = 0.0
    for row in range(count):
        gained += step[row] ** 2
    for row in range(count - 1, -1, -1):
        for below in range(row + 1, count):
            step[row] -= factor[below, row] * step[below]
        step[row] /= factor[row, row]
    return scale * step, gained, determinant


def _best_disturbance(
    at: Linearised, variance: float, scales: Scales
) -> tuple[Scales, _Solution | None, list[_Solution]]:
    """Return the scales with the best ones of the disturbance, see `_best_scales`."""
    last = {'disturbance': at.window.liveliest, 'increment': 0, 'extent': 0}
    if scales.disturbance >= _LEAST_MOVING:
        last |= {'increment': len(INCREMENTS) - 1, 'extent': len(EXTENTS) - 1}
    scales = best = replace(scales, **{one: min(getattr(scales, one), last[one]) for one in last})
    solution = _solution(at, at.reduced(variance, scales), scales)
    tried = [] if solution is None else [solution]
    moves = [({name: away}, 0.0) for name in last for away in (-1, 1)]
    # of 1/f noise each alone is best where it is
    moves += [({'disturbance': away, 'increment': away}, 0.0) for away in (-1, 1)]
    # where one muscle explains all, a sensor's filter would pass for an effort
    moves += [({'disturbance': _EFFORT}, _SURE)] if at.window.changes else []
    for move, least in moves:
        places = {name: getattr(scales, name) + away for name, away in move.items()}
        trial = replace(best, **places)
        if trial == best or not all(0 <= place <= last[name] for name, place in places.items()):
            continue
        other = _solution(at, at.reduced(variance, trial), trial)
        if other is None:
            continue
        better = solution is None or other.evidence > solution.evidence + least
        # of an effort that is not, the mean over likely scales has nothing either
        if better or not least:
            tried.append(other)
        if better:
            best, solution = trial, other
    return best, solution, tried


def _best_scales(at: Linearised, fit: WindowFit) -> tuple[Scales, _Solution, list[_Solution]]:
    """Return the scales with the largest evidence among the neighbours of the present ones.

    With the solution, and all solutions tried.
    """
    best, solution, tried = _best_disturbance(at, fit.weighting_variance, fit.scales)
    if solution is None:
        raise np.linalg.LinAlgError
    grids = [('gain', CHANGES), ('slowing', CHANGES), ('thresholds', DRIFTS)]
    grids = grids if at.window.changes else []
    if at.knowledge.any_shape and not at.knowledge.has_result:
        grids += [('size', SIZES), ('length', LENGTHS)]
    for name, grid in grids:
        for move in (-1, 1):
            place = getattr(best, name) + move
            # what begins suddenly is no drift
            sudden = name == 'thresholds' and move > 0 and fit.residuals_alike
            if sudden or not 0 <= place < len(grid):
                continue
            trial = replace(best, **{name: place})
            other = _solution(at, solution.reduced, trial)
            tried += [] if other is None else [other]
            if other is not None and other.evidence > solution.evidence:
                best, solution = trial, other
    return best, solution, tried


def _mixed_covariance(likely: list[tuple[float, _Solution]], mean: FloatArray) -> FloatArray:
    """Return the covariance of x over likely scales, whose steps have a mean (unknowns,)."""
    covariance = np.zeros((len(mean), len(mean)))
    for share, one in likely:
        away = one.step - mean
        covariance += share * (scaled_inverse(one.hessian) + np.outer(away, away))
    return covariance


def gauss_newton_steps(
    problem: Problem, fit: WindowFit, knowledge: WindowPrior, window: Window, steps: int
) -> Linearised | None:
    """Take up to so many steps; scales and variance follow the samples.

    Returns
    -------
    Linearised or None
        Where the last step began; None if there was no sample, or a step could not be solved.
    """
    at = after = None
    for _ in range(steps):
        at = after or Linearised(problem, fit, knowledge, window)
        if at.samples == 0.0:
            return None
        if fit.variance == 0.0:
            fit.variance = at.power * 0.01 + LEAST_ENERGY
        try:
            fit.scales, solution, tried = _best_scales(at, fit)
        except np.linalg.LinAlgError:
            fit.failures += 1
            # an older covariance would claim that these samples were understood
            fit.point, fit.covariance = at.point, _UNKNOWN * np.eye(unknowns_of(at.point))
            return None
        before = fit.variance
        after = _move(fit, at, solution, tried)
        settled = np.abs(fit.moved) < 0.05 * np.sqrt(np.diag(fit.covariance)[: len(fit.moved)])
        # a step that was refused is no end
        if fit.moved.any() and settled.all() and fit.variance > 0.5 * before:
            break
    return at


def steps_at_fixed_scales(
    problem: Problem, fit: WindowFit, knowledge: WindowPrior, window: Window, steps: int
) -> Linearised | None:
    """Take so many steps with the present scales and variance; see `gauss_newton_steps`."""
    at = None
    for _ in range(steps):
        at = Linearised(problem, fit, knowledge, window)
        if at.samples == 0.0:
            return None
        reduced = at.reduced(fit.weighting_variance, fit.scales)
        solution = _solution(at, reduced, fit.scales)
        if solution is None:
            return None
        covariance = scaled_inverse(solution.hessian)
        step = _limited(at, solution, solution.step)
        _accept(fit, at, solution, step, covariance)
    return at


def _relative(at: Linearised, step: FloatArray) -> FloatArray:
    """Return the move of the arctangents, now and before, relative to the largest (4 + n,)."""
    before = step[len(step) - at.point.thresholds.size :] / _LARGEST_STEP[0]
    relative: FloatArray = np.abs(np.append(step[:PARAMETERS] / _LARGEST_STEP, before))
    return relative


def _limited(at: Linearised, solution: _Solution, step: FloatArray) -> FloatArray:
    """Return a step (unknowns,) within the bounds and the range of a nearly linear model."""
    step = at.knowledge.bounded(at.point, step, solution.hessian)
    joint, knots = len(at.point.theta) + len(at.point.linear), len(at.point.gain)
    slowing = np.abs(step[joint + knots : joint + 2 * knots]) / _LARGEST_SLOWING_STEP
    return step / max(1.0, float(_relative(at, step).max()), float(slowing.max(initial=0.0)))


def _move(
    fit: WindowFit, at: Linearised, solution: _Solution, tried: list[_Solution]
) -> Linearised | None:
    """Take a step, damped until the cost with all but theta at its best does not rise.

    Arctangents, deviation and response can stand in for each other: where little is known, the
    step of the linearised equations leads far beyond the least cost.  The equations at the new
    theta are returned if they hold for the new response too: the next step begins with them.
    """
    # The evidence of neighbouring scales often differs little: with the best one alone the
    # estimate would jump from one to the next, and intervals would be too narrow.  It is among
    # them in any case: where its evidence is huge, the difference is lost in rounding.
    close = [one for one in tried if one.evidence >= solution.evidence - _LIKELY]
    weight = np.exp([one.evidence - solution.evidence for one in close])
    likely = list(zip(weight / weight.sum(), close, strict=True))
    step = mean = sum((share * one.step for share, one in likely), np.zeros_like(solution.step))
    certain = solution.here - solution.left < _CERTAIN
    if not certain and fit.damping > _LEAST_DAMPING:
        step = solution.damped(fit.damping)
    step = _limited(at, solution, step)
    near = _relative(at, step).max() < _NEAR
    bend = np.abs(step[PARAMETERS : len(at.point.theta) - 2]).max()
    # the step before was a mean over likely scales: of the prior of c a short one gains much
    if near and (certain or bend < _STRAIGHT):
        _accept(fit, at, solution, step, _mixed_covariance(likely, mean))
        _refresh_noise(fit, at)
        return None
    least, rest = solution.projected()
    for _ in range(_TRIALS):
        trial = replace(fit, point=moved(at.point, step))
        at.knowledge.separate(trial.point.theta)
        there = Linearised(at.problem, trial, at.knowledge, at.window)
        reduced = there.reduced(fit.weighting_variance, fit.scales)
        other = _solution(there, reduced, fit.scales)
        if other is not None:
            cost, rest_there = other.projected()
            if cost <= least + _CERTAIN:
                # of where it leads: along the valley, that of here has another direction
                covariance = scaled_inverse(other.hessian)
                _accept(fit, at, solution.with_cost(cost), step, covariance)
                fit.point = moved(trial.point, rest_there)
                fit.known_at = trial.point
                fit.levels = disturbance_at(reduced, rest_there)
                _refresh_noise(fit, there)
                fit.damping *= _FALLS
                first = len(trial.point.theta)
                changed = np.linalg.norm(rest_there[first:][: len(trial.point.linear)])
                if changed > _SAME * np.linalg.norm(trial.point.linear):
                    return None
                there.differences = _differences(fit, fit.first, there.differences.shape[1])
                return there
        fit.damping = min(max(fit.damping * _RISES, _LEAST_DAMPING), 1.0)
        step = _limited(at, solution, solution.damped(fit.damping))
    _accept(fit, at, solution.with_cost(least), rest, _mixed_covariance(likely, mean))
    _refresh_noise(fit, at)
    return None


def left_after(fit: WindowFit, at: Linearised) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what a step from `at` leaves, see `_left`, and the gain of each interval.

    Also of the intervals that are left out.
    """
    position = at.ages
    gain = 1.0 + at_ages(fit.point.gain, position)
    delay = at_ages(fit.point.slowing, position)
    theta = coordinates(fit.point.theta) - coordinates(at.point.theta)
    thresholds = np.array(
        [at_ages(step, position) for step in fit.point.thresholds - at.point.thresholds]
    )
    return *_left(at.every, theta, thresholds, fit.point, gain, delay, fit.levels), gain


def _refresh_noise(fit: WindowFit, at: Linearised) -> None:
    """Estimate anew, after a step from `at`, the variance of the residuals and how alike they are.

    Alike is a factor of at least 1 by which neighbouring ones tell less than independent ones.
    """
    intervals, local = at.intervals, len(at.point.theta) + len(at.point.linear)
    scores, squares, gain = left_after(fit, at)
    some = intervals.samples > 0.0
    total = max(float((some * squares).sum()), 0.0)
    freedom = max(at.samples - float(unknowns_of(at.point) + 1), 1.0) + MODEL_ERROR_SAMPLES
    floor = MODEL_ERROR_SAMPLES * MODEL_ERROR * at.power
    fit.variance = (total + floor) / freedom + LEAST_ENERGY
    sums = scores[some, local:].sum(axis=1)
    fit.residual_spread = float(np.mean(sums**2 / intervals.samples[some]))
    scores = (gain[:, None] * scores)[some, :local]
    scatter = scores.T @ scores
    for lag in (1, 2, 3):
        cross = scores[lag:].T @ scores[:-lag]
        scatter += (1.0 - lag / 4.0) * (cross + cross.T)
    steady = np.tensordot(gain**2, intervals.gram, 1)[:local, :local]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(steady), 1e-300))
    scaled = steady * np.outer(scale, scale) + 1e-6 * np.eye(local)
    ratio = np.trace(np.linalg.solve(scaled, scatter * np.outer(scale, scale)))
    fit.inflation = max(1.0, float(ratio) / (local * fit.variance))


def most_explained(variance: float, power: float) -> float:
    """Return the mean square that an interval leaves at most if it is explained [N^2].

    By the noise's variance and the mean square of the force [N^2].
    """
    return _UNEXPLAINED * max(variance, 0.25 * MODEL_ERROR * power + LEAST_ENERGY)


def short_events(fit: WindowFit, at: Linearised) -> IntArray:
    """Return the numbers of intervals (events,) that are not to be learnt from.

    The joint gives way for a moment, a pulse was not heard, somebody knocks: the muscle and a
    line for each interval explain what is before and after it.  After a step from `at`.  Where a
    pulse may be missing they are left out whatever they show: the fit may follow it.
    """
    samples = at.every.samples
    known = np.flatnonzero(samples >= _LEAST_RIPPLE)
    if not len(known):
        return NO_EVENTS
    scores, squares, _ = left_after(replace(fit, levels=np.zeros(len(samples) + 1)), at)
    hats, level = at.every.gram[known, -2:, -2:], scores[known, -2:, None]
    line = level * np.linalg.solve(hats + LEAST_ENERGY * np.eye(2), level)
    left = np.zeros(len(samples))
    left[known] = (squares[known] - line.sum(axis=(1, 2))) / samples[known]
    place = np.flatnonzero(left > most_explained(float(np.median(left[known])), at.power))
    # as many intervals of the window's length
    longest, after, gap = (
        max(1, round(many * INTERVAL_NS / at.window.length_ns))
        for many in (_LONGEST_EVENT, _AFTER, _BETWEEN)
    )
    runs = np.split(place, np.flatnonzero(np.diff(place) > gap) + 1)
    events = (
        np.arange(run[0] - 1, run[-1] + 1 + after)
        for run in runs
        if len(run) and run[-1] - run[0] < longest
    )
    first = int(at.every.first[0])
    numbers = first + np.unique(np.concatenate((NO_EVENTS, *events)))
    numbers = numbers if len(numbers) <= _MOST_EVENTS * len(known) else NO_EVENTS
    missing = _without_a_pulse(at.problem, at.window.length_ns)
    both = np.union1d(numbers, missing[(missing >= first) & (missing < first + len(samples))])
    return both if len(both) <= _MOST_LEFT_OUT * len(known) else numbers


def _without_a_pulse(problem: Problem, length_ns: int) -> IntArray:
    """Return the numbers of intervals (intervals,) in which a pulse may act that was not heard."""
    blocks, order = problem.blocks, ring_order(problem.blocks)
    # one of no intensity was heard, too; blocks of pauses have no weight
    heard = (blocks.intensity[order] > 0.0) | (blocks.weight[order] > 0.0)
    onset = blocks.start_ns[order][heard]
    apart = np.diff(onset)
    if not len(apart):
        return NO_EVENTS
    ratio = apart / np.median(apart)
    gaps = np.flatnonzero((ratio > GAP) & (ratio < _PAUSE))
    if len(gaps) > RARE * len(apart):
        return NO_EVENTS
    spans = zip(onset[gaps] // length_ns, (onset[gaps + 1] + _LASTS_NS) // length_ns, strict=True)
    return np.concatenate((NO_EVENTS, *(np.arange(begin, end + 1) for begin, end in spans)))


def gain_swing(fit: WindowFit, at: Linearised) -> float:
    """Return by how much the gain follows the disturbance (share, standard deviation).

    The length of a muscle that is not held moves its passive force, a disturbance, and its active
    one.  Within an interval the ripple of the pulses tells the gain, whatever the disturbance is.

    Parameters
    ----------
    fit : WindowFit
        After the last step.
    at : Linearised
        Where it began.

    Returns
    -------
    float
        0 where it may be by chance; as before where there are too few intervals to tell.
    """
    number = np.flatnonzero(at.intervals.samples > _LEAST_RIPPLE)
    if len(number) < _LEAST_SWING_INTERVALS:
        return fit.swing
    linear, levels = fit.point.linear, fit.levels
    first = len(fit.point.theta)
    joint = first + len(linear)
    gram, left = at.intervals.gram[number], left_after(fit, at)[0][number]
    force = linear @ gram[:, first:joint]
    hats = gram[:, joint:, joint:] + LEAST_ENERGY * np.eye(2)
    both = np.stack((force[:, joint:], left[:, joint:]), axis=-1)
    by_level = np.einsum('ki,kij->kj', force[:, joint:], np.linalg.solve(hats, both))
    ripple = force[:, first:joint] @ linear - by_level[:, 0]
    seen = left[:, first:joint] @ linear - by_level[:, 1]
    line = np.column_stack((np.ones(len(number)), number - number.mean()))
    disturbance = 0.5 * (levels[number] + levels[number + 1])
    disturbance -= line @ np.linalg.lstsq(line, disturbance, rcond=None)[0]
    matrix = np.column_stack((line, disturbance))
    information = matrix.T @ (ripple[:, None] * matrix)
    if not np.diag(information).min() > LEAST_ENERGY:
        return 0.0
    inverse = scaled_inverse(information)
    follows = float(inverse[2] @ matrix.T @ seen)
    sure = abs(follows) > _SURE_SWING * math.sqrt(
        max(inverse[2, 2] * fit.variance * fit.colour, 0.0)
    )
    return abs(follows) * float(np.std(disturbance)) if sure else 0.0


def _accept(
    fit: WindowFit, at: Linearised, solution: _Solution, step: FloatArray, covariance: FloatArray
) -> None:
    """Go where a step leads."""
    fit.point = moved(at.point, step)
    at.knowledge.separate(fit.point.theta)
    fit.moved = step[: len(fit.point.theta)]
    fit.levels = disturbance_at(solution.reduced, step)
    fit.first = int(at.intervals.first[0])
    fit.known_at = at.point
    fit.covariance = covariance * max(1.0, fit.inflation / max(fit.colour, _MOST_INFLATION))
    # of the newest knot: the row behind it is that of the mean
    fit.level_deviation = math.sqrt(1.0 / float(solution.reduced.factor[-2, -1]))
    fit.evidence = solution.evidence
    fit.misfit = solution.left / at.samples
    explained = float(solution.reduced.evidence[0]) - 0.5 * solution.left
    fit.penalty = explained - solution.evidence
    fit.likelihood = (
        explained
        # behind a filter there are fewer independent ones
        - 0.5 * at.samples / fit.colour * math.log(fit.weighting_variance)
    )


def _differences(fit: WindowFit, first: int, knots: int) -> FloatArray:
    """Return the last first and second differences of the disturbance (2, knots).

    After and around each knot, NaN where unknown.
    """
    known = np.full((2, len(fit.levels)), np.nan)
    known[0, :-1], known[1, 1:-1] = np.diff(fit.levels), np.diff(fit.levels, 2)
    differences = np.full((2, knots), np.nan)
    shift = first - fit.first
    part = known[:, max(shift, 0) :][:, : max(knots + min(shift, 0), 0)]
    begin = max(-shift, 0)
    differences[:, begin : begin + part.shape[1]] = part
    return differences


def moved(point: Point, step: FloatArray) -> Point:
    """Return the point after a step of x (unknowns,)."""
    functions, knots = len(point.linear), len(point.gain)
    ends = np.cumsum([len(point.theta), functions, knots, knots])
    theta, linear, gain, slowing, thresholds = np.split(step, ends)
    return point._replace(
        theta=from_coordinates(coordinates(point.theta) + theta),
        linear=point.linear + linear,
        gain=point.gain + gain,
        slowing=point.slowing + slowing,
        thresholds=point.thresholds + thresholds.reshape(MOVING, knots),
    )
