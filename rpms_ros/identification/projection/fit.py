"""State of a fit, what is known besides the cells, and the linear unknowns (Eq. 22)."""

import math
from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.projection.cells import Cells
from rpms_ros.identification.projection.normal_equations import PARAMETERS
from rpms_ros.identification.projection.normal_equations import Baseline
from rpms_ros.identification.projection.normal_equations import Pass
from rpms_ros.identification.projection.normal_equations import linear_pass
from rpms_ros.identification.small_matrix import solve_positive
from rpms_ros.pulses import FloatArray

# Places in `Fit.scalars`
COST, SAMPLES, ENERGY, SQUARES, VARIANCE, DAMPING, MOVED, FAILURES = range(8)
# The model's error is taken to be at least this share of the force's mean square [1], with the
# weight of this many samples: a fit to a handful of samples must not believe itself.
_MODEL_ERROR = 1e-4
_MODEL_ERROR_SAMPLES = 200.0
LEAST_ENERGY = 1e-18


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
    scalars : ndarray (8,)
        See the indices above; FAILURES counts matrices that could not be factorised.
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
    scalars = np.zeros(8)
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
    power = fit.scalars[ENERGY] / max(fit.scalars[SAMPLES], 1.0) + LEAST_ENERGY
    # The variance is above the power only where it is remembered from before a gap.
    value: float = 1e-2 * fit.scalars[VARIANCE] / max(power, fit.scalars[VARIANCE])
    return value


@numba.njit(cache=True)
def away_from_reference(fit: Fit, known: Known) -> FloatArray:
    """Return [theta, w] less where the cost of the left cells is expanded."""
    away = np.empty(len(known.reference))
    for place in range(PARAMETERS):
        away[place] = coordinate(fit.theta, place)
    away[PARAMETERS:] = fit.linear
    away -= known.reference
    return away


@numba.njit(cache=True)
def remembers(known: Known) -> bool:
    """Return whether cells that have left say anything."""
    found: bool = known.information[PARAMETERS, PARAMETERS] > 0.0
    return found


@numba.njit(cache=True)
def linear_matrix(fit: Fit, known: Known) -> FloatArray:
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
    away = away_from_reference(fit, known)
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
    """Solve for w and b at ``fit.theta``; they stay, and it is counted, if that fails."""
    functions = len(fit.linear)
    matrix = linear_matrix(fit, known)
    right = fit.right[PARAMETERS:].copy()
    before = fit.linear.copy()
    fit.linear[:] = 0.0
    away = away_from_reference(fit, known)
    fit.linear[:] = before
    for row in range(functions):
        at = PARAMETERS + row
        right[row] += known.pull[at]
        for other in range(len(away)):
            right[row] -= known.information[at, other] * away[other]
    if not solve_positive(matrix, right):
        fit.scalars[FAILURES] += 1.0
        return
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
    power = energy / max(samples, 1.0) + LEAST_ENERGY
    if refresh and scalars[VARIANCE] == 0.0:
        scalars[VARIANCE] = 0.01 * power
    _solve_linear(fit, known)
    squares = _squares(fit)
    scalars[SQUARES] = max(squares, 0.0)
    if refresh and remembers(known) and samples < _MODEL_ERROR_SAMPLES:
        # After a gap a few samples say less of the variance than what was known before it.
        kept = (_MODEL_ERROR_SAMPLES - samples) * scalars[VARIANCE]
        scalars[VARIANCE] = (scalars[SQUARES] + kept) / _MODEL_ERROR_SAMPLES
    elif refresh:
        doubt = _MODEL_ERROR_SAMPLES * _MODEL_ERROR * power
        scalars[VARIANCE] = (scalars[SQUARES] + doubt) / (samples + _MODEL_ERROR_SAMPLES)
    scalars[COST] = squares + _known_cost(fit, known)
