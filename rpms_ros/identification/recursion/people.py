# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recursion for people: on line, one pass, a state of fixed size.

The algorithm of the paper with additions for people: Laguerre functions behind a latency,
alpha_thr free with a prior, a baseline, a weight for the interval between pulses, sums that are
valid for any parameters instead of derivatives at past parameters (`memory`), a memory that grows
with the samples and is shortened when the muscle has changed (`change`), and intervals.

Steps are triggered by pulses and stamps alone, so the answer does not depend on how the data
are cut.

Settings of the recursion for people.

Steps of the parameters of the recursion, and trials of other starts.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.estimation.blocks import (
    COUNT,
    LONGEST_BLOCK_NS,
    TIME,
    PulseDelayLine,
    newest,
)
from rpms_ros.identification.estimation.gauss_newton import LEAST_ENERGY, Fit, empty_fit
from rpms_ros.identification.estimation.prior import knowledge_of
from rpms_ros.identification.estimation.settings import ProjectionSettings
from rpms_ros.identification.estimation.uncertainty import Counters, EstimateBuilder
from rpms_ros.identification.model.estimate import DEFAULT_RATE, Estimate, recruiting_range
from rpms_ros.identification.recursion.change_detection import (
    UNKNOWN,
    ChangeTest,
    Explained,
    SinceChange,
)
from rpms_ros.identification.recursion.fit import evaluate, go_to, improve, refresh_variance
from rpms_ros.identification.recursion.sums import (
    BLOCKS,
    KNOTS,
    Memory,
    PredictionState,
    ResidualSpread,
    add_block,
    begin_block,
    empty_memory,
    excited,
    fresh_prediction_state,
    let_baseline_drift,
    predict,
    recompute_response,
    residual_sum,
    scale_memory,
    take,
)
from rpms_ros.identification.stream.doubts import PlausibilityCheck
from rpms_ros.identification.stream.faults import FACTORISATION_FAILED, FaultCounter
from rpms_ros.muscle.recruitment import RecruitmentParameters, identified_recruitment
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray, nanoseconds
from rpms_ros.saved_state import Restorable, RestorableWithSettings, State, described, expect


def _model() -> ProjectionSettings:
    return ProjectionSettings(start=RecruitmentParameters(0.50, 0.90, 6.0, 5.5))


@dataclass(frozen=True)
class ExactRecursionSettings:
    """Model and memory of the recursion for people.

    Attributes
    ----------
    model : ProjectionSettings
        Basis, start, prior, bounds, `by_rate` and level of the intervals; its settings of horizon
        and knots are not used.
    memory_time : float
        Time constant with which samples are forgotten, in time during which pulses act [s].
    memory_after_change : float
        Weight of the memory after a change of unknown kind, in seconds of samples [s].
    memory_kept : float
        The same after a change of known kind, for the part that is still valid [s].
    drift : float
        Standard deviation of the random walk of the baseline in a second, relative to that of
        the noise of a sample.
    step_period : float
        Shortest time between two steps of the parameters [s].

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    model: ProjectionSettings = field(default_factory=_model)
    memory_time: float = 40.0
    memory_after_change: float = 0.25
    memory_kept: float = 5.0
    drift: float = 0.1
    step_period: float = 0.04

    def __post_init__(self) -> None:
        for name in ('memory_time', 'memory_after_change', 'memory_kept', 'drift', 'step_period'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise IdentificationError(f'expected {name} above 0, got {value}')
        if not self.memory_after_change < self.memory_time:
            raise IdentificationError(
                'expected memory_after_change below memory_time, got '
                f'{self.memory_after_change} and {self.memory_time}'
            )


PEOPLE = ExactRecursionSettings()
"""For people: latency of 8 ms, alpha_thr free, memory of 40 s."""


# Another start is tried every so many steps, with so many steps of its own; it is taken if its
# cost is lower by more than noise explains (chi-square, one in a thousand, four parameters).
_CHALLENGE_STEPS = 20
_CHALLENGER_STEPS = 5
_CHALLENGER_GAIN = 18.5
_START_DAMPING = 1e-2
_FIRST_VARIANCE = 0.01


class Learner(Restorable):
    """Parameters of the recursion and their steps.

    Parameters
    ----------
    model : ProjectionSettings
        Start, prior and bounds.
    """

    fit: Fit
    _steps: int

    def __init__(self, model: ProjectionSettings) -> None:
        functions = model.basis.functions
        start = np.array(model.start)
        self.prior = model.as_prior()
        self.fit = empty_fit(start, functions, 1)
        # scratch: a trial step, and a fit from another start
        self._workspace = empty_fit(start, functions, 1), empty_fit(start, functions, 1)
        self._starts = model.starts()
        self._steps = 0

    def _check_restored(self) -> None:
        made = self._workspace[0]
        shapes = ((one.shape, other.shape) for one, other in zip(self.fit, made, strict=True))
        expect(all(one == other for one, other in shapes), 'Learner', 'arrays of one model')

    def restart(self, found: Explained) -> None:
        """Continue from the muscle found after a change, and raise the damping again."""
        self.fit.theta[:] = found.theta
        self.fit.linear[:] = found.linear
        self.fit.levels[:] = found.level
        self.fit.damping[0] = _START_DAMPING

    def learn(self, memory: Memory) -> None:
        """Take a step from the memory; a failure is counted."""
        fit = self.fit
        if fit.variance[0] == 0.0:
            power = float(memory.energy[0] / memory.samples[0])
            fit.variance[0] = _FIRST_VARIANCE * power + LEAST_ENERGY
        if not evaluate(memory, self.prior, fit):
            fit.failures[0] += 1.0
            return
        refresh_variance(memory, self.prior, fit)
        self._steps += 1
        if self._steps % _CHALLENGE_STEPS == 0:
            self._challenge(
                memory, self._starts[self._steps // _CHALLENGE_STEPS % len(self._starts)]
            )
        improve(memory, self.prior, fit, self._workspace[0], 1)
        # The covariance of weighted samples depends on the sum of the squared weights.
        fit.complete[:] = fit.matrix * (memory.samples[0] / memory.squared_samples[0])

    def _challenge(self, memory: Memory, start: FloatArray) -> None:
        """Try another start; continue from there if it fits the memory better."""
        fit, (trial, other) = self.fit, self._workspace
        other.theta[:] = start
        other.linear[:] = fit.linear
        other.variance[0] = fit.variance[0]
        other.damping[0] = _START_DAMPING
        if not evaluate(memory, self.prior, other):
            return
        improve(memory, self.prior, other, trial, _CHALLENGER_STEPS)
        if other.cost[0] < fit.cost[0] - _CHALLENGER_GAIN * fit.variance[0]:
            go_to(fit, other)
            fit.damping[0] = other.damping[0]


# Residuals count for the intervals with this share of the time since the last change as time
# constant: the first ones are errors of parameters that were not known yet.
_NEWEST = 0.25
# Errors below this share of the variance are not distinguished.
_FLOOR = 0.01
# Period and duration of the attempts to determine the kind of a change.
_NAMING_NS = NANOSECONDS_PER_SECOND // 4
_NAMED_WITHIN_NS = 5 * NANOSECONDS_PER_SECOND


class ExactRecursion(RestorableWithSettings):
    """Recursive Levenberg-Marquardt with sums that are valid for any parameters.

    Parameters
    ----------
    settings : ExactRecursionSettings
        Model and memory; `PEOPLE` by default.
    rate_hz : float
        Repetition rate for which the recruitment curve is stated [Hz].

    Raises
    ------
    IdentificationError
        If the rate is not above zero.
    """

    name = 'recursive'
    on_line = True

    _memory: Memory
    _prediction: PredictionState
    _learner: Learner
    _test: ChangeTest
    _since: SinceChange
    _spread: ResidualSpread
    _delay_line: PulseDelayLine
    _unnamed_ns: int | None
    _fresh: bool
    _stepped_ns: int | None
    _pulses: int
    _plausibility: PlausibilityCheck
    _intensity_range: tuple[float, float]

    def __init__(
        self, settings: ExactRecursionSettings = PEOPLE, rate_hz: float = DEFAULT_RATE
    ) -> None:
        if not (math.isfinite(rate_hz) and rate_hz > 0):
            raise IdentificationError(f'expected a repetition rate above 0 Hz, got {rate_hz}')
        self.settings = settings
        self.rate_hz = rate_hz
        model = settings.model
        self._input_gain = model.basis.input_gain
        self._rate = 2.0 / model.basis.time_constant
        self._step_ns = nanoseconds(settings.step_period)
        self._memory = empty_memory(KNOTS, model.basis.functions)
        self._prediction = fresh_prediction_state(model.basis.functions)
        self._learner = Learner(model)
        self._test = ChangeTest()
        self._spread = ResidualSpread()
        self._since = SinceChange(self._memory, self._learner.fit, self._spread.mean)
        self._bounds = knowledge_of(model)
        self._unnamed_ns = None
        self._fresh = True
        self._stepped_ns = None
        self._delay_line = PulseDelayLine(model.basis.latency, model.by_rate, rate_hz)
        self._builder = EstimateBuilder(self.name, model.basis, rate_hz, model.confidence)
        self._pulses = 0
        self._plausibility = PlausibilityCheck()
        self._intensity_range = (np.inf, -np.inf)

    @property
    def memory(self) -> float:
        """Longest time for which a pulse acts on the model's output [s]."""
        return self.settings.model.basis.duration

    @property
    def parameters(self) -> RecruitmentParameters:
        """Present nonlinear parameters."""
        return RecruitmentParameters(*(float(value) for value in self._learner.fit.theta))

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending, none before one that was already added [ns, 1]."""
        if not len(onset_ns):
            return
        self._plausibility.add_pulses(onset_ns, intensity)
        self._delay_line.add(onset_ns, intensity)
        self._pulses += len(onset_ns)
        self._intensity_range = recruiting_range(intensity, self._intensity_range)

    def forget_pulses(self) -> None:
        """Drop the pulses that still act: the clock has jumped, their lag is unknown."""
        self._delay_line.forget()
        self._memory.blocks.size[0] = 0
        self._fresh = True
        self._stepped_ns = None
        self._prediction.error_energy[0] = 0.0
        self._prediction.force_energy[0] = 0.0
        self._prediction.squares[0] = 0.0
        self._test.interrupt()
        self._unnamed_ns = None

    def described_settings(self) -> State:
        """Return all settings by name."""
        return {**described(self.settings), 'rate_hz': self.rate_hz}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore a saved state; see `Restorable.restore`."""
        made, carried = self._memory, self._prediction
        super().restore(state)
        blocks = self._memory.blocks
        pairs = [
            *zip(made[2:], self._memory[2:], strict=True),
            *zip(made.blocks, blocks, strict=True),
            *zip(carried, self._prediction, strict=True),
            (made.chains, self._memory.chains),
        ]
        alike = all(one.shape == other.shape for one, other in pairs)
        expect(alike, 'ExactRecursion', 'arrays of one model')
        inside = 0 <= int(blocks.head[0]) < BLOCKS and 0 <= int(blocks.size[0]) <= BLOCKS
        expect(inside, 'ExactRecursion', 'blocks within the ring')

    def update(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        """Learn from samples (samples,), ascending; return their a-priori prediction [N].

        See `rpms_ros.identification.model.estimate.Estimator.update`.
        """
        prediction = np.empty(len(stamp_ns))
        self._plausibility.add_forces(force, usable)
        first = 0
        while first < len(stamp_ns):
            end_ns = self._begin_blocks(int(stamp_ns[first]))
            last = int(np.searchsorted(stamp_ns, end_ns, side='right'))
            part = slice(first, last)
            take(
                stamp_ns[part],
                force[part],
                usable[part],
                self._memory.blocks,
                self._prediction,
                float(self._learner.fit.levels[0]),
                self._rate,
                prediction[part],
            )
            first = last
        return prediction

    def predict(self, stamp_ns: IntArray) -> FloatArray:
        """Return the prediction of the next samples (samples,), ascending [N]."""
        line, carried, fit = self._delay_line, self._prediction, self._learner.fit
        pending = line.begin_ns, line.intensity, self._input_gain * line.weight
        return predict(stamp_ns, pending, self._memory, carried, fit, self._rate, self._fresh)

    def estimate(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Return the present estimate."""
        fit, carried = self._learner.fit, self._prediction
        low, high = self._intensity_range
        energy = float(carried.force_energy[0])
        counters = Counters(
            samples=int(carried.learnt[0]),
            pulses=self._pulses,
            intensity_span=high - low,
            output_error=float(np.sqrt(carried.error_energy[0] / energy)) if energy > 0.0 else 0.0,
        )
        # faults of monitors of other packages are counted under any name
        own = FaultCounter(dict.fromkeys(faults, ''))
        for name, count in (*faults.items(), (FACTORISATION_FAILED, int(fit.failures[0]))):
            own.add(name, count)
        estimate = self._builder.make(
            stamp_ns, fit, self._learner.prior, self._spread.sums, counters, own.counts()
        )
        estimate = self._plausibility.examine(estimate)
        changed_ns = self._test.changed_ns
        if changed_ns is None:
            return replace(estimate, changes=self._test.changes)
        return replace(
            estimate,
            changes=self._test.changes,
            change_kinds=(self._test.kind,),
            change_ago=np.array([(stamp_ns - changed_ns) / NANOSECONDS_PER_SECOND]),
        )

    def _begin_blocks(self, stamp_ns: int) -> int:
        """Begin the block of a sample; return the end of that block [ns]."""
        line, blocks = self._delay_line, self._memory.blocks
        begun = line.begin_until(stamp_ns)
        for pulse in range(begun):
            weight = float(line.weight[pulse])
            self._begin_block(int(line.begin_ns[pulse]), float(line.intensity[pulse]), weight)
        line.drop(begun)
        longest = LONGEST_BLOCK_NS
        none = self._fresh or not blocks.size[0]
        if none or stamp_ns - int(blocks.start_ns[newest(blocks)]) > longest:
            self._begin_block(stamp_ns, 0.0, 0.0)
        end_ns = int(blocks.start_ns[newest(blocks)]) + longest
        return min(end_ns, int(line.begin_ns[0])) if len(line.begin_ns) else end_ns

    def _begin_block(self, start_ns: int, intensity: float, weight: float) -> None:
        """End the present block and begin the next one."""
        memory, fit = self._memory, self._learner.fit
        if memory.blocks.size[0]:
            self._close_block(start_ns)
        push = self._input_gain * weight
        if self._fresh:
            memory.chains[:] = 0.0
        begin_block(
            memory.blocks, memory.chains, start_ns, intensity, push, self._rate, self._fresh
        )
        self._fresh = False
        if self._test.suspects or self._unnamed_ns is not None:
            self._since.advance(memory)
        recompute_response(memory.chains, fit.theta, fit.linear, self._prediction.response)

    def _close_block(self, end_ns: int) -> None:
        """Add a complete block to the memory, test for a change, take a step if one is due."""
        memory, settings, fit = self._memory, self.settings, self._learner.fit
        here = newest(memory.blocks)
        samples = float(memory.blocks.moments[here, COUNT])
        start_ns = int(memory.blocks.start_ns[here])
        mean_square = float(self._prediction.squares[0]) / max(samples, 1.0)
        self._prediction.squares[0] = 0.0
        if not samples:
            return
        seconds = (end_ns - start_ns) / NANOSECONDS_PER_SECOND
        acting = excited(memory, self._input_gain)
        kept = 1.0
        if acting:
            scale_memory(memory, math.exp(-seconds / settings.memory_time))
            window = min(max(_NEWEST * self._test.learnt_s, 1.0), settings.memory_time)
            kept = math.exp(-seconds / window)
        residual = residual_sum(memory.blocks, self._prediction.response, float(fit.levels[0]))
        spread = self._spread.mean
        weight = float(memory.blocks.weight[here]) / self._input_gain
        rho = float(identified_recruitment(self.parameters, float(memory.blocks.intensity[here])))
        # the block may have ended without samples: their mean time is half of what they cover
        covered = 2.0 * float(memory.blocks.moments[here, TIME]) / samples
        self._spread.take(start_ns, covered, residual, samples, weight * rho, kept)
        drift = settings.drift**2 * seconds
        floor = _FLOOR * float(fit.variance[0]) + LEAST_ENERGY
        suspected = self._test.suspects
        changed = acting and self._test.take(start_ns, seconds, mean_square + floor)
        if self._test.suspects and not suspected:
            self._unnamed_ns = None
            self._since.begin(memory, fit, spread)
        if self._test.suspects or changed or self._unnamed_ns is not None:
            self._since.add(memory, here, drift)
        let_baseline_drift(memory, drift)
        add_block(memory, here)
        if changed or (self._unnamed_ns is not None and end_ns >= self._unnamed_ns):
            self._name_change(changed, samples / max(seconds, 1e-3), end_ns)
        if self._stepped_ns is None or end_ns - self._stepped_ns >= self._step_ns:
            self._stepped_ns = end_ns
            self._learner.learn(memory)

    def _name_change(self, changed: bool, rate: float, end_ns: int) -> None:
        """Determine the kind of a change, and continue with the part of the memory still valid.

        If the kind is not clear, it is tried again with more samples.  `rate` is the sampling
        rate [Hz].
        """
        settings, learner = self.settings, self._learner
        found = self._since.explain(self._memory, learner.prior, self._bounds)
        named = found.kind != UNKNOWN
        assert self._test.changed_ns is not None
        late = end_ns - self._test.changed_ns > _NAMED_WITHIN_NS
        self._unnamed_ns = None if named or late else end_ns + _NAMING_NS
        if not (changed or named):
            return
        self._test.kind = found.kind
        kept = settings.memory_kept if named else settings.memory_after_change
        self._since.renew(self._memory, found, rate * kept)
        self._spread.forget()
        learner.restart(found)
