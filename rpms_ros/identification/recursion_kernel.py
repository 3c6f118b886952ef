r"""One sample of the modified recursive Levenberg-Marquardt algorithm, compiled.

Model (Eqs. 13 to 16): ``y = phi(theta)^T w``, with ``phi = sum_q rho(theta, u_q) r(t - t_q)``
over the pulses that still act.  Two recursions run side by side on the cost (19):

*Linear parameters*, Eq. (22) by recursive least squares with covariance P::

    K = P phi / (lambda + phi^T P phi),   w <- w + K e,   P <- (P - K phi^T P) / lambda

*Nonlinear parameters*, Eqs. (24) to (28).  The plain derivative ``psi = d(phi^T w)/d theta`` at
fixed w leads nowhere: most of what a step in theta does, w undoes at once.  What w cannot undo
is the part of psi that lies off the linear regressors.  Regressing psi on phi by the same least
squares, with the same gain, gives it recursively::

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
from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.basis import distorted_sines
from rpms_ros.identification.small_matrix import condition_number
from rpms_ros.identification.small_matrix import solve_positive
from rpms_ros.muscle.identified_form import evaluate_with_gradient
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

NONLINEAR = 3
OUTPUT_ERROR_TIME = 1.0

# Places in `RecursionState.scalars`
DAMPING, CONDITION, ERROR_ENERGY, FORCE_ENERGY, FORCE_SQUARES, SAMPLES = range(6)
# Covariance above which forgetting pauses: P would grow without end where nothing excites it.
LARGEST_COVARIANCE = 1e12


class RecursionState(NamedTuple):
    """Everything that the recursion remembers, updated in place.

    Attributes
    ----------
    theta : ndarray (3,)
        u_thr, u_sat, alpha_sat.
    linear : ndarray (n,)
        w.
    covariance : ndarray (n, n)
        P.
    projection : ndarray (n, 3)
        W, regression of the derivatives on the linear regressors.
    hessian : ndarray (3, 3)
        H.
    scalars : ndarray (6,)
        See the indices above.
    """

    theta: FloatArray
    linear: FloatArray
    covariance: FloatArray
    projection: FloatArray
    hessian: FloatArray
    scalars: FloatArray


class RecursionConstants(NamedTuple):
    """What does not change: the basis and the design parameters of Tables 4 and 5."""

    tap_ns: float
    memory_taps: float
    form_factor: float
    mixing: FloatArray
    alpha_thr: float
    forgetting: float
    damping_factor: float
    gain_ratio_margin: float
    condition_limit: float
    damping_increment: float
    projected: bool
    lower: FloatArray
    upper: FloatArray
    separation: float


class Workspace(NamedTuple):
    """Arrays that every sample overwrites, allocated once."""

    basis: FloatArray
    raw: FloatArray
    raw_gradient: FloatArray
    regressor: FloatArray
    gain: FloatArray
    gradient: FloatArray
    derivative: FloatArray
    damped: FloatArray
    step: FloatArray
    candidate: FloatArray


def workspace(functions: int) -> Workspace:
    """Return arrays for a basis of `functions` functions."""
    return Workspace(
        basis=np.zeros(functions),
        raw=np.zeros(functions),
        raw_gradient=np.zeros((functions, NONLINEAR)),
        regressor=np.zeros(functions),
        gain=np.zeros(functions),
        gradient=np.zeros(4),
        derivative=np.zeros(NONLINEAR),
        damped=np.zeros((NONLINEAR, NONLINEAR)),
        step=np.zeros(NONLINEAR),
        candidate=np.zeros(NONLINEAR),
    )


@numba.njit(cache=True)
def _regress(
    stamp: int,
    onset_ns: IntArray,
    intensity: FloatArray,
    theta: FloatArray,
    constants: RecursionConstants,
    work: Workspace,
    with_gradient: bool,
) -> bool:
    """Form phi, and the raw sums for its derivatives; return whether any pulse acts."""
    count = len(work.raw)
    work.raw[:] = 0.0
    if with_gradient:
        work.raw_gradient[:] = 0.0
    acting = False
    for pulse in range(len(onset_ns)):
        tap = (stamp - onset_ns[pulse]) / constants.tap_ns
        if not distorted_sines(tap, constants.memory_taps, constants.form_factor, work.basis):
            continue
        rho = evaluate_with_gradient(
            intensity[pulse], theta[0], theta[1], theta[2], constants.alpha_thr, work.gradient
        )
        acting = acting or rho != 0.0
        for function in range(count):
            work.raw[function] += rho * work.basis[function]
            if with_gradient:
                for place in range(NONLINEAR):
                    work.raw_gradient[function, place] += (
                        work.gradient[place] * work.basis[function]
                    )
    for function in range(count):
        total = 0.0
        for other in range(function + 1):
            total += constants.mixing[function, other] * work.raw[other]
        work.regressor[function] = total
    return acting


@numba.njit(cache=True)
def _plain_derivative(linear: FloatArray, constants: RecursionConstants, work: Workspace) -> None:
    """Write psi = d(phi^T w)/d theta into the workspace."""
    count = len(linear)
    work.derivative[:] = 0.0
    for other in range(count):
        # w^T mixing, column by column: the raw sums need not be transformed
        weight = 0.0
        for function in range(other, count):
            weight += linear[function] * constants.mixing[function, other]
        for place in range(NONLINEAR):
            work.derivative[place] += weight * work.raw_gradient[other, place]


@numba.njit(cache=True)
def _update_linear(
    state: RecursionState, constants: RecursionConstants, work: Workspace, error: float
) -> float:
    """Recursive least squares for w and, with the same gain, for W; return the factor c."""
    count = len(state.linear)
    quadratic = 0.0
    largest = 0.0
    for row in range(count):
        total = 0.0
        for column in range(count):
            total += state.covariance[row, column] * work.regressor[column]
        work.gain[row] = total
        quadratic += total * work.regressor[row]
        largest = max(largest, state.covariance[row, row])
    forgetting = constants.forgetting if largest < LARGEST_COVARIANCE else 1.0
    denominator = forgetting + quadratic
    for place in range(NONLINEAR):
        for row in range(count):
            work.derivative[place] -= state.projection[row, place] * work.regressor[row]
    for row in range(count):
        gain = work.gain[row] / denominator
        state.linear[row] += gain * error
        for place in range(NONLINEAR):
            state.projection[row, place] += gain * work.derivative[place]
        for column in range(row, count):
            value = (state.covariance[row, column] - gain * work.gain[column]) / forgetting
            state.covariance[row, column] = value
            state.covariance[column, row] = value
    return forgetting / denominator


@numba.njit(cache=True)
def _damped_step(
    state: RecursionState, constants: RecursionConstants, work: Workspace, scaled_error: float
) -> float:
    """Write the step R^-1 gradient, held within bounds; return its predicted reduction."""
    for row in range(NONLINEAR):
        for column in range(NONLINEAR):
            work.damped[row, column] = state.hessian[row, column]
    for row in range(NONLINEAR):
        work.damped[row, row] += state.scalars[DAMPING]
    condition = condition_number(work.damped)
    state.scalars[CONDITION] = condition
    if condition > constants.condition_limit:
        state.scalars[DAMPING] += constants.damping_increment
        for row in range(NONLINEAR):
            work.damped[row, row] += constants.damping_increment
    for row in range(NONLINEAR):
        work.step[row] = work.derivative[row] * scaled_error
    solve_positive(work.damped, work.step)
    for row in range(NONLINEAR):
        value = state.theta[row] + work.step[row]
        work.candidate[row] = min(max(value, constants.lower[row]), constants.upper[row])
    work.candidate[1] = max(work.candidate[1], work.candidate[0] + constants.separation)
    predicted = 0.0
    for row in range(NONLINEAR):
        curvature = 0.0
        for column in range(NONLINEAR):
            curvature += state.hessian[row, column] * work.step[column]
        predicted += work.step[row] * (work.derivative[row] * scaled_error - 0.5 * curvature)
    return predicted


@numba.njit(cache=True)
def _judge(
    state: RecursionState, constants: RecursionConstants, actual: float, predicted: float
) -> bool:
    """Adapt the damping by the gain ratio (28); return whether the step is taken."""
    ratio = actual / predicted if predicted > 0.0 else -1.0
    if ratio < constants.gain_ratio_margin:
        state.scalars[DAMPING] *= constants.damping_factor
    elif ratio > 1.0 - constants.gain_ratio_margin:
        state.scalars[DAMPING] /= constants.damping_factor
    return ratio >= 0.0


@numba.njit(cache=True)
def _dot(left: FloatArray, right: FloatArray) -> float:
    total = 0.0
    for index in range(len(left)):
        total += left[index] * right[index]
    return total


@numba.njit(cache=True)
def _learn(
    stamp: int,
    force: float,
    prediction: float,
    onset_ns: IntArray,
    intensity: FloatArray,
    state: RecursionState,
    constants: RecursionConstants,
    work: Workspace,
) -> None:
    """Update the state by one sample whose regressors are in the workspace."""
    error = force - prediction
    state.scalars[SAMPLES] += 1.0
    state.scalars[FORCE_SQUARES] += force * force
    _plain_derivative(state.linear, constants, work)
    if constants.projected:
        factor = _update_linear(state, constants, work, error)
        scaled_error = factor * error
    else:
        plain = work.derivative.copy()
        _update_linear(state, constants, work, error)
        work.derivative[:] = plain
        factor = 1.0
        scaled_error = error
    # The damping is an absolute number: in forces of unit mean square it means the same for a
    # finger and for an arm.
    scale = math.sqrt(state.scalars[FORCE_SQUARES] / state.scalars[SAMPLES])
    if scale == 0.0:
        return
    scaled_error /= scale
    for row in range(NONLINEAR):
        work.derivative[row] /= scale
    for row in range(NONLINEAR):
        for column in range(NONLINEAR):
            outer = factor * work.derivative[row] * work.derivative[column]
            state.hessian[row, column] = constants.forgetting * state.hessian[row, column] + outer
    predicted = _damped_step(state, constants, work, scaled_error)
    before = force - _dot(work.regressor, state.linear)
    _regress(stamp, onset_ns, intensity, work.candidate, constants, work, False)
    after = force - _dot(work.regressor, state.linear)
    if _judge(
        state, constants, 0.5 * (before * before - after * after) / (scale * scale), predicted
    ):
        state.theta[:] = work.candidate


@numba.njit(cache=True)
def process(
    stamp_ns: IntArray,
    force: FloatArray,
    usable: BoolArray,
    previous_ns: int,
    onset_ns: IntArray,
    intensity: FloatArray,
    state: RecursionState,
    constants: RecursionConstants,
    work: Workspace,
    prediction: FloatArray,
) -> int:
    """Run the recursion over ascending samples (samples,) and ascending pulses (pulses,).

    Writes the a-priori prediction of each sample, updates the state in place and returns the
    stamp of the newest usable sample, which is `previous_ns` of the next call.  A sample on
    which no pulse acts says nothing about the parameters: it is neither learnt nor forgotten.
    """
    span_ns = constants.tap_ns * (constants.memory_taps + 0.5)
    first = 0
    last = 0
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        while last < len(onset_ns) and onset_ns[last] < stamp:
            last += 1
        while first < last and stamp - onset_ns[first] > span_ns:
            first += 1
        acting_onset = onset_ns[first:last]
        acting_intensity = intensity[first:last]
        acting = _regress(
            stamp, acting_onset, acting_intensity, state.theta, constants, work, True
        )
        prediction[index] = _dot(work.regressor, state.linear) if acting else 0.0
        if not usable[index]:
            continue
        decay = math.exp(-(stamp - previous_ns) * 1e-9 / OUTPUT_ERROR_TIME)
        previous_ns = stamp
        error = force[index] - prediction[index]
        state.scalars[ERROR_ENERGY] = decay * state.scalars[ERROR_ENERGY] + error * error
        energy = decay * state.scalars[FORCE_ENERGY] + force[index] * force[index]
        state.scalars[FORCE_ENERGY] = energy
        if acting:
            _learn(
                stamp,
                force[index],
                prediction[index],
                acting_onset,
                acting_intensity,
                state,
                constants,
                work,
            )
    return previous_ns
