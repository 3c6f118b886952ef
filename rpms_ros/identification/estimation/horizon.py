# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""On-line estimator: exact variable projection over a moving horizon.

Samples of the last 20 s are kept, condensed into blocks of one pulse each, from which the normal
equations of any parameters follow exactly.  Once every `step_period` of the stamps a Gauss-Newton
step is taken from them, so all samples are linearised at the present parameters.  Blocks that
leave the horizon are kept as a quadratic cost, which is forgotten only in directions of which
newer blocks inform.

Steps depend on stamps alone, not on how the data are cut into blocks.

Arrival cost: the blocks that have left the horizon, as a quadratic cost of [theta, w].

``(z - z_0)^T L (z - z_0) / 2 - p^T (z - z_0)``: a leaving block adds its Gauss-Newton matrix to L
and its gradient to p, both at the present parameters.

Old information is to be replaced by new, but only where there is new information.  With
M = L + (information of the horizon) it is forgotten in proportion to the new information,

.. math:: L \leftarrow L - a\,(L - L M^{-1} L), \qquad p \leftarrow p - a\,(p - L M^{-1} p).

``L - L M^{-1} L`` is the parallel sum of old and new information: about L in directions that the
horizon informs, zero in those it does not.  So a rest, a constant intensity or one below the
threshold erases nothing, and L does not grow without bound.

Both describe the same muscle only while it does not change.  So they are compared before each
step: with v the slope of the arrival cost at the joint optimum and H the information of the
horizon, baseline eliminated and prior included,

.. math:: T = v^T (H^{-1} + L^{-1}) v / s^2

is the squared difference of the two estimates in units of its covariance, chi-square with as many
degrees of freedom as there are unknowns.  If T is above `disagreement_limit`, process noise is
added along the difference ``L^{-1} v``, so much that T becomes one,

.. math:: L \leftarrow L - (1 - 1/T)\, v v^T / (v^T L^{-1} v),

and everything of which the horizon informs is forgotten: blocks that left since the change were
linearised at parameters between the old and the new ones.
"""

from collections.abc import Mapping

import numba
import numpy as np
from scipy.special import chdtri

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.estimation.blocks import COUNT
from rpms_ros.identification.estimation.estimator import ProjectionEstimator, recompute_state
from rpms_ros.identification.estimation.gauss_newton import (
    Fit,
    away_from_reference,
    complete,
    coordinate,
    empty_fit,
    fit_linear,
    improve,
    theta_gradient,
    weak_ridge,
)
from rpms_ros.identification.estimation.normal_equations import gradient_pass, linear_pass
from rpms_ros.identification.estimation.prior import DayToDay, KnownMuscle
from rpms_ros.identification.estimation.settings import (
    PARAMETERS,
    BaselineKnots,
    Prior,
    Problem,
    ProjectionSettings,
)
from rpms_ros.identification.model.estimate import DEFAULT_RATE, Estimate
from rpms_ros.identification.model.levenberg_marquardt import (
    dot,
    factorise_positive,
    solve_factorised,
    solve_positive,
)
from rpms_ros.identification.stream.faults import PULSES_TOO_FREQUENT
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray, nanoseconds

# Probability of a false alarm in one comparison if the muscle does not change.
_FALSE_ALARM = 1e-4


def disagreement_limit(unknowns: int) -> float:
    """Return the value of the statistic above which arrival cost and horizon contradict."""
    return float(chdtri(unknowns, _FALSE_ALARM))


@numba.njit(cache=True)
def _recentre(prior: Prior, fit: Fit) -> None:
    """Expand the cost about the present parameters."""
    for place in range(len(prior.reference)):
        here = (
            coordinate(fit.theta, place) if place < PARAMETERS else fit.linear[place - PARAMETERS]
        )
        step = here - prior.reference[place]
        for row in range(len(prior.reference)):
            prior.information_vector[row] -= prior.information[row, place] * step
        prior.reference[place] = here


@numba.njit(cache=True)
def marginalize(problem: Problem, last: int, fit: Fit, scratch: Fit) -> None:
    """Add the blocks before `last`, linearised at the parameters of `fit`, to the prior."""
    prior = problem.prior
    _recentre(prior, fit)
    linear_pass(problem, last, fit.theta, scratch.matrix, scratch.right)
    gradient_pass(problem, last, fit.theta, fit.linear, scratch.matrix, scratch.right)
    functions = len(fit.linear)
    matrix = scratch.matrix
    for row in range(PARAMETERS + functions):
        total = scratch.right[row]
        for function in range(functions):
            column = PARAMETERS + function
            entry = matrix[row, column] if row >= column else matrix[column, row]
            total -= entry * fit.linear[function]
        for knot in range(len(fit.levels)):
            total -= matrix[PARAMETERS + functions + knot, row] * fit.levels[knot]
        prior.information_vector[row] += total
        for column in range(row + 1):
            prior.information[row, column] += matrix[row, column]
            if column < row:
                prior.information[column, row] += matrix[row, column]


@numba.njit(cache=True)
def _total(prior: Prior, fit: Fit) -> FloatArray:
    """Return the lower triangle of M with a small ridge."""
    count = len(prior.reference)
    total = fit.complete[:count, :count] + prior.information
    size = 0.0
    for row in range(count):
        size = max(size, total[row, row])
    for row in range(count):
        total[row, row] += 1e-12 * size + fit.variance[0]
    return total


@numba.njit(cache=True)
def forget(prior: Prior, fit: Fit, share: float) -> None:
    """Forget `share` of the arrival cost in the directions of which the blocks inform."""
    count = len(prior.reference)
    information = prior.information
    total = _total(prior, fit)
    if not factorise_positive(total):
        fit.failures[0] += 1.0
        return
    kept = np.empty((count, count))
    for column in range(count):
        solved = information[column].copy()
        solve_factorised(total, solved)
        for row in range(count):
            kept[row, column] = dot(information[row], solved)
    solved = prior.information_vector.copy()
    solve_factorised(total, solved)
    for row in range(count):
        prior.information_vector[row] += share * (
            dot(information[row], solved) - prior.information_vector[row]
        )
    for row in range(count):
        for column in range(row + 1):
            value = 0.5 * (kept[row, column] + kept[column, row])
            value = information[row, column] + share * (value - information[row, column])
            information[row, column] = value
            information[column, row] = value


@numba.njit(cache=True)
def _add_prior(prior: Prior, fit: Fit, matrix: FloatArray) -> None:
    """Add prior and ridge to the diagonal of an information matrix."""
    ridge = weak_ridge(fit)
    for row in range(len(matrix)):
        if row < PARAMETERS:
            matrix[row, row] += fit.variance[0] / prior.deviation[row] ** 2
        else:
            matrix[row, row] += ridge


@numba.njit(cache=True)
def _slope_at_optimum(prior: Prior, fit: Fit, gradient: FloatArray) -> FloatArray:
    """Return minus the gradient of the arrival cost at the optimum of both costs together."""
    count = len(prior.reference)
    both = fit.complete.copy()
    _add_prior(prior, fit, both)
    both[:count, :count] += prior.information
    step = np.zeros(len(both))
    # The linear unknowns are solved: the joint cost has a slope by theta only.
    step[:PARAMETERS] = gradient
    if not solve_positive(both, step):
        fit.failures[0] += 1.0
    away = away_from_reference(fit, prior) + step[:count]
    slope = prior.information_vector.copy()
    for row in range(count):
        slope[row] -= dot(prior.information[row], away)
    return slope


@numba.njit(cache=True)
def reduce_contradiction(prior: Prior, fit: Fit, gradient: FloatArray, limit: float) -> float:
    """Reduce the arrival cost where it contradicts the horizon; return the statistic T.

    Parameters
    ----------
    prior : Prior
        The arrival cost, changed if T is above the limit.
    fit : Fit
        Fit with complete equations and solved linear unknowns.
    gradient : ndarray (4,)
        Minus half the gradient of the joint cost by theta.
    limit : float
        See `disagreement_limit`.
    """
    count = len(prior.reference)
    slope = _slope_at_optimum(prior, fit, gradient)
    own = fit.complete.copy()
    _add_prior(prior, fit, own)
    by_horizon = np.zeros(len(own))
    by_horizon[:count] = slope
    memory = prior.information.copy()
    _add_prior(prior, fit, memory)
    difference = slope.copy()
    if not (solve_positive(own, by_horizon) and solve_positive(memory, difference)):
        fit.failures[0] += 1.0
        return 0.0
    statistic: float = dot(slope, by_horizon[:count]) + dot(slope, difference)
    statistic /= fit.variance[0]
    if not statistic > limit:
        return statistic
    _recentre(prior, fit)
    held = np.empty(count)
    for row in range(count):
        held[row] = dot(prior.information[row], difference)
    share = (1.0 - 1.0 / statistic) / dot(difference, held)
    along = share * dot(difference, prior.information_vector)
    for row in range(count):
        prior.information_vector[row] -= held[row] * along
        for column in range(count):
            prior.information[row, column] -= share * held[row] * held[column]
    forget(prior, fit, 1.0)
    return statistic


# Pulses up to this rate fit into the horizon [Hz]; at a higher one it is shorter.
_HIGHEST_RATE = 120.0
# Blocks that can be added in one step period, before a step makes room again.
_SPARE_BLOCKS = 128
# Most blocks that do not begin with a pulse in one step period.
_BLOCKS_OF_PAUSES = 4
# Knots of the baseline over the horizon, and their least distance [ns].
_KNOTS = 3
_LEAST_SPACING_NS = 15 * NANOSECONDS_PER_SECOND // 2
_TOLERANCE = 1e-10
# Most steps after the arrival cost was reduced: the optimum may be far away.
_STEPS_AFTER_CHANGE = 5
# After that, for one horizon, another start is tried every so many steps, with these settings.
_CHALLENGE_STEPS = 5
_CHALLENGER_STEPS = 10
_CHALLENGER_TOLERANCE = 1e-6
_START_DAMPING = 1e-2
# Steps shorter than this, with little damping, are small against the uncertainty.
_CALM = 5e-3
_CALM_DAMPING = 1e-4


class HorizonEstimator(ProjectionEstimator):
    """Moving-horizon estimator.

    Parameters
    ----------
    settings : ProjectionSettings or None
        Model and numerics.
    rate_hz : float
        Rate for which the recruitment curve is stated [Hz].

    Raises
    ------
    IdentificationError
        If the rate is not above zero.
    """

    name = 'horizon'

    _last_ns: int | None
    _rested: bool
    _turn: int
    _settled_ns: int

    def __init__(
        self,
        settings: ProjectionSettings | None = None,
        rate_hz: float = DEFAULT_RATE,
    ) -> None:
        settings = settings if settings is not None else ProjectionSettings()
        seconds = settings.horizon + settings.basis.duration
        capacity = int(seconds * _HIGHEST_RATE) + _SPARE_BLOCKS
        super().__init__(settings, rate_hz, capacity, _KNOTS if settings.baseline else 0)
        self._step_ns = nanoseconds(settings.step_period)
        self._horizon_ns = nanoseconds(settings.horizon)
        self._memory_ns = nanoseconds(settings.basis.duration)
        self._limit = disagreement_limit(PARAMETERS + settings.basis.functions)
        self._last_ns = None
        self._rested = True
        self._starts = settings.starts()
        self._forgotten = settings.as_prior()
        self._turn = 0
        self._settled_ns = -(2**63)

    def start_from(self, known: KnownMuscle) -> None:
        """Use the result of an earlier session as arrival cost.

        Raises
        ------
        IdentificationError
            If there have been data.
        """
        if self._last_ns is not None or self._pulses:
            raise IdentificationError('expected a fresh estimator to start from what is known')
        known = known.on(self.settings.basis)
        fit, prior = self._fit, self._problem.prior
        theta = np.clip(known.theta, prior.lower, prior.upper)
        theta[1] = max(theta[1], theta[0] + prior.separation)
        fit.theta[:] = theta
        fit.linear[:] = known.linear
        fit.variance[0] = known.variance
        information = known.variance * np.linalg.inv(known.widened(DayToDay()))
        prior.information[:] = 0.5 * (information + information.T)
        prior.reference[:] = [*theta[:2], *np.log(theta[2:]), *known.linear]
        prior.information_vector[:] = 0.0

    def update(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        """Learn from samples (samples,), ascending; return their a-priori prediction [N].

        See `rpms_ros.identification.model.estimate.Estimator.update`.
        """
        prediction = np.empty(len(stamp_ns))
        if not len(stamp_ns):
            return prediction
        period = stamp_ns // self._step_ns
        starts = np.flatnonzero(np.diff(period)) + 1
        for first, last in zip((0, *starts), (*starts, len(stamp_ns)), strict=True):
            if self._last_ns is not None and period[first] != self._last_ns // self._step_ns:
                self._step_if_due()
            part = slice(first, last)
            self._make_room(int(stamp_ns[first]), int(stamp_ns[last - 1]))
            self._take(stamp_ns[part], force[part], usable[part], prediction[part])
            self._last_ns = int(stamp_ns[last - 1])
        return prediction

    def forget_pulses(self) -> None:
        """Drop the pulses that still act; the samples so far are kept as a quadratic cost."""
        super().forget_pulses()
        size = int(self._problem.blocks.size[0])
        if size:
            self._leave(size)
            self._problem.blocks.size[0] = 0
            self._move_to(0)
        self._last_ns = None
        self._settled_ns = -(2**63)

    def estimate(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Return the present estimate."""
        return self._build(stamp_ns, faults)

    def _step_if_due(self) -> None:
        """Take a step; only every other time while steps are small against the uncertainty."""
        calm = self._fit.moved[0] < _CALM and self._fit.damping[0] <= _CALM_DAMPING
        if calm and not self._rested:
            self._rested = True
            return
        self._rested = False
        self._step()

    def _step(self) -> None:
        """Move the horizon on and take a step."""
        if self._intake.learnt[0] == 0.0:
            return
        self._slide()
        prior, fit = self._problem.prior, self._fit
        if not self._holds_samples():
            # No samples: there is only the arrival cost.
            fit.complete[:] = 0.0
            return
        remembers = bool(prior.information.any())
        if self.settings.forgetting and remembers:
            forget(prior, fit, self.settings.forgetting)
        fit_linear(self._problem, fit, True)
        if self._unsettled:
            self._challenge()
        contradicted = remembers and self._compare()
        steps = _STEPS_AFTER_CHANGE if contradicted else self.settings.steps
        ready = remembers and not contradicted
        improve(self._problem, fit, self._trial, steps, _TOLERANCE, ready)
        recompute_state(self._problem, self._intake, fit)

    def _holds_samples(self) -> bool:
        """Return whether the horizon holds any sample, or there is no arrival cost."""
        blocks = self._problem.blocks
        order = (int(blocks.head[0]) + np.arange(self._problem.first, int(blocks.size[0]))) % len(
            blocks.start_ns
        )
        return (
            bool(blocks.moments[order, COUNT].any()) or not self._problem.prior.information.any()
        )

    @property
    def _unsettled(self) -> bool:
        """Whether the horizon may hold samples from before a contradiction."""
        assert self._last_ns is not None
        return self._last_ns < self._settled_ns

    def _compare(self) -> bool:
        """Compare the arrival cost with the horizon; return whether it was reduced."""
        prior, fit = self._problem.prior, self._fit
        assert self._last_ns is not None
        complete(self._problem, fit)
        gradient = np.zeros(PARAMETERS)
        theta_gradient(fit, prior, gradient)
        # The cost of blocks that left after a contradiction may be wrong: the limit is the
        # expected value of the statistic.
        limit = float(len(prior.reference)) if self._unsettled else self._limit
        statistic = reduce_contradiction(prior, fit, gradient, limit)
        if statistic > self._limit:
            self._settled_ns = self._last_ns + self._horizon_ns
        if statistic <= limit:
            return False
        # The variance stays: it was found from the horizon alone.
        fit_linear(self._problem, fit, False)
        return True

    def _challenge(self) -> None:
        """Try the next start on the horizon alone; continue from there if it fits better.

        While the horizon spans a change of the muscle, the fit follows neither muscle, and blocks
        that leave are linearised at its parameters: far from those of the new muscle that
        quadratic cost is invalid and would keep the fit in a local minimum.
        """
        self._turn = (self._turn + 1) % (_CHALLENGE_STEPS * len(self._starts))
        turn, remainder = divmod(self._turn, _CHALLENGE_STEPS)
        if remainder:
            return
        fit = self._fit
        here = self._from_horizon_alone(fit.theta)
        other = self._from_horizon_alone(self._starts[turn])
        steps, tolerance = _CHALLENGER_STEPS, _CHALLENGER_TOLERANCE
        improve(self._alone(), other, self._trial, steps, tolerance, False)
        gain = here.cost[0] - other.cost[0]
        if gain > self._limit * fit.variance[0]:
            fit.theta[:] = other.theta
            fit.damping[0] = other.damping[0]
            self._problem.prior.information[:] = 0.0
            self._problem.prior.information_vector[:] = 0.0
            fit_linear(self._problem, fit, True)

    def _alone(self) -> Problem:
        """Return the problem of the horizon without arrival cost."""
        return self._problem._replace(prior=self._forgotten)

    def _from_horizon_alone(self, theta: FloatArray) -> Fit:
        """Return a fit at theta (4,), its linear unknowns solved without arrival cost."""
        other = empty_fit(theta, len(self._fit.linear), len(self._fit.levels))
        other.variance[0] = self._fit.variance[0]
        other.damping[0] = _START_DAMPING
        fit_linear(self._alone(), other, False)
        return other

    def _move_to(self, first: int) -> None:
        """Set the first block of the horizon."""
        self._problem = self._problem._replace(first=first)

    def _slide(self) -> None:
        """Remove blocks older than the horizon, except those on which its first state depends."""
        assert self._last_ns is not None
        blocks = self._problem.blocks
        capacity = len(blocks.start_ns)
        head, size = int(blocks.head[0]), int(blocks.size[0])
        start_ns = blocks.start_ns[(head + np.arange(size)) % capacity]
        surplus = size - (capacity - _SPARE_BLOCKS)
        oldest = self._last_ns - self._horizon_ns
        leaving = int(np.searchsorted(start_ns[1:], oldest, side='right'))
        self._leave(min(max(leaving, surplus), size - 1))
        begin = int(start_ns[self._problem.first])
        dropped = int(np.searchsorted(start_ns, begin - self._memory_ns))
        dropped = min(max(dropped, surplus), self._problem.first)
        if dropped > 0:
            blocks.head[0] = (head + dropped) % capacity
            blocks.size[0] -= dropped
            self._move_to(self._problem.first - dropped)
        spacing = max((self._last_ns - begin) // (_KNOTS - 1), _LEAST_SPACING_NS)
        baseline = BaselineKnots(self._problem.baseline.knots, begin, spacing)
        self._problem = self._problem._replace(baseline=baseline)

    def _make_room(self, first_ns: int, last_ns: int) -> None:
        """Make room for the blocks up to `last_ns` by removing the oldest ones.

        They become part of the arrival cost.  Pulses that began long before the first sample, in
        an outage of the force, no longer act.
        """
        pending = self._delay_line
        pending.drop(pending.begin_until(first_ns - 2 * self._memory_ns))
        blocks = self._problem.blocks
        capacity = len(blocks.start_ns)
        coming = pending.begin_until(last_ns)
        most = capacity - _BLOCKS_OF_PAUSES
        if coming > most:
            self._faults.add(PULSES_TOO_FREQUENT, coming - most)
            pending.drop(coming - most)
            coming = most
        lacking = int(blocks.size[0]) + coming + _BLOCKS_OF_PAUSES - capacity
        if lacking > 0:
            self._leave(min(max(lacking, self._problem.first), int(blocks.size[0])))
            first = self._problem.first
            blocks.head[0] = (int(blocks.head[0]) + lacking) % capacity
            blocks.size[0] -= lacking
            self._move_to(max(first - lacking, 0))

    def _leave(self, last: int) -> None:
        """Add the information of blocks up to `last` to the arrival cost."""
        if last <= self._problem.first:
            return
        marginalize(self._problem, last, self._fit, self._trial)
        self._move_to(last)
