# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Off-line estimator: the fit of a window over everything, without slow change.

The samples are condensed into blocks of one pulse each, from which the normal equations of any
parameters follow exactly (`rpms_ros.identification.estimation.blocks`), so that the cost of a fit
grows with the pulses, not with the samples.  A fit is made whenever the recording has grown
fourfold, counted anew from the first pulse on, so that every sample has an a-priori prediction,
and once more for an estimate, from several starts.

**Basis.**  With `choose_basis`, latency and time constant of the basis are chosen by how well the
last part of the recording that was stimulated is explained (`basis_choice`).

**Constant muscle.**  A fit over everything takes the muscle as constant.  Whether it was is seen
part by part: for each
part of some seconds the response and the recruitment that would explain it best, next to the
recording's own, follow from sums that the fit has anyway.  Where the muscle was the same all the
time they gain no more than noise does; where it tired, where the coil moved or where the patient
tensed it, they gain percents of the force.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rpms_ros.identification.estimation.basis_choice import BasisChoice
from rpms_ros.identification.estimation.blocks import COUNT, grown, ring_order
from rpms_ros.identification.estimation.estimate_builder import nearest_arctangents
from rpms_ros.identification.estimation.estimator import ProjectionEstimator
from rpms_ros.identification.estimation.prior import WindowPrior
from rpms_ros.identification.estimation.settings import Problem, ProjectionSettings
from rpms_ros.identification.estimation.window_equations import Intervals, no_change
from rpms_ros.identification.estimation.window_fit import (
    INTERVAL_NS,
    LIVELINESS,
    NO_EVENTS,
    Linearised,
    Window,
    WindowFit,
    fresh_fit,
    gauss_newton_steps,
    short_events,
)
from rpms_ros.identification.model.estimate import DEFAULT_RATE, Estimate
from rpms_ros.identification.model.recruitment import MOST_SINES, PARAMETERS, SUMMATION
from rpms_ros.identification.quality.doubts import NO_CONSTANT_MUSCLE, RESPONSE_MISFIT, doubted
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray, nanoseconds

_FIRST_FIT_NS = NANOSECONDS_PER_SECOND
_GROWTH = 4
# Every start is tried on so many of the newest blocks; later fits for predictions alone go on from
# the fit before.
_LAST_SCOUTING_NS = 10 * NANOSECONDS_PER_SECOND
_SCOUTED_BLOCKS, _MANY_BLOCKS = 400, 4000
_SCOUTING_STEPS, _FINAL_STEPS = 6, 20
# Starts whose log-likelihoods differ by less lead to the same muscle [nat].
_EQUAL = 2.0
# Most intervals of the disturbance: those of a long recording are longer.
_MOST_INTERVALS = 480
# The part of a recording that chooses the basis, before its last strong pulse, the least samples
# for that, and the length from which the whole grid of bases is searched once more.
_CHOSEN_NS = 40 * NANOSECONDS_PER_SECOND
_LEAST_SAMPLES = 500
_SEARCHED_AGAIN_NS = 10 * NANOSECONDS_PER_SECOND
_CHOICE_STEPS = 10
# Where the clock has jumped, recordings are put one after the other with this distance.
_APART_NS = 60 * NANOSECONDS_PER_SECOND
# The disturbance drifts slowly: a lively one takes up what functions that do not fit leave, and
# with it a part of the curve.
_DRIFT = 3


class BatchEstimator(ProjectionEstimator):
    """Batch estimator; its memory grows with the recording.

    Parameters
    ----------
    settings : ProjectionSettings or None
        Model and numerics.
    rate_hz : float
        Rate for which the recruitment curve is stated [Hz].

    Raises
    ------
    IdentificationError
        If the rate is not above zero.

    Attributes
    ----------
    unexplained : ndarray (parts, 2)
        What parts of the recording would explain better by a muscle of their own; see the
        function of this name.
    """

    name, sines = 'batch', MOST_SINES
    on_line = False

    def __init__(
        self, settings: ProjectionSettings | None = None, rate_hz: float = DEFAULT_RATE
    ) -> None:
        super().__init__(settings, rate_hz)
        self.unexplained = np.empty((0, 2))
        self._origin_ns: int | None = None
        # the first pulse, and when a fit was due last
        self._begun_ns: int | None = None
        self._past_ns = 2**62
        self._last_ns = self._due_ns = self._compared_ns = self._shift_ns = 0
        self._interval_ns = _FIRST_FIT_NS
        self._fitted_samples = self._searches = 0
        self._jumped = False

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending, none before one that was already added [ns, 1]."""
        if len(onset_ns):
            onset_ns = self._in_a_row(onset_ns)
            super().add_pulses(onset_ns, intensity)
            acting_ns = onset_ns[intensity > 0.0]
            if self._begun_ns is None and len(acting_ns):
                self._begun_ns = int(acting_ns[0])

    def forget_pulses(self) -> None:
        """Drop the pulses that still act: the clock has jumped, their lag is unknown."""
        super().forget_pulses()
        self._jumped = True

    def update(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        """Add samples (samples,), ascending; return their a-priori prediction [N].

        See `rpms_ros.identification.model.estimate.Estimator.update`.
        """
        prediction = np.empty(len(stamp_ns))
        first = 0
        if not len(stamp_ns):
            return prediction
        stamp_ns = self._in_a_row(stamp_ns)
        if self._origin_ns is None:
            self._origin_ns = int(stamp_ns[0])
            self._due_ns = self._origin_ns + _FIRST_FIT_NS
        while first < len(stamp_ns):
            begun_ns = self._origin_ns if self._begun_ns is None else self._begun_ns
            if self._past_ns <= begun_ns < self._due_ns:
                # what was fitted at rest says nothing of the pulses
                self._due_ns, self._interval_ns = begun_ns + _FIRST_FIT_NS, _FIRST_FIT_NS
            if stamp_ns[first] >= self._due_ns:
                early = self._last_ns - max(self._origin_ns, begun_ns) < _LAST_SCOUTING_NS
                self._fit_all(scouting=early, final=False)
                self._past_ns = self._due_ns
                while stamp_ns[first] >= self._due_ns:
                    self._interval_ns *= _GROWTH
                    self._due_ns += self._interval_ns
                continue
            last = int(np.searchsorted(stamp_ns, self._due_ns))
            part = slice(first, last)
            self._make_room(int(stamp_ns[last - 1] - stamp_ns[first]))
            prediction[part] = self._add_samples(stamp_ns[part], force[part], usable[part])
            if self.settings.choose_basis:
                self._raw.add(stamp_ns[part], force[part], 0.0, usable[part])
            self._last_ns = int(stamp_ns[last - 1])
            first = last
        return prediction

    def predict(self, stamp_ns: IntArray) -> FloatArray:
        """Return the prediction of the next samples (samples,) [N]."""
        return super().predict(stamp_ns + self._shift_ns)

    def estimate(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Fit all samples so far and return the estimate."""
        self._fit_all(scouting=True, final=True)
        misfit = self._misfit
        doubt = NO_CONSTANT_MUSCLE if misfit > _CHANGED else RESPONSE_MISFIT
        return doubted(super().estimate(stamp_ns, faults), {doubt: misfit > _MISFIT})

    @property
    def _misfit(self) -> float:
        """The largest share of the force that is significantly unexplained in a part."""
        parts, least = self.unexplained, _SIGNIFICANT * self._window.colour
        return float(parts[parts[:, 1] > least, 0].max(initial=0.0))

    def _in_a_row(self, stamp_ns: IntArray) -> IntArray:
        """Return stamps [ns] that go on after a jump of the clock, far behind what was before."""
        if self._jumped:
            self._jumped = False
            self._shift_ns = max(self._last_ns, self._due_ns) + _APART_NS - int(stamp_ns[0])
        return stamp_ns + self._shift_ns

    def _make_room(self, span_ns: int) -> None:
        """Enlarge the ring buffer for the pending pulses and the blocks of a pause."""
        need = int(self._problem.blocks.size[0]) + len(self._delay_line.begin_ns)
        need += span_ns // 200_000_000 + 2
        if need > len(self._problem.blocks.start_ns):
            blocks = grown(self._problem.blocks, 2 * need)
            self._problem = self._problem._replace(blocks=blocks)

    def _fit_all(self, scouting: bool, final: bool) -> None:
        """Fit all samples; with `scouting`, try every start with a few steps first.

        Unless `final`, the fit is for predictions alone.
        """
        samples = int(self._intake.learnt[0])
        if self._origin_ns is None or samples == self._fitted_samples:
            return
        self._fitted_samples = samples
        self._fit_basis(scouting)
        if self.settings.choose_basis and self._choose_basis(final):
            self._fit_basis(scouting)
        self._predict_by_window(self._span(self._problem).length_ns)

    def _span(self, problem: Problem) -> Window:
        """Return the window of the blocks of a problem."""
        blocks = problem.blocks
        place = (int(blocks.head[0]) + problem.first) % len(blocks.start_ns)
        first_ns = int(blocks.start_ns[place])
        most_ns = _MOST_INTERVALS * INTERVAL_NS
        length_ns = INTERVAL_NS * (1 + (self._last_ns - first_ns) // most_ns)
        return self._constant(self._basis.functions, first_ns, length_ns, _DRIFT)

    def _constant(self, functions: int, first_ns: int, length_ns: int, liveliest: int) -> Window:
        """Return a window up to now of a muscle that does not change."""
        now_ns, origin = self._last_ns, no_change(functions)
        times = np.array([now_ns / length_ns])
        return Window(
            first_ns, now_ns, length_ns, times, (), origin, None, liveliest, changes=False
        )

    def _fit_basis(self, scouting: bool) -> None:
        """Fit all samples with the present basis."""
        fit, knowledge = self._window, self._of_any_shape(self._prior)
        if scouting:
            self._scout(fit)
        # of another length of the intervals the disturbance says little
        fit.levels, fit.inflation, fit.left_out = fit.levels[-2:].copy(), 1.0, NO_EVENTS
        window = self._span(self._problem)
        at = gauss_newton_steps(self._problem, fit, knowledge, window, _FINAL_STEPS)
        if at is not None and scouting:
            fit.left_out = short_events(fit, at)
            if len(fit.left_out):
                at = self._fit_without_events(knowledge, window) or at
            self.unexplained = unexplained(at.intervals, window.length_ns, at.point.linear)

    def _fit_without_events(self, knowledge: WindowPrior, window: Window) -> Linearised | None:
        """Fit from the present muscle, whose deviation may be that of the events, and without one.

        Returns where the last step of the likelier one began.
        """
        fit, functions = self._window, self._basis.functions
        other = fresh_fit(self.settings.starts(self.sines)[0], functions)
        other.point.theta[:PARAMETERS] = nearest_arctangents(fit.point.theta[: SUMMATION.start])[0]
        other.left_out, other.colour = fit.left_out, fit.colour
        tried = [
            (gauss_newton_steps(self._problem, one, knowledge, window, _FINAL_STEPS), one)
            for one in (fit, other)
        ]
        at, self._window = max(tried, key=lambda one: one[1].likelihood - one[1].penalty)
        self._window.failures = fit.failures + other.failures
        return at

    def _scout(self, fit: WindowFit) -> None:
        """Try every start on the newest blocks; go on from the best."""
        problem, knowledge = self._newest_blocks(), self._of_any_shape(self._prior)
        window, functions = self._span(problem), self._basis.functions
        trials = [fresh_fit(theta, functions) for theta in self.settings.starts(self.sines)]
        if fit.covariance.any():
            trials.append(replace(fit, levels=np.zeros(2), likelihood=-np.inf, failures=0))
        for one in trials:
            one.most_inflation = 1.0
            gauss_newton_steps(problem, one, knowledge, window, _SCOUTING_STEPS)
        best = max(trials, key=lambda one: one.likelihood)
        fit.failures += sum(one.failures for one in trials)
        # of the same muscle a fit of far more blocks knows more
        many = fit.covariance.any() and self._problem.blocks.size[0] > _MANY_BLOCKS
        known = many and trials[-1].likelihood > best.likelihood - _EQUAL
        if np.isfinite(best.likelihood):
            fit.point = fit.point if known else best.point
            fit.scales, fit.variance = best.scales, best.variance

    def _choose_basis(self, final: bool) -> bool:
        """Choose the basis that explains the recording best; return whether it has changed.

        Among those next to the present one only if `final`: what a fit for predictions alone
        would gain by one of them is little.
        """
        strong_ns = self._raw.last_strong_ns(self._last_ns)
        if strong_ns is None or strong_ns == self._compared_ns:
            return False
        first_ns = max(strong_ns - _CHOSEN_NS, self._raw.first_ns)
        everywhere = self._searches < 1 + (strong_ns - first_ns > _SEARCHED_AGAIN_NS)
        # what does not fit may have been chosen before the recruitment was known: begin anew
        misfit = final and self._misfit > _MISFIT
        everywhere |= misfit
        if not (everywhere or final):
            return False
        present = self.settings.basis if misfit else self._basis
        theta, nothing = self._window.point.theta, np.zeros(present.functions)
        problem, *_ = self._raw.condensed(present, theta, nothing, first_ns)
        samples = problem.blocks.moments[problem.first : int(problem.blocks.size[0]), COUNT].sum()
        if samples < _LEAST_SAMPLES:
            return False
        self._compared_ns = strong_ns
        self._window.colour = self._colour(first_ns)
        knowledge = self._of_any_shape(self._prior)
        window = self._constant(present.functions, first_ns, INTERVAL_NS, len(LIVELINESS) - 1)
        fit = fresh_fit(theta, present.functions)
        if present == self._basis:
            fit = replace(self._window, levels=np.zeros(2), first=0, left_out=NO_EVENTS)
        fit.colour = self._window.colour
        at = gauss_newton_steps(problem, fit, knowledge, window, _CHOICE_STEPS)
        fit.left_out = NO_EVENTS if at is None else short_events(fit, at)
        choice = BasisChoice(self._raw, present, fit, knowledge, window, None)
        self._searches += everywhere
        basis = choice.better(everywhere)
        basis = choice.richer(choice.finer(basis)) if final else basis
        self._basis_spread = choice.spread(basis, self._raw.first_ns)
        if basis == self._basis:
            return False
        found = choice.explained(basis).fit
        self._window.point = found.point
        self._window.scales = replace(found.scales, disturbance=self._window.scales.disturbance)
        self._into_other_blocks(basis, self._raw.first_ns, 0, found.point.linear)
        self._problem = self._problem._replace(first=0)
        return True

    def _newest_blocks(self) -> Problem:
        """Return the problem of the newest blocks, led by those whose pulses still act on them."""
        blocks = self._problem.blocks
        order = ring_order(blocks)
        # of pulses: the newest blocks may be those of a rest
        acting = np.flatnonzero(blocks.intensity[order] > 0.0)[-_SCOUTED_BLOCKS:]
        first = int(acting[0]) if len(acting) else 0
        begin_ns = blocks.start_ns[order[first]] - nanoseconds(self.memory)
        lead = int(np.searchsorted(blocks.start_ns[order[:first]], begin_ns))
        newest = {
            name: values[order[lead:]]
            for name, values in blocks._asdict().items()
            if name not in ('head', 'size')
        }
        newest |= {'head': np.zeros_like(blocks.head), 'size': blocks.size - lead}
        return self._problem._replace(blocks=type(blocks)(**newest), first=first - lead)


_PART_NS = 5_000_000_000
_LEAST_PART_SAMPLES = 200.0
# What a part's own muscle explains better, as a share of the force (root mean square), of a muscle
# that has changed (a move of the coil has 13 %), and of one whose pulses do not add up as in the
# model.  Muscles of the model's kind have 0.1 % at the most where it is significant.
_CHANGED, _MISFIT = 0.01, 0.002
# The same as a multiple of the variance that noise alone would give, 11 in the mean.
_SIGNIFICANT = 100.0
_ROUNDING = 1e-9


def unexplained(intervals: Intervals, length_ns: int, linear: FloatArray) -> FloatArray:
    """Return for each part of a recording what its own muscle would explain better.

    Parameters
    ----------
    intervals : Intervals
        Of the fit of the recording.
    length_ns : int
        Their length [ns].
    linear : ndarray (functions,)
        Its w.

    Returns
    -------
    ndarray (parts, 2)
        Root mean square as a share of that of the muscle's force; squared, as a multiple of the
        variance of what the part's own muscle leaves.
    """
    count = max(1, round(_PART_NS / length_ns))
    found = []
    for first in range(0, len(intervals.samples), count):
        part = slice(first, first + count)
        samples = float(intervals.samples[part].sum())
        if samples > _LEAST_PART_SAMPLES:
            gram, right = _summed(intervals.gram[part], intervals.right[part])
            found.append(_gain(gram, right, float(intervals.energy[part].sum()), samples, linear))
    return np.array(found).reshape(-1, 2)


def _summed(gram: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the sums of successive intervals, with one line as the baseline of all."""
    count, columns = right.shape
    joint = columns - 2
    line = np.zeros((count, columns, columns))
    line[:, np.arange(joint), np.arange(joint)] = 1.0
    # the two hats of each interval, by the line's levels at both ends
    share = np.arange(count + 1.0) / count
    line[:, joint, joint], line[:, joint, joint + 1] = 1.0 - share[:-1], share[:-1]
    line[:, joint + 1, joint], line[:, joint + 1, joint + 1] = 1.0 - share[1:], share[1:]
    return np.einsum('jki,jkm->im', line, gram @ line), np.einsum('jki,jk->i', line, right)


def _gain(
    gram: FloatArray, right: FloatArray, energy: float, samples: float, linear: FloatArray
) -> tuple[float, float]:
    """Return what the own muscle of a part explains better; see `unexplained`.

    A baseline of its own comes first: a sensor that drifts is no other muscle.
    """
    joint = len(gram) - 2
    muscle = np.zeros(joint + 2)
    muscle[joint - len(linear) : joint] = linear
    force = gram @ muscle
    power = float(muscle @ force)
    if not power > 0.0:
        return 0.0, 0.0
    rest = right - force
    squares = energy - float(muscle @ (right + rest))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), np.finfo(np.float64).tiny))
    matrix = gram * np.outer(scale, scale) + _ROUNDING * np.eye(joint + 2)
    rest = rest * scale
    level = float(rest[joint:] @ np.linalg.solve(matrix[joint:, joint:], rest[joint:]))
    both = float(rest @ np.linalg.solve(matrix, rest))
    gained = max(both - level, 0.0)
    left = max(squares - both, _ROUNDING * energy) / max(samples - joint - 2, 1.0)
    return float(np.sqrt(gained / power)), gained / left
