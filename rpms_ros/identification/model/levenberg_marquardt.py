# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""The Levenberg-Marquardt loop of every nonlinear fit in compiled code.

A fit is composed of a *problem* and three functions of a model:

* the problem holds samples or their condensed sums, the prior and the bounds;
* ``linearise`` writes the Gauss-Newton matrix H and the gradient g (minus half that of the cost)
  at a point, linear unknowns eliminated;
* ``room`` writes the least and greatest step of each parameter;
* ``move`` computes another point: parameters, linear unknowns, cost.

A point is a named tuple of arrays: ``theta`` (parameters,), what the model needs, and (1,) each
``cost``, ``energy`` (sum of the squared data), ``damping`` of the next step, ``moved`` (largest
change of the last one) and ``failures`` (matrices that could not be factorised).

The step solves ``(H + mu diag H) d = g``; parameters that would leave their bounds are fixed there
and the rest is solved again.  It is taken if it does not raise the cost; else mu rises.

The functions are compiled into the loop, without calls at run time.  They are
decorated by `numba.extending.register_jitable` and not by `numba.njit`: the key under which numba
keeps a compiled closure holds what it closes over, and a dispatcher is another one in every
process.  The algebra of symmetric matrices of a few rows is compiled too: at this size LAPACK's
calls cost more than the arithmetic, and numba offers them with allocation only.
The condition number, which only the paper's presets ask for in compiled code, is LAPACK's.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np

from rpms_ros.pulses import BoolArray, FloatArray


@numba.njit(cache=True)
def dot(left: FloatArray, right: FloatArray) -> float:
    """Return the inner product of two vectors (n,), summed from the first element on."""
    total = 0.0
    for index in range(len(left)):
        total += left[index] * right[index]
    return total


@numba.njit(cache=True)
def solve_positive(matrix: FloatArray, vector: FloatArray) -> bool:
    """Solve ``matrix x = vector`` by Cholesky, in place in both; return whether it is positive.

    Parameters
    ----------
    matrix : ndarray (n, n)
        Symmetric; its lower triangle is overwritten by the factor.
    vector : ndarray (n,)
        Right-hand side, overwritten by the solution; zeros if the matrix is not positive.
    """
    if not factorise_positive(matrix):
        vector[:] = 0.0
        return False
    solve_factorised(matrix, vector)
    return True


@numba.njit(cache=True)
def factorise_positive(matrix: FloatArray) -> bool:
    """Put the Cholesky factor (n, n) in the lower triangle; return whether there is one."""
    count = len(matrix)
    for column in range(count):
        pivot = matrix[column, column]
        for inner in range(column):
            pivot -= matrix[column, inner] * matrix[column, inner]
        if not pivot > 0.0:
            return False
        pivot = math.sqrt(pivot)
        matrix[column, column] = pivot
        for row in range(column + 1, count):
            total = matrix[row, column]
            for inner in range(column):
                total -= matrix[row, inner] * matrix[column, inner]
            matrix[row, column] = total / pivot
    return True


@numba.njit(cache=True)
def solve_factorised(matrix: FloatArray, vector: FloatArray) -> None:
    """Solve for a right-hand side (n,), in place, with the factor of `factorise_positive`."""
    count = len(vector)
    for row in range(count):
        for inner in range(row):
            vector[row] -= matrix[row, inner] * vector[inner]
        vector[row] /= matrix[row, row]
    for row in range(count - 1, -1, -1):
        for inner in range(row + 1, count):
            vector[row] -= matrix[inner, row] * vector[inner]
        vector[row] /= matrix[row, row]


@numba.njit(cache=True)
def condition_number(matrix: FloatArray) -> float:
    """Return the ratio of the largest to the smallest singular value of a symmetric matrix.

    Infinite if it is singular or not finite.
    """
    if not np.isfinite(matrix).all():
        return math.inf
    magnitude = np.abs(np.linalg.eigvalsh(matrix))
    smallest = magnitude.min()
    return float(magnitude.max() / smallest) if smallest > 0.0 else math.inf


LEAST_DAMPING = 1e-9
MOST_DAMPING = 1e6
# Differences of cost below this share of the sum of squared data are rounding.
_ROUNDING = 1e-13
# Damping falls if the cost falls by more than this share of the predicted reduction.
_GOOD = 0.5


class Ending(NamedTuple):
    """When a fit ends.

    Attributes
    ----------
    steps : int
        Most steps that are tried.
    tolerance : float
        Ends when the predicted reduction is less than this share of the cost.
    least_cost : float
        Added to the cost in that comparison: the cost of a perfect fit is rounding.
    """

    steps: int
    tolerance: float
    least_cost: float


# (problem, here, hessian, gradient) -> whether H could be computed.
Linearise = Callable[[Any, Any, FloatArray, FloatArray], bool]
# (problem, here, low, high): least and greatest step of each parameter.
Room = Callable[[Any, Any, FloatArray, FloatArray], None]
# (problem, here, step, trial): overwrites `trial`, and `step` by the one that was taken.
Move = Callable[[Any, Any, FloatArray, Any], None]
Minimise = Callable[[Any, Any, Any, Ending], bool]


@numba.njit(cache=True, nogil=True)
def _damped_step(
    hessian: FloatArray, gradient: FloatArray, damping: float, held: BoolArray, step: FloatArray
) -> bool:
    """Solve for the steps (parameters,) that are not held, given those that are."""
    count = len(step)
    matrix = hessian.copy()
    right = gradient.copy()
    for place in range(count):
        matrix[place, place] *= 1.0 + damping
        for other in range(count):
            if held[other] and not held[place]:
                right[place] -= hessian[place, other] * step[other]
    for place in range(count):
        if held[place]:
            matrix[place] = 0.0
            matrix[:, place] = 0.0
            matrix[place, place] = 1.0
            right[place] = step[place]
    solved = solve_positive(matrix, right)
    step[:] = right
    return solved


@numba.njit(cache=True, nogil=True)
def bounded_step(
    hessian: FloatArray,
    gradient: FloatArray,
    damping: float,
    low: FloatArray,
    high: FloatArray,
    step: FloatArray,
) -> bool:
    """Write a damped step (parameters,) between `low` and `high`; return whether there is one."""
    count = len(step)
    step[:] = 0.0
    held = np.zeros(count, dtype=np.bool_)
    for _ in range(count):
        if not _damped_step(hessian, gradient, damping, held, step):
            return False
        left = False
        for place in range(count):
            if not held[place] and not low[place] <= step[place] <= high[place]:
                step[place] = low[place] if step[place] < low[place] else high[place]
                held[place] = True
                left = True
        if not left:
            break
    return True


@numba.njit(cache=True, nogil=True)
def _predicted_reduction(hessian: FloatArray, gradient: FloatArray, step: FloatArray) -> float:
    """Return the reduction of the cost that its quadratic model predicts for a step."""
    predicted = 0.0
    for place in range(len(step)):
        predicted += 2.0 * gradient[place] * step[place]
        for other in range(len(step)):
            predicted -= step[place] * hessian[place, other] * step[other]
    return predicted


def minimiser(linearise: Linearise, room: Room, move: Move) -> Minimise:
    """Return the compiled fit of a model.

    Parameters
    ----------
    linearise, room, move : callable
        Functions of the model, decorated by `numba.extending.register_jitable`; see the module.

    Returns
    -------
    callable
        ``minimise(problem, here, trial, ending)`` improves the point `here`, whose cost and
        linear unknowns are known; `trial` is scratch of the same shape.  Returns whether the
        result is in `trial`: the two change places with every step that is taken.
    """

    def minimise(problem: Any, here: Any, trial: Any, ending: Ending) -> bool:
        count = len(here.theta)
        hessian = np.zeros((count, count))
        gradient, step, low, high = np.zeros((4, count))
        fresh = changed = False
        for _ in range(ending.steps):
            if not fresh:
                if not linearise(problem, here, hessian, gradient):
                    here.failures[0] += 1.0
                    return changed
                fresh = True
                room(problem, here, low, high)
            damping = here.damping[0]
            longer = min(max(10.0 * damping, 1e-6), MOST_DAMPING)
            if not bounded_step(hessian, gradient, damping, low, high, step):
                here.failures[0] += 1.0
                here.damping[0] = longer
                continue
            move(problem, here, step, trial)
            predicted = _predicted_reduction(hessian, gradient, step)
            actual = here.cost[0] - trial.cost[0]
            if actual >= -_ROUNDING * here.energy[0]:
                good = actual > _GOOD * predicted
                trial.damping[0] = max(damping * (0.1 if good else 1.0), LEAST_DAMPING)
                trial.moved[0] = np.abs(step).max()
                trial.energy[0], trial.failures[0] = here.energy[0], here.failures[0]
                here, trial = trial, here
                fresh, changed = False, not changed
            else:
                here.damping[0] = longer
            if predicted <= ending.tolerance * (here.cost[0] + ending.least_cost):
                break
        return changed

    # Part of the name of numba's index file: a file shared by several models could not be read
    # where the module of one of them is missing.
    minimise.__qualname__ = f'minimise.{linearise.__module__}'
    return numba.njit(cache=True, nogil=True)(minimise)
