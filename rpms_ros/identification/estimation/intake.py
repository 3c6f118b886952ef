# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Intake of samples and pulses: into blocks with an a-priori prediction, and as they came.

`RawSamples` keeps the samples and pulses, from which the blocks of another basis are made.
"""

import copy
import math
from itertools import pairwise
from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.estimation.blocks import (
    COUNT,
    LONGEST_BLOCK_NS,
    PendingPulses,
    add_sample,
    empty_blocks,
    newest,
    open_block,
)
from rpms_ros.identification.estimation.normal_equations import (
    advance_state,
    correlate,
    near_knots,
    position_of,
)
from rpms_ros.identification.estimation.settings import Baseline, Problem
from rpms_ros.identification.estimation.tremor import polynomials, seconds, waves
from rpms_ros.identification.estimation.window_fit import INTERVAL_NS, NO_EVENTS
from rpms_ros.identification.model.basis import LaguerreBasis, transition_generator
from rpms_ros.identification.model.recruitment import counted
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray

OUTPUT_ERROR_TIME = 1.0


class Predictor(NamedTuple):
    """Parameters of the a-priori predictions.

    Attributes
    ----------
    theta, linear : ndarray (nonlinear,), (functions,)
        The muscle.
    levels : ndarray (2,)
        Baseline at its knots [N].
    """

    theta: FloatArray
    linear: FloatArray
    levels: FloatArray


class Intake(NamedTuple):
    """State of the intake between samples.

    Attributes
    ----------
    state : ndarray (functions,)
        States at the beginning of the newest block, at the parameters of the fit.
    response : ndarray (functions,)
        The force of the newest block at tau is ``response^T e(tau)``.
    values : ndarray (functions,)
        e(tau), overwritten.
    error_energy, force_energy, recent : ndarray (1,)
        Exponentially decaying sums of squares of the a-priori error and of the force [N^2], and
        number of samples.
    learnt : ndarray (1,)
        Number of samples that were learnt from.
    fresh : ndarray (1,)
        1 if the next block begins with zero states.
    previous_ns : ndarray of int64 (1,)
        Stamp of the last sample that was learnt from [ns]; a float would round it to 256 ns.
    """

    state: FloatArray
    response: FloatArray
    values: FloatArray
    error_energy: FloatArray
    force_energy: FloatArray
    recent: FloatArray
    learnt: FloatArray
    fresh: FloatArray
    previous_ns: IntArray


def fresh_intake(functions: int) -> Intake:
    """Return an intake before its first sample."""
    return Intake(
        fresh=np.ones(1),
        previous_ns=np.zeros(1, dtype=np.int64),
        **{name: np.zeros(functions) for name in ('state', 'response', 'values')},
        **{name: np.zeros(1) for name in ('error_energy', 'force_energy', 'recent', 'learnt')},
    )


@numba.njit(cache=True)
def _begin_block(
    problem: Problem, intake: Intake, muscle: Predictor, at_ns: int, pulse: FloatArray, rate: float
) -> None:
    """Begin a block with a pulse: its intensity and weight (2,)."""
    fresh = intake.fresh[0] > 0.0
    here = open_block(problem.blocks, at_ns, pulse[0], pulse[1], rate, fresh)
    intake.fresh[0] = 0.0
    advance_state(problem.blocks.transition[here], intake.state)
    if pulse[0] != 0.0:
        intake.state[:] += problem.input_gain * counted(pulse[0], pulse[1], muscle.theta)
    correlate(muscle.linear, intake.state, intake.response)


@numba.njit(cache=True)
def recompute_state(problem: Problem, intake: Intake, muscle: Predictor) -> None:
    """Recompute the state of the intake for new parameters."""
    blocks, input_gain = problem.blocks, problem.input_gain
    intake.state[:] = 0.0
    for index in range(blocks.size[0]):
        here = (blocks.head[0] + index) % len(blocks.start_ns)
        advance_state(blocks.transition[here], intake.state)
        if blocks.intensity[here] != 0.0:
            rho = counted(blocks.intensity[here], blocks.weight[here], muscle.theta)
            intake.state[:] += input_gain * rho
    correlate(muscle.linear, intake.state, intake.response)


@numba.njit(cache=True)
def squared_recruitment(problem: Problem, theta: FloatArray) -> float:
    """Return the sum of the squared recruitment of the pulses that are fitted."""
    total, blocks = 0.0, problem.blocks
    for index in range(problem.first, blocks.size[0]):
        here = (blocks.head[0] + index) % len(blocks.start_ns)
        if blocks.intensity[here] != 0.0 and blocks.moments[here, COUNT] > 0.0:
            total += counted(blocks.intensity[here], blocks.weight[here], theta) ** 2
    return total


@numba.njit(cache=True)
def count_energy(
    energies: tuple[FloatArray, FloatArray, IntArray], stamp_ns: int, error: float, force: float
) -> float:
    """Add the squares of an a-priori error and of a force [N] to the decaying sums (1,).

    `energies` are those of the errors and of the force, and the stamp of the sample before (1,).
    Returns what is left of what was counted until then.
    """
    error_energy, force_energy, previous_ns = energies
    since = min(max(1e-9 * (stamp_ns - previous_ns[0]), 0.0), 100.0)
    decay = math.exp(-since / OUTPUT_ERROR_TIME)
    previous_ns[0] = stamp_ns
    error_energy[0] = decay * error_energy[0] + error * error
    force_energy[0] = decay * force_energy[0] + force * force
    return decay


@numba.njit(cache=True)
def add_samples(
    stamp_ns: IntArray,
    force: FloatArray,
    usable: BoolArray,
    pending: PendingPulses,
    problem: Problem,
    intake: Intake,
    muscle: Predictor,
    rate: float,
) -> tuple[int, FloatArray]:
    """Add ascending samples (samples,).

    Returns how many pulses have begun to act, and the prediction of each sample (samples,) with
    the present parameters.
    """
    blocks, baseline, begin_ns = problem.blocks, problem.baseline, pending.begin_ns
    begun, prediction, nothing = 0, np.empty(len(stamp_ns)), np.zeros(2)
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        while begun < len(begin_ns) and begin_ns[begun] < stamp:
            pulse = np.array([pending.intensity[begun], pending.weight[begun]])
            _begin_block(problem, intake, muscle, begin_ns[begun], pulse, rate)
            begun += 1
        none = blocks.size[0] == 0 or intake.fresh[0] > 0.0
        if none or stamp - blocks.start_ns[newest(blocks)] > LONGEST_BLOCK_NS:
            _begin_block(problem, intake, muscle, stamp, nothing, rate)
        here = newest(blocks)
        tau = 1e-9 * (stamp - blocks.start_ns[here])
        transition_generator(rate * tau, intake.values)
        predicted = 0.0
        for function in range(len(intake.values)):
            predicted += intake.response[function] * intake.values[function]
        position = near_knots(position_of(stamp, baseline), baseline)
        predicted += (1.0 - position) * muscle.levels[0] + position * muscle.levels[1]
        prediction[index] = predicted
        if not usable[index]:
            continue
        measured = force[index]
        energies = intake.error_energy, intake.force_energy, intake.previous_ns
        decay = count_energy(energies, stamp, measured - predicted, measured)
        intake.recent[0] = decay * intake.recent[0] + 1.0
        intake.learnt[0] += 1.0
        add_sample(blocks, here, tau, measured, intake.values)
    return begun, prediction


def predict(
    stamp_ns: IntArray,
    pending: PendingPulses,
    problem: Problem,
    intake: Intake,
    muscle: Predictor,
    rate: float,
) -> FloatArray:
    """Return the predictions that `add_samples` would make of ascending samples (samples,).

    The state of the intake does not change.
    """
    blocks, newest_two = problem.blocks, empty_blocks(2, len(intake.state))
    if int(blocks.size[0]):
        newest_two.start_ns[0], newest_two.size[0] = blocks.start_ns[newest(blocks)], 1
    copied = Intake(**{name: one.copy() for name, one in intake._asdict().items()})
    nothing = np.zeros(len(stamp_ns))
    ahead = problem._replace(blocks=newest_two)
    return add_samples(stamp_ns, nothing, nothing > 0.0, pending, ahead, copied, muscle, rate)[1]


# Least distance of samples that are kept: more are not needed to choose a basis [ns].
_LEAST_DISTANCE_NS = 900_000
# A tremor is subtracted in pieces of a second with at least so many samples, fitted together with
# a polynomial of so many terms.
_LEAST_IN_PIECE, _SLOW = 30, 4
_SAMPLES = ('_stamp_ns', '_measured', '_force')
_PULSES = ('_onset_ns', '_intensity', '_weight')


class RawSamples:
    """Usable samples and pulses of the last seconds, or since the start."""

    _stamp_ns: IntArray
    _measured: FloatArray
    _force: FloatArray
    _onset_ns: IntArray
    _intensity: FloatArray
    _weight: FloatArray

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Forget everything."""
        for name in (*_SAMPLES, *_PULSES):
            setattr(self, name, np.zeros(4096, np.int64 if name.endswith('ns') else np.float64))
        self._size = self._pulses = 0

    @property
    def first_ns(self) -> int:
        """First stamp [ns]; there must be one."""
        return int(self._stamp_ns[0])

    def last_strong_ns(self, before_ns: int) -> int | None:
        """Return the last pulse before a time with half of the highest intensity or more [ns]."""
        count = int(np.searchsorted(self._onset_ns[: self._pulses], before_ns))
        intensity = self._intensity[:count]
        strong = np.flatnonzero(intensity >= 0.5 * intensity.max(initial=0.0))
        some = self._size and len(strong) and intensity[strong[-1]] > 0.0
        return int(self._onset_ns[strong[-1]]) if some else None

    def _make_room(self, names: tuple[str, ...], need: int) -> None:
        """Enlarge arrays to so many places, if they have fewer."""
        for name in names:
            old = getattr(self, name)
            if need > len(old):
                larger = np.zeros(2 * need, dtype=old.dtype)
                larger[: len(old)] = old
                setattr(self, name, larger)

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray, weight: FloatArray) -> None:
        """Add pulses (pulses,), ascending, with the factor of their recruitment."""
        here = slice(self._pulses, self._pulses + len(onset_ns))
        self._make_room(_PULSES, here.stop)
        self._onset_ns[here] = onset_ns
        self._intensity[here] = intensity
        self._weight[here] = weight
        self._pulses = here.stop

    def add(
        self, stamp_ns: IntArray, force: FloatArray, tremor: FloatArray | float, usable: BoolArray
    ) -> None:
        """Add the usable ones of ascending samples (samples,), and the tremor in their force."""
        last = int(self._stamp_ns[self._size - 1]) if self._size else -(2**62)
        kept = np.flatnonzero(usable)
        # the same ones whatever the cut into blocks was
        bins = stamp_ns[kept] // _LEAST_DISTANCE_NS
        kept = kept[np.diff(bins, prepend=last // _LEAST_DISTANCE_NS) != 0]
        here = slice(self._size, self._size + len(kept))
        self._make_room(_SAMPLES, here.stop)
        self._stamp_ns[here] = stamp_ns[kept]
        self._measured[here] = force[kept]
        self._force[here] = (force - tremor)[kept]
        self._size = here.stop

    def drop(self, before_ns: int) -> None:
        """Drop what lies before a time [ns], once it is a quarter of what is kept."""
        first = int(np.searchsorted(self._stamp_ns[: self._size], before_ns))
        if first <= self._size // 4:
            return
        pulse = before_ns - 2 * NANOSECONDS_PER_SECOND
        first_pulse = int(np.searchsorted(self._onset_ns[: self._pulses], pulse))
        for names, begin, end in (
            (_SAMPLES, first, self._size),
            (_PULSES, first_pulse, self._pulses),
        ):
            for name in names:
                values = getattr(self, name)
                values[: end - begin] = values[begin:end].copy()
        self._size -= first
        self._pulses -= first_pulse

    def newest_pulses(self, count: int) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return onset [ns], intensity and weight of the newest pulses (count,)."""
        here = slice(self._pulses - count, self._pulses)
        return self._onset_ns[here], self._intensity[here], self._weight[here]

    def condensed(
        self,
        basis: LaguerreBasis,
        theta: FloatArray,
        linear: FloatArray,
        first_ns: int,
        capacity: int | None = None,
        left_out: IntArray = NO_EVENTS,
    ) -> tuple[Problem, Intake, int, FloatArray]:
        """Return the blocks of another basis, from a time on.

        Parameters
        ----------
        basis : LaguerreBasis
            Functions behind a latency.
        theta, linear : ndarray (nonlinear,), (functions,)
            The muscle, for the states of the intake.
        first_ns : int
            Samples from here on are fitted [ns]; pulses before lead the state up to it.
        capacity : int or None
            Room for blocks; None for what is needed.
        left_out : ndarray of int64 (intervals,)
            Numbers of intervals of `INTERVAL_NS` whose samples are not learnt from.

        Returns
        -------
        tuple
            Problem, intake at the newest sample, how many pulses have not begun to act, and the
            force of the muscle at the samples [N] (samples,).
        """
        low = int(np.searchsorted(self._stamp_ns[: self._size], first_ns))
        stamp_ns, force = self._stamp_ns[low : self._size], self._force[low : self._size]
        memory_ns = round(basis.duration * NANOSECONDS_PER_SECOND)
        onset_ns = self._onset_ns[: self._pulses]
        pulse = int(np.searchsorted(onset_ns, first_ns - memory_ns))
        begin_ns = onset_ns[pulse:] + round(basis.latency * NANOSECONDS_PER_SECOND)
        span_ns = int(stamp_ns[-1] - stamp_ns[0]) if len(stamp_ns) else 0
        need = len(begin_ns) + span_ns // 200_000_000 + 8
        functions = basis.functions
        problem = Problem(
            blocks=empty_blocks(max(need, capacity or 0), functions),
            first=0,
            input_gain=basis.input_gain,
            baseline=Baseline(first_ns, NANOSECONDS_PER_SECOND),
        )
        muscle = Predictor(theta, linear, np.zeros(2))
        intake = fresh_intake(functions)
        usable = np.isin(stamp_ns // INTERVAL_NS, left_out, invert=True)
        here, rate = slice(pulse, self._pulses), 2.0 / basis.time_constant
        pending = PendingPulses(begin_ns, self._intensity[here], self._weight[here])
        begun, prediction = add_samples(
            stamp_ns, force, usable, pending, problem, intake, muscle, rate
        )
        size = int(problem.blocks.size[0])
        first = int(np.searchsorted(problem.blocks.start_ns[:size], first_ns))
        problem = problem._replace(first=min(first, max(size - 1, 0)))
        return problem, intake, len(begin_ns) - begun, prediction

    def rest(
        self, basis: LaguerreBasis, theta: FloatArray, linear: FloatArray, first_ns: int = -(2**62)
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return stamps [ns], measured force [N] and what a muscle leaves of it [N] (samples,).

        Parameters
        ----------
        basis : LaguerreBasis
            Functions behind a latency.
        theta, linear : ndarray (nonlinear,), (functions,)
            The muscle.
        first_ns : int
            The first sample that counts [ns].
        """
        low = int(np.searchsorted(self._stamp_ns[: self._size], first_ns))
        stamp_ns = self._stamp_ns[low : self._size]
        force = self._measured[low : self._size]
        if not len(stamp_ns):
            return stamp_ns, force, force
        predicted = self.condensed(basis, theta, linear, int(stamp_ns[0]))[-1]
        return stamp_ns, force, force - predicted

    def without(self, hertz: float, rest: FloatArray) -> 'RawSamples':
        """Return the same samples with a tremor taken off, piece by piece.

        Parameters
        ----------
        hertz : float
            Frequency of the tremor.
        rest : ndarray (samples,)
            What the muscle leaves [N], see `rest`.
        """
        result = copy.deepcopy(self)
        if not self._size:
            return result
        stamp_ns = self._stamp_ns[: self._size]
        first_ns = int(stamp_ns[0])
        piece = (stamp_ns - first_ns) // NANOSECONDS_PER_SECOND
        edges = np.flatnonzero(np.diff(piece, prepend=-1, append=-1))
        for first, last in pairwise(edges):
            if last - first < _LEAST_IN_PIECE:
                continue
            here = seconds(stamp_ns[first:last] - first_ns)
            wave, slow = waves(hertz, here), polynomials(here, _SLOW)
            found = np.linalg.lstsq(np.hstack((wave, slow)), rest[first:last], rcond=None)[0]
            result._force[first:last] = self._measured[first:last] - wave @ found[:2]
        return result
