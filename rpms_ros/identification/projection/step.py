r"""Steps of variable projection: the linear unknowns by Cholesky, the others by Gauss-Newton.

For given theta the linear unknowns ``l = [w, b]`` follow from ``(M + C)_ll l = r`` (Eq. 22), where
M, r come from the cells and C holds what is known besides them: a ridge, and what cells that
have left the horizon had said.  Putting l back leaves a cost of theta alone, whose Gauss-Newton
matrix in Kaufman's form is the Schur complement

.. math:: H = M_{\theta\theta} - M_{\theta l} M_{ll}^{-1} M_{l \theta}, \qquad
          g = \Psi^T (y - \Phi w - B b).

``(H + mu diag H) d = g`` is the Levenberg-Marquardt step, held within bounds by fixing what
would leave them and solving again for the rest.  The neglected term of the full
Golub-Pereyra derivative is of second order in the residual, which is small here; the gradient g
is exact either way.

Normal equations are formed, not a QR factorisation: the Laguerre functions are orthonormal and
their regressors stay below a condition number of 1e4 (1e8 squared), so eight digits are left, and
a sum over cells can be kept, added to and taken apart, which rows of a QR cannot.
"""

import math
from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.projection.cells import Cells
from rpms_ros.identification.projection.normal_equations import PARAMETERS
from rpms_ros.identification.projection.normal_equations import Baseline
from rpms_ros.identification.projection.normal_equations import Pass
from rpms_ros.identification.projection.normal_equations import gradient_pass
from rpms_ros.identification.projection.normal_equations import linear_pass
from rpms_ros.identification.small_matrix import solve_positive
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray

# Places in `Fit.scalars`
COST, SAMPLES, ENERGY, SQUARES, VARIANCE, DAMPING, MOVED = range(7)
LEAST_DAMPING = 1e-9
MOST_DAMPING = 1e6
# Differences of cost below this share of sum y^2 are rounding.
_ROUNDING = 1e-13
# The model's error is taken to be at least this share of the force's mean square [1], with the
# weight of this many samples: a fit to a handful of samples must not believe itself.
_MODEL_ERROR = 1e-4
_MODEL_ERROR_SAMPLES = 200.0
_LEAST_ENERGY = 1e-18


class Fit(NamedTuple):
    """A fit: where it stands, and the equations at that point.

    Attributes
    ----------
    theta : ndarray (4,)
        u_thr, u_sat, alpha_sat, alpha_thr.
    linear : ndarray (functions,)
        w.
    levels : ndarray (knots,)
        b [N].
    matrix, right : ndarray (unknowns, unknowns), (unknowns,)
        Sums from the cells, lower triangle.
    complete : ndarray (unknowns, unknowns)
        The newest matrix that had the rows of theta too.
    scalars : ndarray (7,)
        See the indices above.
    """

    theta: FloatArray
    linear: FloatArray
    levels: FloatArray
    matrix: FloatArray
    right: FloatArray
    complete: FloatArray
    scalars: FloatArray


class Known(NamedTuple):
    """What is known besides the cells.

    Attributes
    ----------
    mean, deviation : ndarray (4,)
        Weak physiological prior of theta, alpha as logarithms.
    lower, upper : ndarray (4,)
        Bounds of theta.
    separation : float
        u_sat is at least this far above u_thr.
    information : ndarray (4 + functions, 4 + functions)
        Of the cells that have left, about [theta, w] with alpha as logarithms.
    pull : ndarray (4 + functions,)
        Minus the gradient of their cost at `reference`.
    reference : ndarray (4 + functions,)
        Where that cost is expanded.
    """

    mean: FloatArray
    deviation: FloatArray
    lower: FloatArray
    upper: FloatArray
    separation: float
    information: FloatArray
    pull: FloatArray
    reference: FloatArray


def empty_fit(theta: FloatArray, functions: int, knots: int) -> Fit:
    """Return a fit that has seen nothing."""
    unknowns = PARAMETERS + functions + knots
    scalars = np.zeros(7)
    scalars[DAMPING] = 1e-3
    return Fit(
        theta=theta.copy(),
        linear=np.zeros(functions),
        levels=np.zeros(knots),
        matrix=np.zeros((unknowns, unknowns)),
        right=np.zeros(unknowns),
        complete=np.zeros((unknowns, unknowns)),
        scalars=scalars,
    )


@numba.njit(cache=True)
def coordinate(theta: FloatArray, place: int) -> float:
    """Return a parameter as it is stepped: alpha as its logarithm."""
    if place >= 2:
        return math.log(theta[place])
    value: float = theta[place]
    return value


@numba.njit(cache=True)
def weak_ridge(fit: Fit) -> float:
    """Return a ridge that keeps w and b solvable and is too weak to be seen otherwise."""
    power = fit.scalars[ENERGY] / max(fit.scalars[SAMPLES], 1.0) + _LEAST_ENERGY
    value: float = 1e-2 * fit.scalars[VARIANCE] / power
    return value


@numba.njit(cache=True)
def _away(fit: Fit, known: Known) -> FloatArray:
    """Return [theta, w] less where the cost of the left cells is expanded."""
    away = np.empty(len(known.reference))
    for place in range(PARAMETERS):
        away[place] = coordinate(fit.theta, place)
    away[PARAMETERS:] = fit.linear
    away -= known.reference
    return away


@numba.njit(cache=True)
def _linear_matrix(fit: Fit, known: Known) -> FloatArray:
    """Return the lower triangle of the matrix of w and b, what is known included."""
    functions = len(fit.linear)
    count = functions + len(fit.levels)
    matrix = np.empty((count, count))
    ridge = weak_ridge(fit)
    for row in range(count):
        for column in range(row + 1):
            matrix[row, column] = fit.matrix[PARAMETERS + row, PARAMETERS + column]
            if row < functions:
                matrix[row, column] += known.information[PARAMETERS + row, PARAMETERS + column]
        matrix[row, row] += ridge
    return matrix


@numba.njit(cache=True)
def _known_cost(fit: Fit, known: Known) -> float:
    """Return the cost of the left cells, of the ridge and of the prior at the fit's point."""
    cost = 0.0
    away = _away(fit, known)
    for row in range(len(away)):
        cost -= 2.0 * known.pull[row] * away[row]
        for column in range(len(away)):
            cost += away[row] * known.information[row, column] * away[column]
    ridge = weak_ridge(fit)
    for value in fit.linear:
        cost += ridge * value * value
    for value in fit.levels:
        cost += ridge * value * value
    for place in range(PARAMETERS):
        strange = (coordinate(fit.theta, place) - known.mean[place]) / known.deviation[place]
        cost += fit.scalars[VARIANCE] * strange * strange
    return cost


@numba.njit(cache=True)
def _squares(fit: Fit) -> float:
    """Return the sum of squared residuals at the fit's w and b."""
    linear = np.concatenate((fit.linear, fit.levels))
    total = fit.scalars[ENERGY]
    for row in range(len(linear)):
        at = PARAMETERS + row
        inner = 0.5 * fit.matrix[at, at] * linear[row]
        for column in range(row):
            inner += fit.matrix[at, PARAMETERS + column] * linear[column]
        total += 2.0 * linear[row] * (inner - fit.right[at])
    value: float = total
    return value


@numba.njit(cache=True)
def _solve_linear(fit: Fit, known: Known) -> None:
    """Solve for w and b at ``fit.theta``."""
    functions = len(fit.linear)
    matrix = _linear_matrix(fit, known)
    right = fit.right[PARAMETERS:].copy()
    fit.linear[:] = 0.0
    away = _away(fit, known)
    for row in range(functions):
        at = PARAMETERS + row
        right[row] += known.pull[at]
        for other in range(len(away)):
            right[row] -= known.information[at, other] * away[other]
    solve_positive(matrix, right)
    fit.linear[:] = right[:functions]
    fit.levels[:] = right[functions:]


@numba.njit(cache=True)
def fit_linear(
    cells: Cells,
    first: int,
    kick: float,
    baseline: Baseline,
    known: Known,
    work: Pass,
    fit: Fit,
    refresh: bool,
) -> None:
    """Solve the linear unknowns at ``fit.theta``; with `refresh`, the variance anew before.

    The variance scales what is weakly known; it stays while two parameter sets are compared.
    """
    samples, energy = linear_pass(
        cells,
        first,
        cells.place[1],
        fit.theta,
        kick,
        baseline,
        work,
        fit.matrix,
        fit.right,
    )
    scalars = fit.scalars
    scalars[SAMPLES] = samples
    scalars[ENERGY] = energy
    power = energy / max(samples, 1.0) + _LEAST_ENERGY
    if refresh and scalars[VARIANCE] == 0.0:
        scalars[VARIANCE] = 0.01 * power
    _solve_linear(fit, known)
    squares = _squares(fit)
    scalars[SQUARES] = max(squares, 0.0)
    if refresh:
        doubt = _MODEL_ERROR_SAMPLES * _MODEL_ERROR * power
        scalars[VARIANCE] = (scalars[SQUARES] + doubt) / (samples + _MODEL_ERROR_SAMPLES)
    scalars[COST] = squares + _known_cost(fit, known)


@numba.njit(cache=True)
def _gradient(fit: Fit, known: Known, gradient: FloatArray) -> None:
    """Write minus half the gradient of the cost by theta (4,)."""
    functions = len(fit.linear)
    away = _away(fit, known)
    for place in range(PARAMETERS):
        total = fit.right[place] + known.pull[place]
        for row in range(functions):
            total -= fit.matrix[PARAMETERS + row, place] * fit.linear[row]
        for row in range(len(fit.levels)):
            total -= fit.matrix[PARAMETERS + functions + row, place] * fit.levels[row]
        for other in range(len(away)):
            total -= known.information[place, other] * away[other]
        strange = coordinate(fit.theta, place) - known.mean[place]
        gradient[place] = total - fit.scalars[VARIANCE] * strange / known.deviation[place] ** 2


@numba.njit(cache=True)
def _reduced_hessian(fit: Fit, known: Known, hessian: FloatArray) -> None:
    """Write the Schur complement of theta (4, 4)."""
    functions = len(fit.linear)
    columns = fit.matrix[PARAMETERS:, :PARAMETERS].T.copy()
    columns[:, :functions] += known.information[:PARAMETERS, PARAMETERS:]
    for place in range(PARAMETERS):
        solved = columns[place].copy()
        solve_positive(_linear_matrix(fit, known), solved)
        for other in range(place, PARAMETERS):
            entry = fit.matrix[other, place] + known.information[other, place]
            if other == place:
                entry += fit.scalars[VARIANCE] / known.deviation[place] ** 2
            for row in range(len(solved)):
                entry -= columns[other, row] * solved[row]
            hessian[other, place] = entry
            hessian[place, other] = entry


@numba.njit(cache=True)
def _damped_step(
    hessian: FloatArray,
    gradient: FloatArray,
    damping: float,
    held: BoolArray,
    step: FloatArray,
) -> None:
    """Solve for the steps (4,) that are not held, given those that are."""
    matrix = hessian.copy()
    right = gradient.copy()
    for place in range(PARAMETERS):
        matrix[place, place] *= 1.0 + damping
        for other in range(PARAMETERS):
            if held[other] and not held[place]:
                right[place] -= hessian[place, other] * step[other]
    for place in range(PARAMETERS):
        if held[place]:
            matrix[place] = 0.0
            matrix[:, place] = 0.0
            matrix[place, place] = 1.0
            right[place] = step[place]
    solve_positive(matrix, right)
    step[:] = right


@numba.njit(cache=True)
def _part(known: Known, candidate: FloatArray) -> None:
    """Keep u_sat above u_thr, about where both would be."""
    lacking = known.separation - (candidate[1] - candidate[0])
    if lacking > 0.0:
        candidate[0] = max(candidate[0] - 0.5 * lacking, known.lower[0])
        candidate[1] = candidate[0] + known.separation


@numba.njit(cache=True)
def _bounded_step(
    theta: FloatArray,
    known: Known,
    hessian: FloatArray,
    gradient: FloatArray,
    damping: float,
    candidate: FloatArray,
) -> None:
    """Write theta after a damped step (4,) that stays within the bounds."""
    step = np.zeros(PARAMETERS)
    held = np.zeros(PARAMETERS, dtype=np.bool_)
    for _ in range(PARAMETERS):
        _damped_step(hessian, gradient, damping, held, step)
        left = False
        for place in range(PARAMETERS):
            here = coordinate(theta, place)
            low = coordinate(known.lower, place) - here
            high = coordinate(known.upper, place) - here
            if not held[place] and not low <= step[place] <= high:
                step[place] = low if step[place] < low else high
                held[place] = True
                left = True
        if not left:
            break
    for place in range(PARAMETERS):
        value = coordinate(theta, place) + step[place]
        candidate[place] = math.exp(value) if place >= 2 else value
        candidate[place] = min(max(candidate[place], known.lower[place]), known.upper[place])
    _part(known, candidate)


@numba.njit(cache=True)
def _promise(
    fit: Fit, theta: FloatArray, hessian: FloatArray, gradient: FloatArray
) -> tuple[float, float]:
    """Return the reduction that the quadratic model promises for theta, and the largest step."""
    step = np.empty(PARAMETERS)
    for place in range(PARAMETERS):
        step[place] = coordinate(theta, place) - coordinate(fit.theta, place)
    promised = 0.0
    for place in range(PARAMETERS):
        promised += 2.0 * gradient[place] * step[place]
        for other in range(PARAMETERS):
            promised -= step[place] * hessian[place, other] * step[other]
    return promised, np.abs(step).max()


@numba.njit(cache=True)
def _accept(fit: Fit, trial: Fit, size: float, good: bool) -> None:
    """Go where the trial is."""
    damping = fit.scalars[DAMPING]
    fit.theta[:] = trial.theta
    fit.linear[:] = trial.linear
    fit.levels[:] = trial.levels
    fit.matrix[:] = trial.matrix
    fit.right[:] = trial.right
    fit.scalars[:] = trial.scalars
    fit.scalars[DAMPING] = max(damping * (0.1 if good else 1.0), LEAST_DAMPING)
    fit.scalars[MOVED] = size


@numba.njit(cache=True)
def improve(
    cells: Cells,
    first: int,
    kick: float,
    baseline: Baseline,
    known: Known,
    work: Pass,
    fit: Fit,
    trial: Fit,
    steps: int,
    tolerance: float,
) -> None:
    """Take up to so many Levenberg-Marquardt steps from `fit`, whose linear part is solved.

    A step that does not lower the cost is not taken; damping rises and the next one is shorter.
    Ends early when the reduction that a step promises falls below `tolerance` times the cost.
    `trial` is scratch of the same shape.
    """
    hessian = np.zeros((PARAMETERS, PARAMETERS))
    gradient = np.zeros(PARAMETERS)
    scalars = fit.scalars
    fresh = False
    if scalars[SAMPLES] == 0.0:
        return
    for _ in range(steps):
        if not fresh:
            gradient_pass(
                cells,
                first,
                cells.place[1],
                fit.theta,
                fit.linear,
                kick,
                baseline,
                work,
                fit.matrix,
                fit.right,
            )
            fit.complete[:] = fit.matrix
            _gradient(fit, known, gradient)
            _reduced_hessian(fit, known, hessian)
            fresh = True
        _bounded_step(fit.theta, known, hessian, gradient, scalars[DAMPING], trial.theta)
        promised, size = _promise(fit, trial.theta, hessian, gradient)
        trial.scalars[VARIANCE] = scalars[VARIANCE]
        fit_linear(cells, first, kick, baseline, known, work, trial, False)
        actual = scalars[COST] - trial.scalars[COST]
        if actual >= -_ROUNDING * scalars[ENERGY]:
            _accept(fit, trial, size, actual > 0.5 * promised)
            fresh = False
        else:
            scalars[DAMPING] = min(max(10.0 * scalars[DAMPING], 1e-6), MOST_DAMPING)
        if promised <= tolerance * (scalars[COST] + _LEAST_ENERGY):
            break


@numba.njit(cache=True)
def complete_equations(
    cells: Cells, first: int, kick: float, baseline: Baseline, known: Known, work: Pass, fit: Fit
) -> None:
    """Make matrix and right-hand side of `fit` complete at its parameters, theta included."""
    fit_linear(cells, first, kick, baseline, known, work, fit, False)
    gradient_pass(
        cells,
        first,
        cells.place[1],
        fit.theta,
        fit.linear,
        kick,
        baseline,
        work,
        fit.matrix,
        fit.right,
    )
    fit.complete[:] = fit.matrix
