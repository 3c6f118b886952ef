"""Sums of the residuals of cells, to see whether neighbours hang together."""

import numba

from rpms_ros.identification.projection.cells import COUNT
from rpms_ros.identification.projection.cells import FORCE
from rpms_ros.identification.projection.cells import HEAD
from rpms_ros.identification.projection.cells import RESPONSE_ONE
from rpms_ros.identification.projection.cells import TIME
from rpms_ros.identification.projection.cells import Cells
from rpms_ros.identification.projection.normal_equations import Baseline
from rpms_ros.identification.projection.normal_equations import Pass
from rpms_ros.identification.projection.normal_equations import correlate
from rpms_ros.identification.projection.normal_equations import hat
from rpms_ros.identification.projection.normal_equations import knot_of
from rpms_ros.identification.projection.normal_equations import move_state
from rpms_ros.muscle.identified_form import bends
from rpms_ros.pulses import FloatArray


@numba.njit(cache=True)
def residual_sums(
    cells: Cells,
    first: int,
    last: int,
    theta: FloatArray,
    linear: FloatArray,
    levels: FloatArray,
    kick: float,
    baseline: Baseline,
    work: Pass,
    sums: FloatArray,
) -> None:
    """Write the sum of the residuals of cells first..last-1 into `sums` (last - first,) [N]."""
    state = work.state[0]
    state[:] = 0.0
    origin = bends(0.0, theta)
    values = work.correlated[0]
    for index in range(last):
        here = (cells.place[HEAD] + index) % len(cells.start_ns)
        move_state(cells.move[here], state)
        rho = bends(cells.intensity[here], theta) - origin
        state += kick * cells.weight[here] * rho
        if index < first:
            continue
        moments = cells.moments[here]
        correlate(linear, state, values)
        total = moments[FORCE]
        for shift in range(len(linear)):
            total -= values[shift] * cells.response[here, shift, RESPONSE_ONE]
        knot, position = knot_of(cells.start_ns[here], baseline)
        for offset in range(min(baseline.knots, 2)):
            value, slope = hat(offset, position, baseline)
            total -= levels[knot + offset] * (value * moments[COUNT] + slope * moments[TIME])
        sums[index - first] = total
