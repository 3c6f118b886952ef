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

*Regressors*, Eqs. (15) and (16).  Of every pulse the basis at its lag is needed, which does not
depend on the nonlinear parameters, and its recruitment, which does.  The basis is evaluated once a
sample and used again for the regressors of a trial step.
"""

from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from rpms_ros.identification.estimation.intake import count_energy
from rpms_ros.identification.model.basis import distorted_sines
from rpms_ros.identification.model.levenberg_marquardt import condition_number, dot, solve_positive
from rpms_ros.identification.model.settings import BOUNDS
from rpms_ros.muscle.recruitment import (
    SMALLEST_SEPARATION,
    arctan_recruitment,
    arctan_recruitment_with_gradient,
)
from rpms_ros.pulses import BoolArray, FloatArray, IntArray

# u_thr, u_sat and alpha_sat are identified; alpha_thr is the fourth parameter, fixed.
NONLINEAR = 3
_LOWER = np.array([low for low, _ in BOUNDS.values()])
_UPPER = np.array([high for _, high in BOUNDS.values()])
RecordArray = npt.NDArray[np.void]


# delta; condition number of R before delta_s was added; sums of squares of the a-priori error and
# of the force, decaying [N^2]; number of samples that were learnt from, and of those whose R could
# not be factorised; stamp of the newest usable sample [ns].
SCALARS = np.dtype(
    [(name, float) for name in ('damping', 'condition_number', 'error_energy', 'force_energy')]
    + [(name, np.int64) for name in ('samples', 'failures', 'previous_ns')]
)


class RecursionState(NamedTuple):
    """State of the recursion, updated in place.

    Attributes
    ----------
    theta : ndarray (4,)
        u_thr, u_sat, alpha_sat, and the fixed alpha_thr.
    linear : ndarray (n,)
        w.
    covariance : ndarray (n, n)
        P.
    projection : ndarray (3, n)
        W^T, regression of the derivatives on the linear regressors.
    hessian : ndarray (3, 3)
        H.
    scalars : structured ndarray (1,)
        The fields of `SCALARS`, in one array because each argument of a compiled call takes time.
    """

    theta: FloatArray
    linear: FloatArray
    covariance: FloatArray
    projection: FloatArray
    hessian: FloatArray
    scalars: RecordArray


class RecursionConstants(NamedTuple):
    """Constants: the basis, and design parameters of `PaperSettings` by their names there."""

    shape: FloatArray
    mixing: FloatArray
    force_scale: float
    forgetting: float
    damping_factor: float
    gain_ratio_margin: float
    condition_limit: float
    damping_increment: float
    projected: bool


class Workspace(NamedTuple):
    """Arrays that every sample overwrites, allocated once."""

    basis: FloatArray
    raw: FloatArray
    raw_gradient: FloatArray
    regressor: FloatArray
    gain: FloatArray
    scratch: FloatArray
    derivative: FloatArray
    damped: FloatArray
    step: FloatArray
    candidate: FloatArray


class Recursion(NamedTuple):
    """One recursion: its constants, its state and the arrays that it overwrites."""

    constants: RecursionConstants
    state: RecursionState
    work: Workspace


def workspace(functions: int, acting_pulses: int) -> Workspace:
    """Return arrays for so many functions, and at most so many pulses acting at once."""
    return Workspace(
        basis=np.zeros((acting_pulses, functions)),
        raw_gradient=np.zeros((NONLINEAR, functions)),
        scratch=np.zeros((2, 4)),
        candidate=np.zeros(4),
        damped=np.zeros((NONLINEAR, NONLINEAR)),
        **{name: np.zeros(functions) for name in ('raw', 'regressor', 'gain')},
        **{name: np.zeros(NONLINEAR) for name in ('derivative', 'step')},
    )


@numba.njit(cache=True)
def basis_of_pulses(
    stamp_ns: int, onset_ns: IntArray, shape: FloatArray, values: FloatArray
) -> None:
    """Write the raw basis of pulses into the first rows of `values`.

    Parameters
    ----------
    stamp_ns : int
        Time of the sample [ns].
    onset_ns : ndarray of int64, shape (pulses,)
        Onsets of the pulses that can act [ns].
    shape : ndarray (3,)
        Tap [ns], memory [taps], form factor [taps].
    values : ndarray (rows, functions)
        Zero where a pulse lies outside the support.
    """
    for pulse in range(len(onset_ns)):
        tap = (stamp_ns - onset_ns[pulse]) / shape[0]
        if not distorted_sines(tap, shape[1], shape[2], values[pulse]):
            values[pulse, :] = 0.0


@numba.njit(cache=True)
def regress(intensity: FloatArray, theta: FloatArray, work: Workspace) -> None:
    """Write ``sum_q rho(theta, u_q) r~(lag_q)`` over the rows of `work.basis` into `work.raw`."""
    offset = arctan_recruitment(0.0, theta)
    work.raw[:] = 0.0
    for pulse in range(len(intensity)):
        rho = arctan_recruitment(intensity[pulse], theta) - offset
        for function in range(len(work.raw)):
            work.raw[function] += rho * work.basis[pulse, function]


@numba.njit(cache=True)
def regress_with_gradient(intensity: FloatArray, theta: FloatArray, work: Workspace) -> bool:
    """Write the sums of `regress` and of its derivatives; return whether any pulse recruits.

    The derivatives ``sum_q d rho / d theta_j r~(lag_q)`` are those by the leading parameters.
    """
    raw, raw_gradient, scratch = work.raw, work.raw_gradient, work.scratch
    offset = arctan_recruitment_with_gradient(0.0, theta, scratch[0])
    raw[:] = 0.0
    raw_gradient[:] = 0.0
    recruits = False
    for pulse in range(len(intensity)):
        rho = arctan_recruitment_with_gradient(intensity[pulse], theta, scratch[1]) - offset
        recruits = recruits or rho != 0.0
        for function in range(len(raw)):
            raw[function] += rho * work.basis[pulse, function]
        for place in range(len(raw_gradient)):
            slope = scratch[1, place] - scratch[0, place]
            for function in range(len(raw)):
                raw_gradient[place, function] += slope * work.basis[pulse, function]
    return recruits


@numba.njit(cache=True)
def mix(mixing: FloatArray, raw: FloatArray, regressor: FloatArray) -> None:
    """Write ``mixing raw`` (functions,), mixing lower triangular, into `regressor`."""
    for function in range(len(raw)):
        regressor[function] = dot(mixing[function], raw)


# Covariance above which nothing is forgotten: without excitation P would grow without bound.
# Far above what a sinusoid from 0 to 1 needs, far enough below 1 / epsilon for P to stay positive.
LARGEST_COVARIANCE = 1e10


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
    scalars['condition_number'][0] = condition_number(damped)
    if scalars['condition_number'][0] > constants.condition_limit:
        scalars['damping'][0] += constants.damping_increment
        for row in range(NONLINEAR):
            damped[row, row] += constants.damping_increment
    if not solve_positive(damped, work.step):
        scalars['failures'][0] += 1


@numba.njit(cache=True)
def _bounded(theta: FloatArray, work: Workspace) -> None:
    """Write theta + step, held within bounds, into the candidate."""
    candidate = work.candidate
    candidate[NONLINEAR] = theta[NONLINEAR]
    for row in range(NONLINEAR):
        candidate[row] = min(max(theta[row] + work.step[row], _LOWER[row]), _UPPER[row])
    candidate[1] = max(candidate[1], candidate[0] + SMALLEST_SEPARATION)


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
def _learn(force: float, error: float, intensity: FloatArray, recursion: Recursion) -> None:
    """Update the state by one sample whose regressors are in the workspace."""
    constants, state, work = recursion.constants, recursion.state, recursion.work
    derivative, regressor, linear = work.derivative, work.regressor, state.linear
    # psi = d(phi^T w)/d theta
    derivative[:] = 0.0
    for other in range(len(linear)):
        # w^T mixing, column by column: the raw sums need not be transformed
        weight = dot(linear, constants.mixing[:, other])
        for place in range(NONLINEAR):
            derivative[place] += weight * work.raw_gradient[place, other]
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
    _bounded(state.theta, work)
    predicted = _predicted_reduction(hessian, work.step, derivative, scaled_error)
    before = (force - dot(regressor, linear)) / scale
    regress(intensity, work.candidate, work)
    mix(constants.mixing, work.raw, regressor)
    after = (force - dot(regressor, linear)) / scale
    if _judge(state.scalars, constants, 0.5 * (before * before - after * after), predicted):
        state.theta[:] = work.candidate


@numba.njit(cache=True)
def process(
    stamp_ns: IntArray,
    force: FloatArray,
    usable: BoolArray,
    onset_ns: IntArray,
    intensity: FloatArray,
    recursion: Recursion,
) -> FloatArray:
    """Run the recursion over ascending samples (samples,) and ascending pulses (pulses,).

    Returns the a-priori prediction of each sample and updates the state in place.  A sample on
    which no pulse acts does not inform about the parameters: the state does not change.
    """
    constants, state, work = recursion.constants, recursion.state, recursion.work
    shape, scalars = constants.shape, state.scalars
    energies = scalars['error_energy'], scalars['force_energy'], scalars['previous_ns']
    span_ns = shape[0] * (shape[1] + 0.5)
    prediction = np.empty(len(stamp_ns))
    first = 0
    last = 0
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        while last < len(onset_ns) and onset_ns[last] < stamp:
            last += 1
        while first < last and stamp - onset_ns[first] > span_ns:
            first += 1
        basis_of_pulses(stamp, onset_ns[first:last], shape, work.basis)
        acting = intensity[first:last]
        recruits = regress_with_gradient(acting, state.theta, work)
        mix(constants.mixing, work.raw, work.regressor)
        prediction[index] = dot(work.regressor, state.linear) if recruits else 0.0
        if not usable[index]:
            continue
        error = force[index] - prediction[index]
        count_energy(energies, stamp, error, force[index])
        if recruits:
            _learn(force[index], error, acting, recursion)
            scalars['samples'][0] += 1
    return prediction
