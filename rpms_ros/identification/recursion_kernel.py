# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""One sample of the modified recursive Levenberg-Marquardt algorithm, compiled.

Model (Eqs. 13 to 16): ``y = phi(theta)^T w``, with ``phi = sum_q rho(theta, u_q) r(t - t_q)``
over the pulses that still act.  Two recursions run side by side on the cost (19):

*Linear parameters*, Eq. (22) by recursive least squares with covariance P::

    K = P phi / (lambda + phi^T P phi),   w <- w + K e,   P <- (P - K phi^T P) / lambda

*Nonlinear parameters*, Eqs. (24) to (28).  The plain derivative ``psi = d(phi^T w)/d theta`` at
fixed w is misleading: w compensates most of the effect of a step in theta.  The part of psi
orthogonal to the linear regressors is what w cannot compensate.  Regressing psi on phi by the
same least squares, with the same gain, gives it recursively::

    psi~ = psi - W^T phi,   W <- W + K psi~^T

With the conversion factor ``c = lambda / (lambda + phi^T P phi)``, which turns a-priori into
a-posteriori residuals, elimination of w from the joint Gauss-Newton equations gives exactly

    H <- lambda H + c psi~ psi~^T,   gradient = c psi~ e

(Kaufman's variable projection, kept recursively).  ``R = H + delta I`` then makes the step
``theta <- theta + R^-1 gradient``, held within bounds.  The gain ratio (28) compares what the
step does to this sample's residual with what the quadratic model predicted.

Residuals are measured minus predicted.
"""

import math

import numba

from rpms_ros.identification.recursion_state import NONLINEAR
from rpms_ros.identification.recursion_state import RecordArray
from rpms_ros.identification.recursion_state import Recursion
from rpms_ros.identification.recursion_state import RecursionConstants
from rpms_ros.identification.recursion_state import RecursionState
from rpms_ros.identification.recursion_state import Workspace
from rpms_ros.identification.regressor_kernel import basis_of_pulses
from rpms_ros.identification.regressor_kernel import mix
from rpms_ros.identification.regressor_kernel import regress
from rpms_ros.identification.regressor_kernel import regress_with_gradient
from rpms_ros.identification.small_matrix import condition_number
from rpms_ros.identification.small_matrix import dot
from rpms_ros.identification.small_matrix import solve_positive
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

OUTPUT_ERROR_TIME = 1.0
# Covariance above which nothing is forgotten: without excitation P would grow without bound.
# Far above what a sinusoid from 0 to 1 needs, far enough below 1 / epsilon for P to stay positive.
LARGEST_COVARIANCE = 1e10


@numba.njit(cache=True)
def _plain_derivative(
    linear: FloatArray, mixing: FloatArray, raw_gradient: FloatArray, derivative: FloatArray
) -> None:
    """Write psi = d(phi^T w)/d theta (3,)."""
    count = len(linear)
    derivative[:] = 0.0
    for other in range(count):
        # w^T mixing, column by column: the raw sums need not be transformed
        weight = 0.0
        for function in range(other, count):
            weight += linear[function] * mixing[function, other]
        for place in range(NONLINEAR):
            derivative[place] += weight * raw_gradient[place, other]


@numba.njit(cache=True)
def _gain(
    covariance: FloatArray, regressor: FloatArray, forgetting: float, gain: FloatArray
) -> tuple[float, float]:
    """Write P phi into `gain`; return lambda + phi^T P phi and the lambda that was used."""
    count = len(regressor)
    largest = 0.0
    for row in range(count):
        largest = max(largest, covariance[row, row])
        gain[row] = dot(covariance[row], regressor)
    used = forgetting if largest < LARGEST_COVARIANCE else 1.0
    return used + dot(gain, regressor), used


@numba.njit(cache=True)
def _update_linear(
    state: RecursionState,
    gain: FloatArray,
    innovation: FloatArray,
    error: float,
    denominator: float,
    forgetting: float,
) -> None:
    """Recursive least squares for w and P and, with the same gain, for W."""
    count = len(gain)
    linear, covariance, projection = state.linear, state.covariance, state.projection
    for row in range(count):
        share = gain[row] / denominator
        linear[row] += share * error
        for place in range(NONLINEAR):
            projection[place, row] += share * innovation[place]
        for column in range(row + 1):
            value = (covariance[row, column] - share * gain[column]) / forgetting
            covariance[row, column] = value
            covariance[column, row] = value


@numba.njit(cache=True)
def _damped_step(
    state: RecursionState, constants: RecursionConstants, work: Workspace, error: float
) -> None:
    """Write the step R^-1 psi~ e, R kept well conditioned by the damping.

    If R is not positive there is no step, and it is counted.
    """
    damped, scalars = work.damped, state.scalars
    damped[:] = state.hessian
    for row in range(NONLINEAR):
        damped[row, row] += scalars['damping'][0]
        work.step[row] = work.derivative[row] * error
    scalars['condition_number'][0] = condition_number(damped, work.rotated)
    if scalars['condition_number'][0] > constants.condition_limit:
        scalars['damping'][0] += constants.damping_increment
        for row in range(NONLINEAR):
            damped[row, row] += constants.damping_increment
    if not solve_positive(damped, work.step):
        scalars['failures'][0] += 1


@numba.njit(cache=True)
def _bounded(theta: FloatArray, constants: RecursionConstants, work: Workspace) -> None:
    """Write theta + step, held within bounds, into the candidate."""
    candidate = work.candidate
    candidate[NONLINEAR] = theta[NONLINEAR]
    for row in range(NONLINEAR):
        value = theta[row] + work.step[row]
        candidate[row] = min(max(value, constants.lower[row]), constants.upper[row])
    candidate[1] = max(candidate[1], candidate[0] + constants.separation)


@numba.njit(cache=True)
def _predicted_reduction(
    hessian: FloatArray, step: FloatArray, derivative: FloatArray, error: float
) -> float:
    """Return the reduction of the cost that the quadratic model (24) predicts."""
    total = 0.0
    for row in range(NONLINEAR):
        total += step[row] * (derivative[row] * error - 0.5 * dot(hessian[row], step))
    return total


@numba.njit(cache=True)
def _judge(
    scalars: RecordArray, constants: RecursionConstants, actual: float, predicted: float
) -> bool:
    """Adapt the damping by the gain ratio (28); return whether the step is taken."""
    ratio = actual / predicted if predicted > 0.0 else -1.0
    if ratio < constants.gain_ratio_margin:
        scalars['damping'][0] *= constants.damping_factor
    elif ratio > 1.0 - constants.gain_ratio_margin:
        scalars['damping'][0] /= constants.damping_factor
    return ratio >= 0.0


@numba.njit(cache=True)
def _learn(
    force: float,
    error: float,
    intensity: FloatArray,
    first: int,
    last: int,
    state: RecursionState,
    constants: RecursionConstants,
    work: Workspace,
) -> None:
    """Update the state by one sample whose regressors are in the workspace."""
    scalars = state.scalars
    derivative, regressor, linear = work.derivative, work.regressor, state.linear
    _plain_derivative(linear, constants.mixing, work.raw_gradient, derivative)
    denominator, forgetting = _gain(state.covariance, regressor, constants.forgetting, work.gain)
    for place in range(NONLINEAR):
        work.step[place] = derivative[place] - dot(state.projection[place], regressor)
    _update_linear(state, work.gain, work.step, error, denominator, forgetting)
    factor = 1.0
    if constants.projected:
        factor = forgetting / denominator
        derivative[:] = work.step
    scale = constants.force_scale
    scaled_error = factor * error / scale
    hessian = state.hessian
    for row in range(NONLINEAR):
        derivative[row] /= scale
    for row in range(NONLINEAR):
        for column in range(NONLINEAR):
            outer = factor * derivative[row] * derivative[column]
            hessian[row, column] = constants.forgetting * hessian[row, column] + outer
    _damped_step(state, constants, work, scaled_error)
    _bounded(state.theta, constants, work)
    predicted = _predicted_reduction(hessian, work.step, derivative, scaled_error)
    before = (force - dot(regressor, linear)) / scale
    regress(intensity, first, last, work.candidate, work.basis, work.raw)
    mix(constants.mixing, work.raw, regressor)
    after = (force - dot(regressor, linear)) / scale
    if _judge(scalars, constants, 0.5 * (before * before - after * after), predicted):
        state.theta[:] = work.candidate


@numba.njit(cache=True)
def process(
    stamp_ns: IntArray,
    force: FloatArray,
    usable: BoolArray,
    onset_ns: IntArray,
    intensity: FloatArray,
    recursion: Recursion,
    prediction: FloatArray,
) -> None:
    """Run the recursion over ascending samples (samples,) and ascending pulses (pulses,).

    Writes the a-priori prediction of each sample and updates the state in place.  A sample on
    which no pulse acts does not inform about the parameters: the state does not change.
    """
    constants, state, work = recursion.constants, recursion.state, recursion.work
    shape, scalars = constants.shape, state.scalars
    span_ns = shape[0] * (shape[1] + 0.5)
    first = 0
    last = 0
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        while last < len(onset_ns) and onset_ns[last] < stamp:
            last += 1
        while first < last and stamp - onset_ns[first] > span_ns:
            first += 1
        basis_of_pulses(stamp, onset_ns, first, last, shape, work.basis)
        recruits = regress_with_gradient(
            intensity,
            first,
            last,
            state.theta,
            work.basis,
            work.raw,
            work.raw_gradient,
            work.scratch,
        )
        mix(constants.mixing, work.raw, work.regressor)
        prediction[index] = dot(work.regressor, state.linear) if recruits else 0.0
        if not usable[index]:
            continue
        decay = math.exp(-(stamp - scalars['previous_ns'][0]) * 1e-9 / OUTPUT_ERROR_TIME)
        scalars['previous_ns'][0] = stamp
        error = force[index] - prediction[index]
        scalars['error_energy'][0] = decay * scalars['error_energy'][0] + error * error
        scalars['force_energy'][0] = (
            decay * scalars['force_energy'][0] + force[index] * force[index]
        )
        if recruits:
            _learn(force[index], error, intensity, first, last, state, constants, work)
            scalars['samples'][0] += 1
