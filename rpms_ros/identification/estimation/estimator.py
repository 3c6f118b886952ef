# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Common parts of the batch and the tracking estimator: intake, prediction, estimates.

Samples and pulses are added to blocks, with an a-priori prediction of each sample.
"""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numba
import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.estimation.blocks import (
    COUNT,
    LONGEST_BLOCK_NS,
    TIME,
    BlockStatistics,
    PulseDelayLine,
    add_sample,
    empty_blocks,
    newest,
    open_block,
    ring_order,
)
from rpms_ros.identification.estimation.gauss_newton import Fit, empty_fit, residual_sums
from rpms_ros.identification.estimation.normal_equations import (
    advance_state,
    correlate,
    hat,
    knot_of,
    within_knots,
)
from rpms_ros.identification.estimation.settings import (
    PARAMETERS,
    BaselineKnots,
    Problem,
    ProjectionSettings,
    pass_arrays,
)
from rpms_ros.identification.estimation.uncertainty import (
    SHORTEST_CELL_NS,
    Counters,
    EstimateBuilder,
    ResidualSums,
    residual_spread,
)
from rpms_ros.identification.model.basis import LaguerreBasis, transition_generator
from rpms_ros.identification.model.estimate import DEFAULT_RATE, Estimate, recruiting_range
from rpms_ros.identification.quality.doubts import FACTORISATION_FAILED, FaultCounter
from rpms_ros.muscle.recruitment import (
    RecruitmentParameters,
    arctan_recruitment,
    identified_recruitment,
)
from rpms_ros.pulses import BoolArray, FloatArray, IntArray
from rpms_ros.saved_state import RestorableWithSettings, State, described, expect

if TYPE_CHECKING:
    from rpms_ros.identification.estimation.basis_choice import RawSamples

OUTPUT_ERROR_TIME = 1.0


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
    state, response, values = np.zeros((3, functions))
    return Intake(
        state=state,
        response=response,
        values=values,
        error_energy=np.zeros(1),
        force_energy=np.zeros(1),
        recent=np.zeros(1),
        learnt=np.zeros(1),
        fresh=np.ones(1),
        previous_ns=np.zeros(1, dtype=np.int64),
    )


@numba.njit(cache=True)
def _begin_block(
    blocks: BlockStatistics,
    input_gain: float,
    intake: Intake,
    fit: Fit,
    start_ns: int,
    intensity: float,
    weight: float,
    rate: float,
) -> int:
    here = open_block(blocks, start_ns, intensity, weight, rate, intake.fresh[0] > 0.0)
    intake.fresh[0] = 0.0
    advance_state(blocks.transition[here], intake.state)
    rho = arctan_recruitment(intensity, fit.theta) - arctan_recruitment(0.0, fit.theta)
    intake.state[:] += input_gain * weight * rho
    correlate(fit.linear, intake.state, intake.response)
    return here


@numba.njit(cache=True)
def recompute_state(problem: Problem, intake: Intake, fit: Fit) -> None:
    """Recompute the state of the intake for new parameters."""
    blocks, input_gain = problem.blocks, problem.input_gain
    intake.state[:] = 0.0
    origin = arctan_recruitment(0.0, fit.theta)
    for index in range(blocks.size[0]):
        here = (blocks.head[0] + index) % len(blocks.start_ns)
        advance_state(blocks.transition[here], intake.state)
        rho = arctan_recruitment(blocks.intensity[here], fit.theta) - origin
        intake.state[:] += input_gain * blocks.weight[here] * rho
    correlate(fit.linear, intake.state, intake.response)


@numba.njit(cache=True)
def count_energy(
    error_energy: FloatArray,
    force_energy: FloatArray,
    previous_ns: IntArray,
    stamp_ns: int,
    error: float,
    force: float,
) -> float:
    """Add the squares of an a-priori error and of a force [N] to the decaying sums (1,).

    Returns what is left of what was counted until the sample before.
    """
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
    begin_ns: IntArray,
    intensity: FloatArray,
    weight: FloatArray,
    problem: Problem,
    intake: Intake,
    fit: Fit,
    rate: float,
    prediction: FloatArray,
) -> int:
    """Add ascending samples (samples,); return how many pulses have begun to act.

    `begin_ns`, `intensity`, `weight` (pulses,) are pulses whose twitch has not begun yet;
    `begin_ns` includes the latency.  Writes the prediction of each sample with the present
    parameters.
    """
    blocks, baseline, input_gain = problem.blocks, problem.baseline, problem.input_gain
    begun = 0
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        while begun < len(begin_ns) and begin_ns[begun] < stamp:
            _begin_block(
                blocks,
                problem.input_gain,
                intake,
                fit,
                begin_ns[begun],
                intensity[begun],
                weight[begun],
                rate,
            )
            begun += 1
        none = blocks.size[0] == 0 or intake.fresh[0] > 0.0
        if none or stamp - blocks.start_ns[newest(blocks)] > LONGEST_BLOCK_NS:
            _begin_block(blocks, input_gain, intake, fit, stamp, 0.0, 0.0, rate)
        here = newest(blocks)
        tau = 1e-9 * (stamp - blocks.start_ns[here])
        transition_generator(rate * tau, intake.values)
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
        decay = count_energy(
            intake.error_energy,
            intake.force_energy,
            intake.previous_ns,
            stamp,
            error,
            force[index],
        )
        intake.recent[0] = decay * intake.recent[0] + 1.0
        intake.learnt[0] += 1.0
        add_sample(blocks, here, tau, force[index], intake.values)
    return begun


@numba.njit(cache=True)
def predict(
    stamp_ns: IntArray,
    begin_ns: IntArray,
    intensity: FloatArray,
    weight: FloatArray,
    problem: Problem,
    intake: Intake,
    fit: Fit,
    rate: float,
    expected: FloatArray,
) -> None:
    """Write the predictions that `data_intake.take` would make of ascending samples (samples,).

    The state of the intake does not change.
    """
    blocks, baseline = problem.blocks, problem.baseline
    known = blocks.size[0] > 0 and intake.fresh[0] == 0.0
    start = blocks.start_ns[newest(blocks)] if known else stamp_ns[0]
    state, response = intake.state.copy(), intake.response.copy()
    if not known:
        state[:] = 0.0
        response[:] = 0.0
    values = np.empty(len(state))
    origin = arctan_recruitment(0.0, fit.theta)
    begun = 0
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        while begun < len(begin_ns) and begin_ns[begun] < stamp:
            transition_generator(rate * 1e-9 * max(begin_ns[begun] - start, 0), values)
            advance_state(values, state)
            rho = arctan_recruitment(intensity[begun], fit.theta) - origin
            state += problem.input_gain * weight[begun] * rho
            correlate(fit.linear, state, response)
            start = begin_ns[begun]
            begun += 1
        transition_generator(rate * 1e-9 * (stamp - start), values)
        total = 0.0
        for function in range(len(values)):
            total += response[function] * values[function]
        knot, position = knot_of(stamp, baseline)
        position = within_knots(position, baseline)
        for offset in range(min(baseline.knots, 2)):
            total += fit.levels[knot + offset] * hat(offset, position, baseline)[0]
        expected[index] = total


class ProjectionEstimator(RestorableWithSettings):
    """Adds samples and pulses to blocks; derived classes decide when to fit.

    Parameters
    ----------
    settings : ProjectionSettings or None
        Model and numerics.
    rate_hz : float
        Rate for which the recruitment curve is stated [Hz].
    capacity : int
        Largest number of blocks.
    knots : int
        Number of knots of the baseline.

    Raises
    ------
    IdentificationError
        If the rate is not above zero.
    """

    name = 'projection'
    on_line = True

    _basis: LaguerreBasis
    _problem: Problem
    _fit: Fit
    _trial: Fit
    _intake: Intake
    _delay_line: PulseDelayLine
    _faults: FaultCounter
    _pulses: int
    _intensity_range: tuple[float, float]

    def __init__(
        self,
        settings: ProjectionSettings | None,
        rate_hz: float = DEFAULT_RATE,
        capacity: int = 64,
        knots: int = 2,
    ) -> None:
        if not (math.isfinite(rate_hz) and rate_hz > 0):
            raise IdentificationError(f'expected a repetition rate above 0 Hz, got {rate_hz}')
        self.settings = settings if settings is not None else ProjectionSettings()
        self.rate_hz = rate_hz
        basis = self._basis = self.settings.basis
        self._rate = 2.0 / basis.time_constant
        self._problem = Problem(
            blocks=empty_blocks(capacity, basis.functions),
            first=0,
            input_gain=basis.input_gain,
            baseline=BaselineKnots(knots, 0, 1),
            prior=self.settings.as_prior(),
            work=pass_arrays(basis.functions),
        )
        start = np.array(self.settings.start)
        self._fit = empty_fit(start, basis.functions, knots)
        self._trial = empty_fit(start, basis.functions, knots)
        self._intake = fresh_intake(basis.functions)
        self._delay_line = PulseDelayLine(
            basis.latency, self.settings.by_rate, rate_hz, self.settings.history
        )
        self._builder = EstimateBuilder(self.name, basis, rate_hz, self.settings.confidence)
        self._faults = FaultCounter()
        self._pulses = 0
        self._intensity_range = (np.inf, -np.inf)

    @property
    def memory(self) -> float:
        """Longest time for which a pulse acts on the model's output [s]."""
        return self.settings.basis.duration

    @property
    def parameters(self) -> RecruitmentParameters:
        """Present nonlinear parameters."""
        return RecruitmentParameters(*(float(value) for value in self._fit.theta))

    @property
    def linear(self) -> FloatArray:
        """Present coefficients of the basis (functions,) [N s^1/2]."""
        return self._fit.linear.copy()

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending, none before one that was already added [ns, 1]."""
        if not len(onset_ns):
            return
        self._delay_line.add(onset_ns, intensity)
        self._pulses += len(onset_ns)
        self._intensity_range = recruiting_range(intensity, self._intensity_range)

    def forget_pulses(self) -> None:
        """Drop the pulses that still act: the clock has jumped, their lag is unknown."""
        self._delay_line.forget()
        self._intake.fresh[0] = 1.0
        self._intake.error_energy[0] = 0.0
        self._intake.force_energy[0] = 0.0
        self._intake.recent[0] = 0.0
        # The baseline continues at its last level: its slope is valid for the old time line only.
        self._fit.levels[:] = self._fit.levels[-1:]

    def described_settings(self) -> State:
        """Return all settings by name."""
        return {**described(self.settings), 'rate_hz': self.rate_hz}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore a saved state; see `Restorable.restore`."""
        made = self._problem
        super().restore(state)
        _check(self._problem, made, (self._fit, self._trial), self._intake)

    def predict(self, stamp_ns: IntArray) -> FloatArray:
        """Return the prediction of the next samples (samples,) [N]."""
        pending, expected = self._delay_line, np.empty(len(stamp_ns))
        predict(
            stamp_ns,
            pending.begin_ns,
            pending.intensity,
            pending.weight,
            self._problem,
            self._intake,
            self._fit,
            self._rate,
            expected,
        )
        return expected

    def _use(self, basis: LaguerreBasis) -> None:
        """Use a basis from now on."""
        self._basis = basis
        self._rate = 2.0 / basis.time_constant
        self._delay_line.latency(basis.latency)
        self._builder = EstimateBuilder(
            self.name, basis, self.rate_hz, self.settings.confidence, wide=True
        )

    def _into_other_blocks(
        self,
        raw: 'RawSamples',
        basis: LaguerreBasis,
        first_ns: int,
        capacity: int,
        theta: FloatArray,
        linear: FloatArray,
    ) -> None:
        """Put samples from `first_ns` on into blocks of another basis, where theta, w hold."""
        problem, intake, pending = raw.condensed(
            basis, theta, linear, first_ns, self._problem.prior, capacity
        )
        self._problem = problem._replace(baseline=self._problem.baseline)
        self._intake = self._intake._replace(
            state=intake.state, response=intake.response, fresh=intake.fresh
        )
        self._delay_line.restart(*raw.newest_pulses(pending), basis.latency)

    def _add_samples(
        self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray, prediction: FloatArray
    ) -> None:
        """Add samples (samples,) to the blocks; write their prediction."""
        pending = self._delay_line
        begun = add_samples(
            stamp_ns,
            force,
            usable,
            pending.begin_ns,
            pending.intensity,
            pending.weight,
            self._problem,
            self._intake,
            self._fit,
            self._rate,
            prediction,
        )
        pending.drop(begun)

    def _build(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Return the estimate of the present fit."""
        return self._builder.make(
            stamp_ns,
            self._fit,
            self._problem.prior,
            self._residuals(),
            self._counters(),
            self._with_own(faults),
        )

    def _counters(self) -> Counters:
        """Return the properties of the data so far."""
        low, high = self._intensity_range
        intake = self._intake
        energy = float(intake.force_energy[0])
        return Counters(
            samples=int(intake.learnt[0]),
            pulses=self._pulses,
            intensity_span=high - low,
            output_error=float(np.sqrt(intake.error_energy[0] / energy)) if energy > 0.0 else 0.0,
        )

    def _with_own(self, faults: Mapping[str, int]) -> dict[str, int]:
        """Return the faults of the stream, and those that were found here."""
        # faults of monitors of other packages are counted under any name
        own = FaultCounter(dict.fromkeys(faults, ''))
        for name, count in (*faults.items(), *self._faults.counts().items()):
            own.add(name, count)
        own.add(FACTORISATION_FAILED, int(self._fit.failures[0]))
        return own.counts()

    def _residuals(self) -> ResidualSums:
        """Return the sums of the residuals of the blocks."""
        blocks, first = self._problem.blocks, self._problem.first
        size = int(blocks.size[0])
        count = size - first
        if count <= 0:
            return ResidualSums(np.zeros(1), 0.0, 0.0, 0.0, 0.0)
        sums = np.zeros(count)
        residual_sums(self._problem, size, self._fit, sums)
        order = ring_order(blocks)[first:]
        start_ns, moments = blocks.start_ns[order], blocks.moments[order]
        recruitment = identified_recruitment(self.parameters, blocks.intensity[order])
        samples = moments[:, COUNT]
        some = samples > 0.0
        # the mean time since a block began is half of its length
        seconds = 2.0 * float(np.sum(moments[some, TIME] / samples[some]))
        return ResidualSums(
            residual_spread(start_ns, samples, sums),
            float(len(np.unique(start_ns[some] // SHORTEST_CELL_NS))),
            float(samples.sum()),
            seconds,
            float(np.sum((blocks.weight[order] * recruitment)[some] ** 2)),
        )


def _check(problem: Problem, made: Problem, fits: tuple[Fit, Fit], intake: Intake) -> None:
    """Raise `IdentificationError` unless restored arrays have the right shapes."""
    blocks, functions = problem.blocks, made.blocks.transition.shape[1]
    capacity, knots = len(blocks.start_ns), problem.baseline.knots
    expect(knots >= 0, 'baseline', 'knots')
    wanted = [
        (blocks, empty_blocks(capacity, functions)),
        (intake, fresh_intake(functions)),
        (problem.work, made.work),
        (problem.prior, made.prior),
        *((fit, empty_fit(fits[0].theta, functions, knots)) for fit in fits),
    ]
    alike = all(
        np.shape(one) == np.shape(other)
        for record, pattern in wanted
        for one, other in zip(record, pattern, strict=True)
    )
    expect(alike and fits[0].theta.shape == (PARAMETERS,), 'estimator', 'arrays of one model')
    head, size = int(blocks.head[0]), int(blocks.size[0])
    inside = 0 <= head < capacity and 0 <= problem.first <= size <= capacity
    expect(inside and problem.baseline.spacing_ns > 0, 'estimator', 'blocks within the ring')
