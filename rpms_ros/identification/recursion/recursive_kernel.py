# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Sums over samples that are valid for any parameters, and a Levenberg-Marquardt step on them.

**Recruitment.**  Between knots ``u_0 = 0, u_1, .., u_K = 1`` the recruitment is the cubic through
its four nearest values.  It is then linear in them, ``rho(theta, u) = sum_k rho(theta, u_k)
B_k(u)``; since rho(0) = 0 there is no term of the knot at zero.  With 24 knots the error is below
0.25 % of the maximum for the curves of people, below 0.04 % for half of them
(`test/identification/recursion/test_knots.py`).

**Sums.**  So the model is

.. math:: y(t) = \sum_k \rho(\theta, u_k) \sum_l w_l\, x_{kl}(t) + b, \qquad
          x_{kl}(t) = \sum_q B_k(u_q)\, \phi_l(t - t_q),

and no regressor x depends on a parameter.  The sums of recursive least squares,
``G <- lambda G + x x^T`` and ``r <- lambda r + x y``, are then valid for every parameter set:
earlier samples were not linearised at parameters that may have been wrong.  x is the state of one
chain of Laguerre filters for each knot.  Between two pulses a known matrix advances it, so the
samples of a block are summed first (`BlockStatistics`) and added to G at its end.

**Step.**  theta are the arctangents and, unless these alone are asked for, the coefficients of the
deviation (`rpms_ros.identification.model.recruitment`).  At parameters theta the linear unknowns
``l = [w, b]`` follow from the sums, Eq. (22).
Inserting them leaves a cost of theta alone; with ``x_j = d(model)/d theta_j`` its Gauss-Newton
matrix is the Schur complement ``H = M_tt - M_tl M_ll^-1 M_lt`` (Kaufman's variable projection),
its gradient ``X^T (y - model)``.  ``(H + delta diag H) d = g`` is the step.  The cost of a trial
is exact, so the gain ratio (28) is that of all samples: delta falls if it is good, rises if it is
bad, and a step that raises the cost is not taken.  A weak prior with the variance of the
residuals as weight keeps H positive.
"""

import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.extending import register_jitable

from rpms_ros.identification.estimation.blocks import (
    COUNT,
    FORCE,
    FORCE_SQUARED,
    RESPONSE_FORCE,
    RESPONSE_ONE,
    BlockStatistics,
    add_sample,
    empty_blocks,
    newest,
    open_block,
)
from rpms_ros.identification.estimation.intake import count_energy
from rpms_ros.identification.estimation.normal_equations import advance_state, correlate
from rpms_ros.identification.estimation.settings import Prior
from rpms_ros.identification.estimation.window_fit import (
    LEAST_ENERGY,
    MODEL_ERROR,
    MODEL_ERROR_SAMPLES,
)
from rpms_ros.identification.model.basis import transition_generator
from rpms_ros.identification.model.levenberg_marquardt import (
    dot,
    factorise_positive,
    minimiser,
    solve_factorised,
    solve_positive,
)
from rpms_ros.identification.model.recruitment import (
    PARAMETERS,
    recruitment,
    recruitment_with_gradient,
)
from rpms_ros.pulses import BoolArray, FloatArray, IntArray

# The present block and the one before it.
BLOCKS = 2
# States below this share of the effect of a pulse count as zero.
_NOTHING = 1e-6


class Memory(NamedTuple):
    """Sums over all samples, weighted by their age.

    Attributes
    ----------
    chains : ndarray (knots, functions)
        States x at the beginning of the block.
    blocks : BlockStatistics
        The present block and the one before it.
    gram : ndarray (knots * functions + 1, knots * functions + 1)
        Sums of x x^T, with the regressor of the baseline (1) last.
    cross : ndarray (knots * functions + 1,)
        Sums of x y.
    energy, samples, squared_samples : ndarray (1,)
        Sums of y^2, of 1, and of 1 with the squared weight.
    """

    chains: FloatArray
    blocks: BlockStatistics
    gram: FloatArray
    cross: FloatArray
    energy: FloatArray
    samples: FloatArray
    squared_samples: FloatArray


def empty_memory(knots: int, functions: int) -> Memory:
    """Return an empty memory."""
    unknowns = knots * functions + 1
    return Memory(
        chains=np.zeros((knots, functions)),
        blocks=empty_blocks(BLOCKS, functions),
        gram=np.zeros((unknowns, unknowns)),
        cross=np.zeros(unknowns),
        **{name: np.zeros(1) for name in ('energy', 'samples', 'squared_samples')},
    )


@numba.njit(cache=True)
def scale_memory(memory: Memory, share: float) -> None:
    """Multiply the weights of all samples by `share`."""
    memory.gram[:] *= share
    memory.cross[:] *= share
    memory.energy[0] *= share
    memory.samples[0] *= share
    memory.squared_samples[0] *= share * share


@numba.njit(cache=True)
def excited(memory: Memory, input_gain: float) -> bool:
    """Return whether any pulse still acts."""
    return bool(np.abs(memory.chains).max() > _NOTHING * input_gain)


@numba.njit(cache=True)
def let_baseline_drift(memory: Memory, variance: float) -> None:
    """Add process noise to the baseline: a variance, relative to that of the noise of a sample.

    There is none after a block that ends at the stamp at which it began, with one sample.
    """
    if not variance > 0.0:
        return
    gram, cross = memory.gram, memory.cross
    last = len(cross) - 1
    share = 1.0 / (gram[last, last] + 1.0 / variance)
    row = gram[last].copy()
    level = cross[last]
    memory.energy[0] -= level * level * share
    cross -= row * level * share
    gram -= np.outer(row, row * share)


@numba.njit(cache=True)
def add_block(memory: Memory, here: int) -> None:
    """Add the samples of a block, whose states are `chains`, to the sums."""
    blocks, gram, cross = memory.blocks, memory.gram, memory.cross
    moments, response = blocks.moments[here], blocks.response[here]
    functions, last = memory.chains.shape[1], len(cross) - 1
    # the states of the chains at a sample are these times the values e of the block
    states = np.zeros((last, functions))
    for row in range(last):
        knot, function = divmod(row, functions)
        for shift in range(function + 1):
            states[row, shift] = memory.chains[knot, function - shift]
    gram[:last, :last] += states @ blocks.gram[here] @ states.T
    gram[last, :last] += states @ response[:, RESPONSE_ONE].copy()
    gram[:last, last] = gram[last, :last]
    cross[:last] += states @ response[:, RESPONSE_FORCE].copy()
    cross[last] += moments[FORCE]
    gram[last, last] += moments[COUNT]
    memory.energy[0] += moments[FORCE_SQUARED]
    memory.samples[0] += moments[COUNT]
    memory.squared_samples[0] += moments[COUNT]


KNOTS = 24


@numba.njit(cache=True)
def interpolate(intensity: float, values: FloatArray) -> None:
    """Write ``B_k(intensity)`` into `values` (knots,), those of the knots above zero."""
    count = len(values)
    values[:] = 0.0
    place = min(max(intensity, 0.0), 1.0) * count
    first = min(max(int(place) - 1, 0), count - 3)
    for near in range(4):
        weight = 1.0
        for other in range(4):
            if other != near:
                weight *= (place - first - other) / (near - other)
        if first + near > 0:
            values[first + near - 1] = weight


@numba.njit(cache=True)
def recruitment_at_knots(theta: FloatArray, values: FloatArray) -> None:
    """Write rho and its derivatives, alpha as logarithms, into `values` (1 + theta, knots)."""
    slope = np.empty(len(theta))
    count = values.shape[1]
    for knot in range(count):
        values[0, knot] = recruitment_with_gradient((knot + 1) / count, theta, slope)
        values[1:, knot] = slope


@numba.njit(cache=True)
def interpolated_curve(intensity: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return `recruitment_curve` (n,) and (n, theta) between the knots, as the sums know it."""
    values, near = np.empty((1 + len(theta), KNOTS)), np.empty((len(intensity), KNOTS))
    recruitment_at_knots(theta, values)
    for index in range(len(intensity)):
        interpolate(intensity[index], near[index])
    return near @ values[0], near @ values[1:].T


class Fit(NamedTuple):
    """Parameters of a fit, and its equations at these parameters.

    Attributes
    ----------
    theta : ndarray (4,) or (24,)
        u_thr, u_sat, alpha_sat, alpha_thr, and the deviation.
    linear : ndarray (functions,)
        w.
    levels : ndarray (knots,)
        b [N].
    matrix, right : ndarray (unknowns, unknowns), (unknowns,)
        Sums from the memory.
    cost, squares : ndarray (1,)
        Cost including the prior, and sum of squared residuals alone [N^2].
    samples, energy : ndarray (1,)
        Number of samples in the blocks, and sum of the squared force [N^2].
    variance : ndarray (1,)
        Variance of the residuals, the weight of the prior [N^2].
    damping, moved : ndarray (1,)
        Of the next step, and largest change of the last one.
    failures : ndarray (1,)
        How many matrices could not be factorised.
    """

    theta: FloatArray
    linear: FloatArray
    levels: FloatArray
    matrix: FloatArray
    right: FloatArray
    cost: FloatArray
    squares: FloatArray
    samples: FloatArray
    energy: FloatArray
    variance: FloatArray
    damping: FloatArray
    moved: FloatArray
    failures: FloatArray


def empty_fit(theta: FloatArray, functions: int, knots: int) -> Fit:
    """Return a fit without data."""
    unknowns = len(theta) + functions + knots
    single = ['cost', 'squares', 'samples', 'energy', 'variance', 'moved', 'failures']
    return Fit(
        theta=theta.copy(),
        linear=np.zeros(functions),
        levels=np.zeros(knots),
        matrix=np.zeros((unknowns, unknowns)),
        right=np.zeros(unknowns),
        damping=np.full(1, 1e-3),
        **{name: np.zeros(1) for name in single},
    )


@numba.njit(cache=True)
def coordinate(theta: FloatArray, place: int) -> float:
    """Return a parameter in the coordinate of the steps: alpha as its logarithm."""
    if 2 <= place < PARAMETERS:
        return math.log(theta[place])
    value: float = theta[place]
    return value


@numba.njit(cache=True)
def weak_ridge(energy: float, samples: float, variance: float) -> float:
    """Return a ridge that keeps w and b solvable, too weak to change estimates noticeably."""
    power = energy / max(samples, 1.0) + LEAST_ENERGY
    # The variance exceeds the power only if it is from before a gap.
    value: float = 1e-2 * variance / max(power, variance)
    return value


@register_jitable
def _room(problem: Any, fit: Fit, low: FloatArray, high: FloatArray) -> None:
    """Write the least and greatest steps of the coordinates (theta,) within `problem.prior`."""
    for place in range(len(fit.theta)):
        here = coordinate(fit.theta, place)
        low[place] = coordinate(problem.prior.lower, place) - here
        high[place] = coordinate(problem.prior.upper, place) - here


@numba.njit(cache=True)
def move_theta(theta: FloatArray, prior: Prior, step: FloatArray, moved: FloatArray) -> None:
    """Write theta after a step of its length; u_thr and u_sat keep their least distance.

    `step` becomes what was gone.
    """
    for place in range(len(theta)):
        value = coordinate(theta, place) + step[place]
        value = math.exp(value) if 2 <= place < PARAMETERS else value
        moved[place] = min(max(value, prior.lower[place]), prior.upper[place])
    lacking = prior.separation - (moved[1] - moved[0])
    if lacking > 0.0:
        moved[0] = max(moved[0] - 0.5 * lacking, prior.lower[0])
        moved[1] = moved[0] + prior.separation
    for place in range(len(theta)):
        step[place] = coordinate(moved, place) - coordinate(theta, place)


class PredictionState(NamedTuple):
    """State of the a-priori prediction between samples.

    Attributes
    ----------
    response : ndarray (functions,)
        The force of the block at tau is ``response^T e(tau)``, without the baseline.
    error_energy, force_energy : ndarray (1,)
        Sums of squares of the a-priori error and of the force, decaying [N^2].
    squares : ndarray (1,)
        Sum of squared a-priori errors of the block [N^2].
    learnt : ndarray (1,)
        Number of samples that were learnt from.
    previous_ns : ndarray of int64 (1,)
        Stamp of the last sample that was learnt from [ns].
    """

    response: FloatArray
    error_energy: FloatArray
    force_energy: FloatArray
    squares: FloatArray
    learnt: FloatArray
    previous_ns: IntArray


def fresh_prediction_state(functions: int) -> PredictionState:
    """Return the state before the first sample."""
    single = ['error_energy', 'force_energy', 'squares', 'learnt']
    return PredictionState(
        response=np.zeros(functions),
        previous_ns=np.zeros(1, dtype=np.int64),
        **{name: np.zeros(1) for name in single},
    )


@numba.njit(cache=True)
def recompute_response(
    chains: FloatArray, theta: FloatArray, linear: FloatArray, response: FloatArray
) -> None:
    """Write the response (functions,) of the present block for given parameters."""
    state = np.zeros(chains.shape[1])
    for knot in range(len(chains)):
        state += recruitment((knot + 1) / len(chains), theta) * chains[knot]
    correlate(linear, state, response)


@numba.njit(cache=True)
def begin_block(memory: Memory, start_ns: int, intensity: float, push: float, rate: float) -> None:
    """Begin a block with a pulse, which adds `push` times its recruitment to the states.

    `rate` is 2 p [1/s]; the first block begins with zero states.
    """
    blocks, chains = memory.blocks, memory.chains
    if not blocks.size[0]:
        chains[:] = 0.0
    here = open_block(blocks, start_ns, intensity, push, rate, False)
    _advance(chains, blocks.transition[here], intensity, push)


@numba.njit(cache=True)
def _advance(chains: FloatArray, transition: FloatArray, intensity: float, push: float) -> None:
    """Advance the states (knots, functions) to a pulse, and add it."""
    values = np.empty(len(chains))
    interpolate(intensity, values)
    for knot in range(len(chains)):
        advance_state(transition, chains[knot])
        chains[knot] += push * values[knot]


@numba.njit(cache=True)
def residual_sum(blocks: BlockStatistics, response: FloatArray, level: float) -> float:
    """Return the sum of the a-priori errors of the block [N]."""
    here = newest(blocks)
    moments = blocks.moments[here]
    total: float = moments[FORCE] - level * moments[COUNT]
    for shift in range(len(response)):
        total -= response[shift] * blocks.response[here, shift, RESPONSE_ONE]
    return total


@numba.njit(cache=True)
def take(
    stamp_ns: IntArray,
    force: FloatArray,
    usable: BoolArray,
    blocks: BlockStatistics,
    carried: PredictionState,
    level: float,
    rate: float,
) -> FloatArray:
    """Add samples (samples,) to the block; return the a-priori prediction of each."""
    here = newest(blocks)
    prediction, values = np.empty(len(stamp_ns)), np.empty(len(carried.response))
    energies = carried.error_energy, carried.force_energy, carried.previous_ns
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        tau = 1e-9 * (stamp - blocks.start_ns[here])
        prediction[index] = _force_at(rate * tau, level, carried.response, values)
        if not usable[index]:
            continue
        error = force[index] - prediction[index]
        count_energy(energies, stamp, error, force[index])
        carried.squares[0] += error * error
        carried.learnt[0] += 1.0
        add_sample(blocks, here, tau, force[index], values)
    return prediction


@numba.njit(cache=True)
def _force_at(distance: float, level: float, response: FloatArray, values: FloatArray) -> float:
    """Return the force of a block 2 p tau after its beginning; write e there (functions,)."""
    transition_generator(distance, values)
    total = level
    for function in range(len(values)):
        total += response[function] * values[function]
    return total


@numba.njit(cache=True)
def predict(
    stamp_ns: IntArray,
    pending: tuple[IntArray, FloatArray, FloatArray],
    memory: Memory,
    carried: PredictionState,
    fit: Fit,
    rate: float,
) -> FloatArray:
    """Return the predictions that `take` would make of ascending samples (samples,) [N].

    `pending` are begin, intensity and push (pulses,) of the pulses that have not begun.
    """
    begin_ns, intensity, push = pending
    blocks, expected = memory.blocks, np.empty(len(stamp_ns))
    known = blocks.size[0] > 0
    start = blocks.start_ns[newest(blocks)] if known else stamp_ns[0]
    states, present = memory.chains.copy(), carried.response.copy()
    if not known:
        states[:] = 0.0
        present[:] = 0.0
    values, begun = np.empty(len(present)), 0
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        before = begun
        while begun < len(begin_ns) and begin_ns[begun] < stamp:
            transition_generator(rate * 1e-9 * max(begin_ns[begun] - start, 0), values)
            _advance(states, values, intensity[begun], push[begun])
            start = begin_ns[begun]
            begun += 1
        if begun > before:
            recompute_response(states, fit.theta, fit.linear, present)
        since = rate * 1e-9 * (stamp - start)
        expected[index] = _force_at(since, fit.levels[0], present, values)
    return expected


@numba.njit(cache=True)
def equations(memory: Memory, fit: Fit) -> None:
    """Write matrix and right-hand side of [theta, w, b] at the parameters of `fit`."""
    knots, functions = memory.chains.shape
    many, last = len(fit.theta), len(memory.cross) - 1
    values = np.empty((1 + many, knots))
    recruitment_at_knots(fit.theta, values)
    # the derivative of the model by each unknown, as a combination of the regressors
    directions = np.zeros((len(fit.right), last + 1))
    for at in range(last):
        knot, function = divmod(at, functions)
        directions[:many, at] = values[1:, knot] * fit.linear[function]
        directions[many + function, at] = values[0, knot]
    directions[-1, last] = 1.0
    fit.matrix[:] = directions @ memory.gram @ directions.T
    fit.right[:] = directions @ memory.cross


@numba.njit(cache=True)
def _with_ridge(memory: Memory, fit: Fit) -> tuple[FloatArray, float]:
    """Return the matrix of [w, b] with a weak ridge, and the ridge."""
    matrix = fit.matrix[len(fit.theta) :, len(fit.theta) :].copy()
    ridge = weak_ridge(memory.energy[0], memory.samples[0], fit.variance[0])
    for row in range(len(matrix)):
        matrix[row, row] += ridge
    return matrix, ridge


@numba.njit(cache=True)
def solve_linear(memory: Memory, prior: Prior, fit: Fit) -> bool:
    """Solve for w and b at theta, then the cost; return whether the matrix was positive."""
    functions, many = len(fit.linear), len(fit.theta)
    matrix, ridge = _with_ridge(memory, fit)
    linear = fit.right[many:].copy()
    if not solve_positive(matrix, linear):
        return False
    fit.linear[:] = linear[:functions]
    fit.levels[:] = linear[functions:]
    squares = memory.energy[0]
    away = 0.0
    for row in range(len(linear)):
        at = many + row
        squares += linear[row] * (dot(fit.matrix[at, many:], linear) - 2.0 * fit.right[at])
        away += ridge * linear[row] * linear[row]
    for place in range(many):
        distance = (coordinate(fit.theta, place) - prior.mean[place]) / prior.deviation[place]
        away += fit.variance[0] * distance * distance
    fit.squares[0] = max(squares, 0.0)
    fit.cost[0] = squares + away
    fit.samples[0] = memory.samples[0]
    fit.energy[0] = memory.energy[0]
    return True


@numba.njit(cache=True)
def evaluate(memory: Memory, prior: Prior, fit: Fit) -> bool:
    """Solve the linear unknowns at theta and make the equations complete there."""
    equations(memory, fit)
    if not solve_linear(memory, prior, fit):
        return False
    # The rows of theta are taken in the direction of the new w.
    equations(memory, fit)
    return True


@numba.njit(cache=True)
def refresh_variance(memory: Memory, prior: Prior, fit: Fit) -> None:
    """Update the variance of the residuals, and with it the weight of the prior."""
    power = fit.energy[0] / max(fit.samples[0], 1.0) + LEAST_ENERGY
    # a prior value of the variance: few residuals determine it poorly
    doubt = MODEL_ERROR_SAMPLES * MODEL_ERROR * power
    fit.variance[0] = (fit.squares[0] + doubt) / (fit.samples[0] + MODEL_ERROR_SAMPLES)
    if not solve_linear(memory, prior, fit):
        fit.failures[0] += 1.0


class StepProblem(NamedTuple):
    """What a step of the parameters needs besides their fit."""

    memory: Memory
    prior: Prior


@numba.njit(cache=True)
def reduced(memory: Memory, fit: Fit, hessian: FloatArray, slope: FloatArray) -> bool:
    """Write H (theta, theta) and minus half the gradient, both without the prior.

    The equations are complete already: `evaluate` leaves them so.  Return whether the matrix of
    [w, b] has a factor.
    """
    matrix, linear, many = fit.matrix, np.concatenate((fit.linear, fit.levels)), len(fit.theta)
    factor, _ = _with_ridge(memory, fit)
    if not factorise_positive(factor):
        return False
    for place in range(many):
        solved = matrix[place, many:].copy()
        slope[place] = fit.right[place] - dot(solved, linear)
        solve_factorised(factor, solved)
        for other in range(many):
            hessian[other, place] = matrix[other, place] - dot(matrix[other, many:], solved)
    return True


@register_jitable
def _linearise(problem: StepProblem, fit: Fit, hessian: FloatArray, slope: FloatArray) -> bool:
    """Write H (theta, theta) and minus half the gradient; return whether there is a factor."""
    prior = problem.prior
    if not reduced(problem.memory, fit, hessian, slope):
        return False
    for place in range(len(fit.theta)):
        weight = fit.variance[0] / prior.deviation[place] ** 2
        slope[place] -= weight * (coordinate(fit.theta, place) - prior.mean[place])
        hessian[place, place] += weight
    return True


@register_jitable
def _move(problem: StepProblem, fit: Fit, step: FloatArray, trial: Fit) -> None:
    """Take a step (theta,); where the linear unknowns cannot be solved, the cost is infinite."""
    move_theta(fit.theta, problem.prior, step, trial.theta)
    trial.variance[0] = fit.variance[0]
    trial.linear[:] = fit.linear
    if not evaluate(problem.memory, problem.prior, trial):
        fit.failures[0] += 1.0
        trial.cost[0] = np.inf


improve = minimiser(_linearise, _room, _move)
