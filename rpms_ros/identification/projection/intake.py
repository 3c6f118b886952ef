"""Samples and pulses into cells, with a prediction of each sample before it is learnt from."""

import math
from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.laguerre import move_generator
from rpms_ros.identification.projection.cells import HEAD
from rpms_ros.identification.projection.cells import LONGEST_CELL_NS
from rpms_ros.identification.projection.cells import SIZE
from rpms_ros.identification.projection.cells import Cells
from rpms_ros.identification.projection.cells import add_sample
from rpms_ros.identification.projection.cells import newest
from rpms_ros.identification.projection.cells import open_cell
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.normal_equations import Baseline
from rpms_ros.identification.projection.normal_equations import correlate
from rpms_ros.identification.projection.normal_equations import hat
from rpms_ros.identification.projection.normal_equations import knot_of
from rpms_ros.identification.projection.normal_equations import move_state
from rpms_ros.identification.projection.normal_equations import within_knots
from rpms_ros.muscle.identified_form import bends
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

OUTPUT_ERROR_TIME = 1.0
# Places in `Intake.scalars`
ERROR_ENERGY, FORCE_ENERGY, LEARNT, FRESH = range(4)


class Intake(NamedTuple):
    """What the intake carries from sample to sample.

    Attributes
    ----------
    state : ndarray (functions,)
        States at the beginning of the newest cell, at the parameters of the fit.
    response : ndarray (functions,)
        The force of the newest cell at tau is ``response^T e(tau)``.
    values : ndarray (functions,)
        e(tau), overwritten.
    scalars : ndarray (4,)
        See the indices above.
    previous_ns : ndarray of int64 (1,)
        Stamp of the last sample that was learnt from [ns]; a float would round it to 256 ns.
    """

    state: FloatArray
    response: FloatArray
    values: FloatArray
    scalars: FloatArray
    previous_ns: IntArray


def fresh_intake(functions: int) -> Intake:
    """Return an intake that knows of nothing before its first sample."""
    scalars = np.zeros(4)
    scalars[FRESH] = 1.0
    state, response, values = np.zeros((3, functions))
    return Intake(state, response, values, scalars, np.zeros(1, dtype=np.int64))


@numba.njit(cache=True)
def _begin_cell(
    cells: Cells,
    intake: Intake,
    fit: Fit,
    start_ns: int,
    intensity: float,
    weight: float,
    rate: float,
    kick: float,
) -> int:
    here = open_cell(cells, start_ns, intensity, weight, rate, intake.scalars[FRESH] > 0.0)
    intake.scalars[FRESH] = 0.0
    move_state(cells.move[here], intake.state)
    rho = bends(intensity, fit.theta) - bends(0.0, fit.theta)
    intake.state[:] += kick * weight * rho
    correlate(fit.linear, intake.state, intake.response)
    return here


@numba.njit(cache=True)
def restate(cells: Cells, intake: Intake, fit: Fit, kick: float) -> None:
    """Bring the intake's state to new parameters."""
    intake.state[:] = 0.0
    origin = bends(0.0, fit.theta)
    for index in range(cells.place[SIZE]):
        here = (cells.place[HEAD] + index) % len(cells.start_ns)
        move_state(cells.move[here], intake.state)
        rho = bends(cells.intensity[here], fit.theta) - origin
        intake.state[:] += kick * cells.weight[here] * rho
    correlate(fit.linear, intake.state, intake.response)


@numba.njit(cache=True)
def take(
    stamp_ns: IntArray,
    force: FloatArray,
    usable: BoolArray,
    begin_ns: IntArray,
    intensity: FloatArray,
    weight: FloatArray,
    cells: Cells,
    intake: Intake,
    fit: Fit,
    baseline: Baseline,
    rate: float,
    kick: float,
    prediction: FloatArray,
) -> int:
    """Take ascending samples (samples,); return how many pulses have begun to act.

    `begin_ns`, `intensity`, `weight` (pulses,) are pulses that have not begun yet, latency
    included.  Writes the prediction of each sample by the parameters as they stand.
    """
    begun = 0
    scalars = intake.scalars
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        while begun < len(begin_ns) and begin_ns[begun] < stamp:
            _begin_cell(
                cells, intake, fit, begin_ns[begun], intensity[begun], weight[begun], rate, kick
            )
            begun += 1
        none = cells.place[SIZE] == 0 or scalars[FRESH] > 0.0
        if none or stamp - cells.start_ns[newest(cells)] > LONGEST_CELL_NS:
            _begin_cell(cells, intake, fit, stamp, 0.0, 0.0, rate, kick)
        here = newest(cells)
        tau = 1e-9 * (stamp - cells.start_ns[here])
        move_generator(rate * tau, intake.values)
        predicted = 0.0
        for function in range(len(intake.values)):
            predicted += intake.response[function] * intake.values[function]
        knot, position = knot_of(stamp, baseline)
        position = within_knots(position, baseline)
        for offset in range(min(baseline.knots, 2)):
            predicted += fit.levels[knot + offset] * hat(offset, position, baseline)[0]
        prediction[index] = predicted
        if not usable[index]:
            continue
        error = force[index] - predicted
        since = min(max(1e-9 * (stamp - intake.previous_ns[0]), 0.0), 100.0)
        decay = math.exp(-since / OUTPUT_ERROR_TIME)
        intake.previous_ns[0] = stamp
        scalars[ERROR_ENERGY] = decay * scalars[ERROR_ENERGY] + error * error
        scalars[FORCE_ENERGY] = decay * scalars[FORCE_ENERGY] + force[index] * force[index]
        scalars[LEARNT] += 1.0
        add_sample(cells, here, tau, force[index], intake.values)
    return begun
