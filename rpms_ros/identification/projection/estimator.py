# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Common parts of the batch and the horizon estimator: intake, prediction, estimates."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.estimate import DEFAULT_RATE
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.estimate import recruiting_range
from rpms_ros.identification.faults import FACTORISATION_FAILED
from rpms_ros.identification.faults import FaultCounter
from rpms_ros.identification.projection.block_statistics import COUNT
from rpms_ros.identification.projection.block_statistics import TIME
from rpms_ros.identification.projection.block_statistics import empty_blocks
from rpms_ros.identification.projection.data_intake import Intake
from rpms_ros.identification.projection.data_intake import fresh_intake
from rpms_ros.identification.projection.data_intake import take
from rpms_ros.identification.projection.estimate_builder import Counters
from rpms_ros.identification.projection.estimate_builder import EstimateBuilder
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.fit import empty_fit
from rpms_ros.identification.projection.missing_area import ResidualSums
from rpms_ros.identification.projection.prediction import predict
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.projection.problem import BaselineKnots
from rpms_ros.identification.projection.problem import Problem
from rpms_ros.identification.projection.problem import pass_arrays
from rpms_ros.identification.projection.pulse_delay_line import PulseDelayLine
from rpms_ros.identification.projection.residuals import residual_sums
from rpms_ros.identification.projection.settings import ProjectionSettings
from rpms_ros.identification.projection.uncertainty import SHORTEST_CELL_NS
from rpms_ros.identification.projection.uncertainty import residual_spread
from rpms_ros.identification.saved_state import RestorableWithSettings
from rpms_ros.identification.saved_state import State
from rpms_ros.identification.saved_state import described
from rpms_ros.identification.saved_state import expect
from rpms_ros.muscle.identified_form import RecruitmentParameters
from rpms_ros.muscle.identified_form import identified_recruitment
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray


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
        basis = self.settings.basis
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

    def _take(
        self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray, prediction: FloatArray
    ) -> None:
        """Add samples (samples,) to the blocks; write their prediction."""
        pending = self._delay_line
        begun = take(
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
        head, size = int(blocks.head[0]), int(blocks.size[0])
        count = size - first
        if count <= 0:
            return ResidualSums(np.zeros(1), 0.0, 0.0, 0.0, 0.0)
        sums = np.zeros(count)
        residual_sums(self._problem, size, self._fit, sums)
        order = (head + np.arange(first, size)) % len(blocks.start_ns)
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
