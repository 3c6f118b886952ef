r"""What is kept of cells that leave the horizon: a quadratic cost about [theta, w].

``(z - z_0)^T L (z - z_0) / 2 - p^T (z - z_0)``: a leaving cell adds its Gauss-Newton matrix to L
and its gradient to p, both at the parameters as they stand.

Old knowledge must give way to new, but only where there is new.  With M = L + (information of
the horizon) it is forgotten in proportion to what replaces it,

.. math:: L \leftarrow L - a\,(L - L M^{-1} L), \qquad p \leftarrow p - a\,(p - L M^{-1} p).

``L - L M^{-1} L`` is the parallel sum of old and new information: about L in directions that the
horizon informs, zero in those it does not.  So a rest, a constant intensity or one below the
threshold erases nothing, and nothing grows without bound.
"""

import numba
import numpy as np

from rpms_ros.identification.projection.cells import Cells
from rpms_ros.identification.projection.fit import VARIANCE
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.fit import Known
from rpms_ros.identification.projection.fit import coordinate
from rpms_ros.identification.projection.normal_equations import PARAMETERS
from rpms_ros.identification.projection.normal_equations import Baseline
from rpms_ros.identification.projection.normal_equations import Pass
from rpms_ros.identification.projection.normal_equations import gradient_pass
from rpms_ros.identification.projection.normal_equations import linear_pass
from rpms_ros.identification.small_matrix import dot
from rpms_ros.identification.small_matrix import solve_positive
from rpms_ros.pulses import FloatArray


@numba.njit(cache=True)
def _recentre(known: Known, fit: Fit) -> None:
    """Expand the cost about the parameters as they stand."""
    for place in range(len(known.reference)):
        here = (
            coordinate(fit.theta, place) if place < PARAMETERS else fit.linear[place - PARAMETERS]
        )
        step = here - known.reference[place]
        for row in range(len(known.reference)):
            known.pull[row] -= known.information[row, place] * step
        known.reference[place] = here


@numba.njit(cache=True)
def absorb(
    cells: Cells,
    first: int,
    last: int,
    kick: float,
    baseline: Baseline,
    known: Known,
    work: Pass,
    fit: Fit,
    scratch: Fit,
) -> None:
    """Add what cells first..last-1 say at the parameters of `fit` to what is known."""
    _recentre(known, fit)
    linear_pass(cells, first, last, fit.theta, kick, baseline, work, scratch.matrix, scratch.right)
    gradient_pass(
        cells,
        first,
        last,
        fit.theta,
        fit.linear,
        kick,
        baseline,
        work,
        scratch.matrix,
        scratch.right,
    )
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
        known.pull[row] += total
        for column in range(row + 1):
            known.information[row, column] += matrix[row, column]
            if column < row:
                known.information[column, row] += matrix[row, column]


@numba.njit(cache=True)
def _total(known: Known, fit: Fit) -> FloatArray:
    """Return the lower triangle of M, kept positive by a trace of its size."""
    count = len(known.reference)
    total = fit.complete[:count, :count] + known.information
    size = 0.0
    for row in range(count):
        size = max(size, total[row, row])
    for row in range(count):
        total[row, row] += 1e-12 * size + fit.scalars[VARIANCE]
    return total


@numba.njit(cache=True)
def forget(known: Known, fit: Fit, share: float) -> None:
    """Forget `share` of what is known besides the cells, where the cells replace it."""
    count = len(known.reference)
    information = known.information
    kept = np.empty((count, count))
    for column in range(count):
        solved = information[column].copy()
        if not solve_positive(_total(known, fit), solved):
            return
        for row in range(count):
            kept[row, column] = dot(information[row], solved)
    solved = known.pull.copy()
    solve_positive(_total(known, fit), solved)
    for row in range(count):
        known.pull[row] += share * (dot(information[row], solved) - known.pull[row])
    for row in range(count):
        for column in range(row + 1):
            value = 0.5 * (kept[row, column] + kept[column, row])
            value = information[row, column] + share * (value - information[row, column])
            information[row, column] = value
            information[column, row] = value
