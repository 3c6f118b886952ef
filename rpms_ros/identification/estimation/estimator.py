# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Common parts of the batch and the tracking estimator: samples in, predictions, estimates."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rpms_ros.errors import IdentificationError, check_number
from rpms_ros.identification.estimation.blocks import (
    COUNT,
    TIME,
    PulseDelayLine,
    empty_blocks,
    ring_order,
)
from rpms_ros.identification.estimation.estimate_builder import (
    Counters,
    EstimateBuilder,
    Muscle,
    ResidualSums,
    Uncertainty,
    condition_number,
)
from rpms_ros.identification.estimation.intake import (
    Predictor,
    RawSamples,
    add_samples,
    fresh_intake,
    predict,
    recompute_state,
    squared_recruitment,
)
from rpms_ros.identification.estimation.prior import FittedMuscle, WindowPrior, physiological_prior
from rpms_ros.identification.estimation.settings import Baseline, Problem, ProjectionSettings
from rpms_ros.identification.estimation.window_fit import INTERVAL_NS, beyond_the_sines, fresh_fit
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.estimate import (
    SMALLEST_INTENSITY_SPAN,
    Estimate,
    recruiting_range,
)
from rpms_ros.identification.model.recruitment import (
    PARAMETERS,
    SUMMATION,
    WINDOW_SINES,
    recruitment_curve,
)
from rpms_ros.identification.quality.doubts import FACTORISATION_FAILED, FaultCounter
from rpms_ros.pulses import BoolArray, FloatArray, IntArray

# Of the noise of a sensor: between what an effort, a tremor or the muscle does and the corner of a
# filter [Hz]; above this ratio of second differences it is not white.  Outside these shares of the
# force's power it is the model's own error, or that of a muscle which is not known yet.
_LOW_HZ, _HIGH_HZ = 13.0, 27.0
_SMOOTH, _LEAST_NOISE, _MOST_NOISE = 1.5, 1e-6, 1e-3
_LEAST_COLOUR_SAMPLES = 500
# What the functions miss of a response, as a share of its norm; phases of a period.
_MISSED, _PHASES = 2e-4, 50
# What nobody notices of a force that follows the pulses, as a share of the muscle's.
_UNNOTICED = 5e-4


def noise_colour(stamp_ns: IntArray, force: FloatArray, rest: FloatArray, before: float) -> float:
    """Return by how much noise is stronger where the muscle moves than in the mean; at least 1.

    Behind a low-pass neighbouring samples tell the same.  Taken as white, such noise is too strong
    at low frequencies and would pass for an effort of the patient.

    Parameters
    ----------
    stamp_ns : ndarray of int64 (samples,)
        Of samples that come about evenly [ns].
    force, rest : ndarray (samples,)
        Measured, and what the muscle leaves of it [N].
    before : float
        What is returned where these samples do not tell.
    """
    if len(rest) < _LEAST_COLOUR_SAMPLES:
        return before
    near = np.mean(np.diff(rest, 2) ** 2)
    far = np.mean((rest[4:] - 2.0 * rest[2:-2] + rest[:-4]) ** 2)
    if far < _SMOOTH * near:
        return 1.0
    spectrum, whole = np.abs(np.fft.rfft(np.hanning(len(rest)) * np.stack((rest, force)))) ** 2
    hertz = np.arange(len(whole)) / (1e-9 * float(stamp_ns[-1] - stamp_ns[0]))
    beyond = spectrum[hertz > _LOW_HZ]
    if not _LEAST_NOISE * whole.sum() < beyond.sum() < _MOST_NOISE * whole.sum():
        return before
    # the median of an exponential distribution, which lines do not move
    between = np.median(spectrum[(hertz > _LOW_HZ) & (hertz < _HIGH_HZ)]) / math.log(2.0)
    return max(1.0, float(between / np.mean(beyond)))


class ProjectionEstimator:
    """Adds samples and pulses to blocks; derived classes decide when to fit.

    Parameters
    ----------
    settings : ProjectionSettings or None
        Model and numerics.
    rate_hz : float
        Rate for which the recruitment curve is stated [Hz].
    capacity : int
        Largest number of blocks.

    Raises
    ------
    IdentificationError
        If the rate is not above zero.
    """

    name, sines = 'projection', WINDOW_SINES
    on_line = True
    _model_error = 0.0

    def __init__(
        self, settings: ProjectionSettings | None, rate_hz: float, capacity: int = 64
    ) -> None:
        check_number(IdentificationError, 'repetition rate', rate_hz, 0, above=True, unit='Hz')
        self.settings = settings if settings is not None else ProjectionSettings()
        self.rate_hz = rate_hz
        basis = self.settings.basis
        functions = basis.functions
        self._problem = Problem(
            blocks=empty_blocks(capacity, functions),
            first=0,
            input_gain=basis.input_gain,
            baseline=Baseline(0, INTERVAL_NS),
        )
        start = self.settings.starts(self.sines)[0]
        self._predictor = Predictor(start, np.zeros(functions), np.zeros(2))
        self._window = fresh_fit(start, functions)
        self._basis_spread = np.zeros((functions, functions))
        self._prior = physiological_prior(self.settings, self.sines)
        self._intake = fresh_intake(functions)
        self._delay_line = PulseDelayLine(
            basis.latency, self.settings.by_rate, rate_hz, self.settings.history
        )
        self._raw = RawSamples()
        self._faults = FaultCounter()
        self._pulses = 0
        self._intensity_range = (np.inf, -np.inf)
        self._use(basis)

    @property
    def memory(self) -> float:
        """Longest time for which a pulse acts on the model's output [s]."""
        return self.settings.basis.duration

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending, none before one that was already added [ns, 1]."""
        if not len(onset_ns):
            return
        self._delay_line.add(onset_ns, intensity)
        self._pulses += len(onset_ns)
        if self.settings.choose_basis:
            weight = self._delay_line.weight[-len(onset_ns) :]
            self._raw.add_pulses(onset_ns, intensity, weight)

    def forget_pulses(self) -> None:
        """Drop the pulses that still act: the clock has jumped, their lag is unknown."""
        self._delay_line.forget()
        self._intake.fresh[0] = 1.0
        for recent in (self._intake.error_energy, self._intake.force_energy, self._intake.recent):
            recent[0] = 0.0
        # The baseline continues at its last level: its slope is valid for the old time line only.
        self._predictor.levels[:] = self._predictor.levels[-1]

    def predict(self, stamp_ns: IntArray) -> FloatArray:
        """Return the prediction of the next samples (samples,) [N]."""
        pending, problem = self._delay_line.pending, self._problem
        return predict(stamp_ns, pending, problem, self._intake, self._predictor, self._rate)

    def estimate(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Return the present estimate."""
        fit, predictor = self._window, self._predictor
        nonlinear = len(fit.point.theta)
        own = slice(nonlinear, nonlinear + len(fit.point.linear))
        sums, sure = self._residual_sums(), self._uncertainty()
        beyond = beyond_the_sines(fit.scales, self.sines)
        found = Muscle(
            self._theta[: SUMMATION.start],
            predictor.linear,
            predictor.levels,
            moved=float(np.abs(fit.moved[:PARAMETERS]).max()),
            condition=condition_number(fit.covariance[own, own]),
            area_error=sums.missing_area(fit.variance * fit.colour),
            curve_error=math.hypot(beyond, self._in_common(sums, sure)),
            model_error=self._model_error,
            unnoticed=self._unnoticed(sums, sure),
        )
        counters = self._counters()
        deviation = self._prior.deviation[:PARAMETERS]
        # faults of monitors of other packages are counted under any name
        counted = FaultCounter(dict.fromkeys(faults, ''))
        for name, count in (*faults.items(), *self._faults.counts().items()):
            counted.add(name, count)
        counted.add(FACTORISATION_FAILED, fit.failures)
        return self._builder.make(stamp_ns, found, sure, deviation, counters, counted.counts())

    def _unnoticed(self, sums: ResidualSums, sure: Uncertainty | None) -> FloatArray | float:
        """Return the covariance by a force that nobody notices, a multiple of that by the noise.

        It follows the pulses, as that of a strap that gives way or of a tail of the response, so
        that it does not vanish in the mean of many samples as noise does.
        """
        fit, blocks = self._window, self._problem.blocks
        if sure is None or not sums.seconds > 0.0:
            return 0.0
        linear, pulses = fit.point.linear, int(blocks.size[0]) - self._problem.first
        square = (float(self._basis.area @ linear) / sums.seconds) ** 2 * pulses * sums.recruited
        noise = len(linear) * fit.variance * max(fit.inflation, fit.colour)
        last = len(fit.point.theta)
        joint = last + len(linear)
        by_noise = sure._replace(covariance=fit.covariance[:joint, :joint])
        known = by_noise.without(slice(last - 2, last)).covariance
        return _UNNOTICED**2 * square * sums.samples / noise * known

    def _in_common(self, sums: ResidualSums, sure: Uncertainty | None) -> float:
        """Return the error of the recruitment that all pulses share by what the functions miss.

        As a share of the recruitment at full intensity.  The force that pulses have in common
        shows in its ripple alone, and what the functions miss has a ripple too.
        """
        blocks, fit, low = self._problem.blocks, self._window, self._intensity_range[0]
        order = ring_order(blocks)[self._problem.first :]
        acting_ns = blocks.start_ns[order][blocks.intensity[order] > 0.0]
        period = 1e-9 * float(np.median(np.diff(acting_ns))) if len(acting_ns) > 1 else 0.0
        if sure is None or not (period > 0.0 and sums.seconds > 0.0):
            return 0.0
        count = _PHASES * math.ceil(self._basis.duration / period)
        lag = np.arange(count) * (period / _PHASES)
        ripple = (self._basis.evaluate(lag) @ sure.linear).reshape(-1, _PHASES).sum(axis=0)
        power = period * float(np.var(ripple))
        height, slopes = recruitment_curve(np.array([low, 1.0]), sure.theta)
        part = slice(len(sure.theta))
        variance = float(slopes[0] @ sure.covariance[part, part] @ slopes[0])
        information = len(acting_ns) * power * sums.samples / sums.seconds
        share = min(1.0, variance * information / (fit.variance * max(fit.inflation, fit.colour)))
        size = float(sure.linear @ sure.linear) * sums.recruited / len(acting_ns)
        return share * _MISSED * math.sqrt(size / max(power, 1e-300)) / abs(float(height[1]))

    def _uncertainty(self) -> Uncertainty | None:
        """Return the uncertainty of recruitment and w, None before the first fit."""
        sure = self._window.uncertainty(self.settings.confidence, self._basis_spread)
        last = len(self._window.point.theta)
        return sure and sure.without(slice(last - 2, last))

    @property
    def _theta(self) -> FloatArray:
        """Theta of now."""
        return self._predictor.theta

    def fitted(self) -> FittedMuscle | None:
        """Return the muscle for a warm start, None where no recruitment is known."""
        fit, fine = self._window, slice(PARAMETERS + WINDOW_SINES, PARAMETERS + self.sines)
        sure = fit.uncertainty(self.settings.confidence, self._basis_spread)
        if sure is None:
            return None
        return FittedMuscle(
            time_constant_s=self._basis.time_constant,
            latency_s=self._basis.latency,
            theta=np.delete(fit.point.theta, fine),
            linear=fit.point.linear,
            covariance=sure.without(fine).covariance,
            variance=fit.variance,
        )

    def _colour(self, first_ns: int) -> float:
        """Return the colour of the noise of samples from a time [ns] on."""
        fit = self._window
        rest = self._raw.rest(self._basis, fit.point.theta, fit.point.linear, first_ns)
        return noise_colour(*rest, fit.colour)

    def _use(self, basis: LaguerreBasis) -> None:
        """Use a basis from now on."""
        self._basis = basis
        self._rate = 2.0 / basis.time_constant
        self._delay_line.latency(basis.latency)
        settings = self.settings
        self._builder = EstimateBuilder(
            self.name, basis, self.rate_hz, settings.confidence, wide=settings.choose_basis
        )

    def _into_other_blocks(
        self, basis: LaguerreBasis, first_ns: int, capacity: int, linear: FloatArray
    ) -> None:
        """Put samples from `first_ns` on into blocks of another basis, where w is `linear`."""
        problem, intake, pending, _ = self._raw.condensed(
            basis, self._window.point.theta, linear, first_ns, capacity
        )
        self._problem = problem._replace(baseline=self._problem.baseline)
        self._intake = self._intake._replace(
            state=intake.state, response=intake.response, values=intake.values, fresh=intake.fresh
        )
        self._delay_line.restart(*self._raw.newest_pulses(pending), basis.latency)
        self._use(basis)

    def _add_samples(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        """Add samples (samples,) to the blocks; return their prediction."""
        pending, state = self._delay_line.pending, (self._intake, self._predictor, self._rate)
        begun, prediction = add_samples(stamp_ns, force, usable, pending, self._problem, *state)
        # those that act, not all that are known: how far ahead pulses come differs on line
        self._intensity_range = recruiting_range(pending.intensity[:begun], self._intensity_range)
        self._delay_line.drop(begun)
        return prediction

    def _of_any_shape(self, knowledge: WindowPrior) -> WindowPrior:
        """Return a prior of the arctangents alone while there was one intensity only."""
        low, high = self._intensity_range
        shown = high - low >= SMALLEST_INTENSITY_SPAN
        return replace(knowledge, any_shape=knowledge.any_shape and shown)

    def _predict_by_window(self, length_ns: int) -> None:
        """Use the fit, with intervals of this length [ns], for the predictions of the intake."""
        fit = self._window
        self._predictor = Predictor(
            fit.point.theta.copy(), fit.point.linear.copy(), fit.levels[-2:].copy()
        )
        origin = (fit.first + len(fit.levels) - 2) * length_ns
        self._problem = self._problem._replace(baseline=Baseline(origin, length_ns))
        recompute_state(self._problem, self._intake, self._predictor)

    def _residual_sums(self) -> ResidualSums:
        """Return the sums of the residuals in the intervals of the fit."""
        blocks, fit = self._problem.blocks, self._window
        moments = blocks.moments[ring_order(blocks)[self._problem.first :]]
        moments = moments[moments[:, COUNT] > 0.0]
        # the mean time since a block began is half of its length
        seconds = 2.0 * float(np.sum(moments[:, TIME] / moments[:, COUNT]))
        return ResidualSums(
            np.array([fit.residual_spread]),
            float(len(fit.levels) - 1),
            float(moments[:, COUNT].sum()),
            seconds,
            squared_recruitment(self._problem, fit.point.theta),
        )

    def _counters(self) -> Counters:
        """Return the properties of the data so far."""
        intake = self._intake
        energy = float(intake.force_energy[0])
        return Counters(
            samples=int(intake.learnt[0]),
            pulses=self._pulses,
            intensity_range=self._intensity_range,
            output_error=float(np.sqrt(intake.error_energy[0] / energy)) if energy > 0.0 else 0.0,
        )
