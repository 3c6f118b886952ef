# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Off-line estimator: variable projection over all samples, from many starts.

The samples are condensed into blocks of one pulse each, from which the normal equations of any
parameters follow exactly (`rpms_ros.identification.estimation.blocks`), so that the cost of a fit
grows with the pulses, not with the samples.  A fit is made whenever the recording has doubled, so
that every sample has an a-priori prediction, and once more for an estimate.

**Basis.**  With `choose_basis`, latency and time constant of the basis are chosen on a grid by how
well a part of the recording is explained.  All bases have as many unknowns, so the one with the
smallest residual is the most likely one; of those that only the noise tells apart the middle is
taken.

**Constant muscle.**  A fit over everything takes the muscle as constant.  Whether it was is seen
part by part: for each
part of some seconds the response and the recruitment that would explain it best, next to the
recording's own, follow from sums that the fit has anyway.  Where the muscle was the same all the
time they gain no more than noise does; where it tired, where the coil moved or where the patient
tensed it, they gain percents of the force.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar

import numpy as np

from rpms_ros.identification.estimation.blocks import LONGEST_BLOCK_NS, empty_blocks, grown
from rpms_ros.identification.estimation.estimator import (
    Intake,
    ProjectionEstimator,
    add_samples,
    fresh_intake,
    recompute_state,
)
from rpms_ros.identification.estimation.gauss_newton import (
    Fit,
    complete_equations,
    empty_fit,
    fit_linear,
    improve,
)
from rpms_ros.identification.estimation.settings import (
    PARAMETERS,
    BaselineKnots,
    Prior,
    Problem,
    ProjectionSettings,
    pass_arrays,
)
from rpms_ros.identification.estimation.uncertainty import EstimateBuilder
from rpms_ros.identification.estimation.window_equations import condensed, no_change
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.estimate import DEFAULT_RATE, Estimate
from rpms_ros.identification.stream.doubts import NO_CONSTANT_MUSCLE, REASON
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray, nanoseconds
from rpms_ros.saved_state import Restorable, expect

Array = TypeVar('Array', IntArray, FloatArray)

_ROOM = 4096


class Part(NamedTuple):
    """Samples and pulses between two jumps of the clock, as slices of the record."""

    samples: slice
    pulses: slice


class SampleRecord(Restorable):
    """Usable samples and pulses since the start; its memory grows with the recording."""

    _stamp_ns: IntArray
    _force: FloatArray
    _size: int
    _onset_ns: IntArray
    _pulse: FloatArray
    _pulses: int
    _jumps: list[tuple[int, int]]

    def __init__(self) -> None:
        self._stamp_ns = np.zeros(_ROOM, dtype=np.int64)
        self._force = np.zeros(_ROOM)
        self._size = 0
        self._onset_ns = np.zeros(_ROOM, dtype=np.int64)
        # intensity and weight
        self._pulse = np.zeros((_ROOM, 2))
        self._pulses = 0
        self._jumps = []

    def _check_restored(self) -> None:
        samples = self._stamp_ns.shape == self._force.shape == (len(self._force),)
        pulses = self._pulse.shape == (len(self._onset_ns), 2) and self._onset_ns.ndim == 1
        within = 0 <= self._size <= len(self._force) and 0 <= self._pulses <= len(self._onset_ns)
        places = np.array([(0, 0), *self._jumps, (self._size, self._pulses)])
        ordered = bool((np.diff(places, axis=0) >= 0).all())
        expect(samples and pulses and within and ordered, 'SampleRecord', 'arrays of one size')

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray, weight: FloatArray) -> None:
        """Add pulses (pulses,), ascending, with the factor of their recruitment."""
        end = self._pulses + len(onset_ns)
        self._onset_ns = _grown(self._onset_ns, end)
        self._pulse = _grown(self._pulse, end)
        self._onset_ns[self._pulses : end] = onset_ns
        self._pulse[self._pulses : end] = np.stack((intensity, weight), axis=1)
        self._pulses = end

    def add(self, stamp_ns: IntArray, force: FloatArray) -> None:
        """Add usable samples (samples,), ascending."""
        end = self._size + len(stamp_ns)
        self._stamp_ns = _grown(self._stamp_ns, end)
        self._force = _grown(self._force, end)
        self._stamp_ns[self._size : end] = stamp_ns
        self._force[self._size : end] = force
        self._size = end

    def jump(self) -> None:
        """Note that the clock has jumped: earlier pulses do not act on later samples."""
        self._jumps.append((self._size, self._pulses))

    def parts(self) -> list[Part]:
        """Return the parts between jumps, in order."""
        edges = [(0, 0), *self._jumps, (self._size, self._pulses)]
        return [
            Part(slice(first[0], last[0]), slice(first[1], last[1]))
            for first, last in pairwise(edges)
        ]

    def newest_pulses(self, count: int) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return onset [ns], intensity and weight of the newest pulses (count,)."""
        here = slice(self._pulses - count, self._pulses)
        return self._onset_ns[here], self._pulse[here, 0], self._pulse[here, 1]

    def window(self, longest_ns: int) -> Part | None:
        """Return the samples that choose a basis: the longest part, from its first strong pulse.

        A pulse is strong with half of the highest intensity.  None if there is no such part.
        """
        part = max(self.parts(), key=lambda one: one.samples.stop - one.samples.start)
        stamps, onsets = self._stamp_ns[part.samples], self._onset_ns[part.pulses]
        if not len(stamps):
            return None
        # how far ahead of the samples pulses are known must not matter
        onsets = onsets[: np.searchsorted(onsets, stamps[-1])]
        intensity = self._pulse[part.pulses, 0][: len(onsets)]
        if not intensity.max(initial=0.0) > 0.0:
            return None
        strong = int(np.argmax(intensity >= 0.5 * intensity.max()))
        ends_ns = int(onsets[strong]) + longest_ns
        edges = np.searchsorted(stamps, [int(onsets[strong]), ends_ns]) + part.samples.start
        last = int(np.searchsorted(onsets, ends_ns)) + part.pulses.start
        return Part(slice(int(edges[0]), int(edges[1])), slice(part.pulses.start, last))

    def span_ns(self, part: Part) -> tuple[int, int]:
        """Return the first and the last stamp of a part that has samples [ns]."""
        return int(self._stamp_ns[part.samples.start]), int(self._stamp_ns[part.samples.stop - 1])

    def condensed(
        self, basis: LaguerreBasis, prior: Prior, baseline: BaselineKnots, parts: list[Part]
    ) -> tuple[Problem, Intake, int]:
        """Return the samples of parts, condensed into blocks for a basis.

        Parameters
        ----------
        basis : LaguerreBasis
            The basis.
        prior : Prior
            Prior of the problem.
        baseline : BaselineKnots
            Baseline of the problem.
        parts : list of Part
            Samples that are fitted; pulses before the first sample advance its state.

        Returns
        -------
        tuple
            Problem, intake at the newest sample, and how many pulses have not begun to act.
        """
        need = 8
        for part in parts:
            if part.samples.start < part.samples.stop:
                first_ns, last_ns = self.span_ns(part)
                need += (last_ns - first_ns) // (LONGEST_BLOCK_NS // 2) + 8
            need += part.pulses.stop - part.pulses.start
        functions = basis.functions
        problem = Problem(
            blocks=empty_blocks(need, functions),
            first=0,
            input_gain=basis.input_gain,
            baseline=baseline,
            prior=prior,
            work=pass_arrays(functions),
        )
        # its predictions are not used
        fit = empty_fit(np.ones(4), functions, baseline.knots)
        intake = fresh_intake(functions)
        waiting = 0
        latency_ns = round(basis.latency * NANOSECONDS_PER_SECOND)
        for part in parts:
            intake.fresh[0] = 1.0
            stamps = self._stamp_ns[part.samples]
            begin_ns = self._onset_ns[part.pulses] + latency_ns
            begun = add_samples(
                stamps,
                self._force[part.samples],
                np.ones(len(stamps), dtype=np.bool_),
                begin_ns,
                np.ascontiguousarray(self._pulse[part.pulses, 0]),
                np.ascontiguousarray(self._pulse[part.pulses, 1]),
                problem,
                intake,
                fit,
                2.0 / basis.time_constant,
                np.empty(len(stamps)),
            )
            waiting = len(begin_ns) - begun
        return problem, intake, waiting


def _grown(values: Array, least: int) -> Array:
    """Return the values in an array with room for so many rows."""
    if least <= len(values):
        return values
    larger = np.zeros((max(least, 2 * len(values)), *values.shape[1:]), dtype=values.dtype)
    larger[: len(values)] = values
    return larger


Place = tuple[int, int]
"""Point of the grid: steps of the time constant and of the latency from those of the start."""

# 38 ms times 1.5^(k / 4): 5 to 105 ms; 8 ms and j / 4 ms: 0 to 35 ms.
_RATIO = 1.5**0.25
_SHIFT = 0.25e-3
_FASTEST, _SLOWEST = -20, 10
_SOONEST, _LATEST = -32, 108
_COARSE = tuple((k, j) for k in range(-16, 11, 4) for j in (-32, -16, 0, 20, 44, 72))
# Steps of the search; a slower basis that begins earlier resembles a faster one that begins later.
_STRIDES = (
    *((1, 0), (-1, 0), (0, 1), (0, -1), (0, 2), (0, -2), (0, 8), (0, -8)),
    *((3, 0), (-3, 0), (1, -2), (-1, 2), (3, -1), (-3, 1), (3, 1), (-3, -1)),
)
# Points whose log-likelihoods differ by less are told apart by the noise alone [nat].
_EQUAL = 6.0
# How far the latency follows from one time constant to the next.
_FOLLOWED = (0, -1, 1, -2, 2, -4, 4)
# Latencies are compared step by step up to this distance, and then in strides: the edges of a wide
# range need not be known to a step.
_FINE, _STRIDE = 8, 4
_STEPS = 6
_TOLERANCE = 1e-3
_DAMPING = 1e-2
# Residuals below this share of the energy of the force are not distinguished.
_LEAST_SHARE = 1e-9


def basis_at(start: LaguerreBasis, place: Place) -> LaguerreBasis:
    """Return the basis at a point of the grid around `start`."""
    time_constant = start.time_constant * _RATIO ** place[0]
    return LaguerreBasis(start.functions, time_constant, start.latency + _SHIFT * place[1])


def _between(low: int, high: int, first: int, last: int, best: int) -> int:
    """Return the middle of what is equal from `low` to `high`; that of the start if all is."""
    if low - first < _STRIDE and last - high < _STRIDE:
        return 0
    # of two, none is at an edge
    return (low + high + 1) // 2 if high - low > 1 else best


class BasisSearch:
    """Search for the basis that explains a part of a recording best.

    Parameters
    ----------
    record : SampleRecord
        The recording.
    part : Part
        The part that is fitted.
    start : LaguerreBasis
        Basis at the point (0, 0) of the grid.
    theta : ndarray (4,)
        Start of the nonlinear parameters.
    prior : Prior
        Prior and bounds.
    knot_spacing : float
        Distance of the baseline's knots [s].
    """

    def __init__(
        self,
        record: SampleRecord,
        part: Part,
        start: LaguerreBasis,
        theta: FloatArray,
        prior: Prior,
        knot_spacing: float,
    ) -> None:
        self._record, self._part, self._start = record, part, start
        self._theta, self._prior = theta, prior
        first_ns, last_ns = record.span_ns(part)
        intervals = max(round((last_ns - first_ns) / NANOSECONDS_PER_SECOND / knot_spacing), 1)
        spacing_ns = max(-(-(last_ns - first_ns) // intervals), 1)
        self._baseline = BaselineKnots(intervals + 1, first_ns, spacing_ns)
        self._found: dict[Place, float] = {}

    def best(self, place: Place, everywhere: bool) -> Place:
        """Return the middle of the best points found from `place`.

        With `everywhere` the search begins at the best of a coarse grid too.
        """
        if everywhere:
            place = min((place, *_COARSE), key=self._unexplained)
        while True:
            around = [(place[0] + k, place[1] + j) for k, j in _STRIDES]
            nearest = min((place, *filter(self._has, around)), key=self._unexplained)
            if nearest == place:
                break
            place = nearest
        return self._middle(place)

    def _middle(self, best: Place) -> Place:
        """Return the point in the middle of those that are as good as the best.

        A slow change of intensity tells little of the dynamics, and the best of many points that
        are nearly equal is one at the edge as often as not, whose functions just bear the twitch.
        First the middle of the time constants, then that of the latencies there; if all of them
        are equal, that of the start.
        """
        most = self._unexplained(best) + _EQUAL
        found = {best[0]: best[1]}
        for step in (-1, 1):
            place = best
            while True:
                beside = [(place[0] + step, place[1] + j) for j in _FOLLOWED]
                place = min(filter(self._has, beside), key=self._unexplained, default=best)
                if place == best or self._unexplained(place) > most:
                    break
                found[place[0]] = place[1]
        constant = _between(min(found), max(found), _FASTEST, _SLOWEST, best[0])
        low, high = (self._last_latency(constant, found[constant], way, most) for way in (-1, 1))
        soonest = next(j for j in range(_SOONEST, 1) if self._has((constant, j)))
        return constant, _between(low, high, soonest, _LATEST, found[constant])

    def _last_latency(self, constant: int, latency: int, way: int, most: float) -> int:
        """Return the last latency on the way that is as good."""
        distance = 0
        while True:
            further = distance + (1 if distance < _FINE else _STRIDE)
            place = (constant, latency + way * further)
            if not self._has(place) or self._unexplained(place) > most:
                return latency + way * distance
            distance = further

    def _has(self, place: Place) -> bool:
        """Return whether the grid has a point."""
        k, j = place
        sooner = self._start.latency + _SHIFT * j
        return _FASTEST <= k <= _SLOWEST and _SOONEST <= j <= _LATEST and sooner > -1e-12

    def _unexplained(self, place: Place) -> float:
        """Return minus the log-likelihood of a point, without a constant [nat]."""
        if place not in self._found:
            self._found[place] = self._fitted(basis_at(self._start, place))
        return self._found[place]

    def _fitted(self, basis: LaguerreBasis) -> float:
        problem, _, _ = self._record.condensed(basis, self._prior, self._baseline, [self._part])
        # the force of pulses before the part is unknown
        knots = self._baseline.knots
        fit, trial = (empty_fit(self._theta, basis.functions, knots) for _ in range(2))
        fit.damping[0] = _DAMPING
        fit_linear(problem, fit, True)
        fit_linear(problem, fit, True)
        improve(problem, fit, trial, _STEPS, _TOLERANCE)
        samples, energy = float(fit.samples[0]), float(fit.energy[0])
        least = _LEAST_SHARE * energy + np.finfo(np.float64).tiny
        return 0.5 * samples * math.log(float(fit.squares[0]) + least)


_FIRST_FIT_NS = NANOSECONDS_PER_SECOND
_GROWTH = 2
# A shorter recording gets a constant baseline: its slope could not be determined.
_SHORTEST_SLOPE_NS = 5 * NANOSECONDS_PER_SECOND
# Later fits for predictions alone start from the fit before and try no other start.
_LAST_SCOUTING_NS = 10 * NANOSECONDS_PER_SECOND
_SCOUTED_BLOCKS = 200
_SCOUTING_STEPS = 5
_SCOUTING_TOLERANCE = 1e-3
_FINAL_STEPS = 12
_FINAL_TOLERANCE = 1e-9
_ROUNDS = 2
_START_DAMPING = 1e-2
# The newest part of a recording that chooses the basis, the least samples for that, and the
# length from which the whole grid of bases is searched once more.
_CHOSEN_NS = 40 * NANOSECONDS_PER_SECOND
_LEAST_SAMPLES = 500
_SEARCHED_AGAIN_NS = 10 * NANOSECONDS_PER_SECOND


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
    """

    name = 'batch'
    on_line = False

    _origin_ns: int | None
    _last_ns: int
    _due_ns: int
    _interval_ns: int
    _fitted_samples: int
    _place: tuple[int, int]
    _searches: int
    _looked_at: tuple[int, int]
    _record: SampleRecord

    def __init__(
        self,
        settings: ProjectionSettings | None = None,
        rate_hz: float = DEFAULT_RATE,
    ) -> None:
        super().__init__(settings, rate_hz)
        if not self.settings.baseline:
            self._reshape(0)
        self._origin_ns = None
        self._last_ns = 0
        self._due_ns = 0
        self._interval_ns = _FIRST_FIT_NS
        self._fitted_samples = 0
        self._place = (0, 0)
        self._searches = 0
        self._looked_at = (0, 0)
        self._record = SampleRecord()
        if self.settings.choose_basis:
            self._use(self.settings.basis)

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending, none before one that was already added [ns, 1]."""
        super().add_pulses(onset_ns, intensity)
        if self.settings.choose_basis and len(onset_ns):
            weight = self._delay_line.weight[-len(onset_ns) :]
            self._record.add_pulses(onset_ns, intensity, weight)

    def forget_pulses(self) -> None:
        """Drop the pulses that still act: the clock has jumped, their lag is unknown."""
        super().forget_pulses()
        self._record.jump()

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore a saved state; see `Restorable.restore`."""
        super().restore(state)
        if self.settings.choose_basis:
            self._use(basis_at(self.settings.basis, self._place))

    def update(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        """Add samples (samples,), ascending; return their a-priori prediction [N].

        See `rpms_ros.identification.model.estimate.Estimator.update`.
        """
        prediction = np.empty(len(stamp_ns))
        first = 0
        if not len(stamp_ns):
            return prediction
        if self._origin_ns is None:
            self._origin_ns = int(stamp_ns[0])
            self._due_ns = self._origin_ns + _FIRST_FIT_NS
        while first < len(stamp_ns):
            if stamp_ns[first] >= self._due_ns:
                early = self._last_ns - self._origin_ns < _LAST_SCOUTING_NS
                self._fit_all(scouting=early)
                while stamp_ns[first] >= self._due_ns:
                    self._interval_ns *= _GROWTH
                    self._due_ns += self._interval_ns
            last = int(np.searchsorted(stamp_ns, self._due_ns))
            part = slice(first, last)
            self._make_room(int(stamp_ns[last - 1] - stamp_ns[first]))
            self._add_samples(stamp_ns[part], force[part], usable[part], prediction[part])
            if self.settings.choose_basis:
                chosen = usable[part]
                self._record.add(stamp_ns[part][chosen], force[part][chosen])
            self._last_ns = int(stamp_ns[last - 1])
            first = last
        return prediction

    def estimate(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Fit all samples so far and return the estimate."""
        self._fit_all(scouting=True)
        return examined(self._build(stamp_ns, faults), self._problem, self._fit)

    def _make_room(self, span_ns: int) -> None:
        """Enlarge the ring buffer for the pending pulses and the blocks of a pause."""
        need = int(self._problem.blocks.size[0]) + len(self._delay_line.begin_ns)
        need += span_ns // 200_000_000 + 2
        if need > len(self._problem.blocks.start_ns):
            blocks = grown(self._problem.blocks, 2 * need)
            self._problem = self._problem._replace(blocks=blocks)

    def _reshape(self, knots: int) -> None:
        """Change the number of knots of the baseline."""
        theta, functions = self._fit.theta, self.settings.basis.functions
        self._fit = empty_fit(theta, functions, knots)
        self._trial = empty_fit(theta, functions, knots)
        baseline = BaselineKnots(knots, 0, 1)
        self._problem = self._problem._replace(baseline=baseline)

    def _place_knots(self) -> None:
        """Spread the baseline's knots evenly over the recording so far."""
        assert self._origin_ns is not None
        span = self._last_ns - self._origin_ns
        spacing = self.settings.knot_spacing * NANOSECONDS_PER_SECOND
        parts = max(round(span / spacing), 1) if span >= _SHORTEST_SLOPE_NS else 0
        if parts + 1 != self._problem.baseline.knots:
            self._reshape(parts + 1)
        baseline = BaselineKnots(parts + 1, self._origin_ns, -(-span // max(parts, 1)))
        self._problem = self._problem._replace(baseline=baseline)

    def _fit_all(self, scouting: bool) -> None:
        """Fit all samples; with `scouting`, try every start with a few steps first."""
        samples = int(self._intake.learnt[0])
        if self._origin_ns is None or samples == self._fitted_samples:
            return
        self._fitted_samples = samples
        if self.settings.baseline:
            self._place_knots()
        self._fit_basis(scouting)
        if self.settings.choose_basis and self._choose_basis():
            self._fit_basis(scouting)

    def _fit_basis(self, scouting: bool) -> None:
        """Fit all samples with the present basis."""
        fit = self._fit
        fit.variance[0] = 0.0
        fit_linear(self._problem, fit, True)
        improve(self._problem, fit, self._trial, _SCOUTING_STEPS, _SCOUTING_TOLERANCE)
        if scouting:
            self._scout(fit)
        for _ in range(_ROUNDS):
            fit_linear(self._problem, fit, True)
            improve(self._problem, fit, self._trial, _FINAL_STEPS, _FINAL_TOLERANCE)
        complete_equations(self._problem, fit)
        recompute_state(self._problem, self._intake, fit)

    def _choose_basis(self) -> bool:
        """Choose the basis that explains the recording best; return whether it has changed."""
        part = self._record.window(_CHOSEN_NS)
        if part is None or part.samples.stop - part.samples.start < _LEAST_SAMPLES:
            return False
        looked_at = part.samples.start, part.samples.stop
        if looked_at == self._looked_at:
            return False
        self._looked_at = looked_at
        search = BasisSearch(
            self._record,
            part,
            self.settings.basis,
            self._fit.theta,
            self._problem.prior,
            self.settings.knot_spacing,
        )
        first_ns, last_ns = self._record.span_ns(part)
        everywhere = self._searches < 1 + (last_ns - first_ns > _SEARCHED_AGAIN_NS)
        self._searches += everywhere
        place = search.best(self._place, everywhere)
        if place == self._place:
            return False
        self._place = place
        basis = basis_at(self.settings.basis, place)
        old = self._intake
        parts = self._record.parts()
        problem, intake, waiting = self._record.condensed(
            basis, self._problem.prior, self._problem.baseline, parts
        )
        self._problem = problem
        self._intake = old._replace(state=intake.state, fresh=intake.fresh)
        self._delay_line.restart(*self._record.newest_pulses(waiting), basis.latency)
        self._use(basis)
        return True

    def _use(self, basis: LaguerreBasis) -> None:
        """Use a basis from now on."""
        self._rate = 2.0 / basis.time_constant
        self._delay_line.latency(basis.latency)
        self._builder = EstimateBuilder(
            self.name, basis, self.rate_hz, self.settings.confidence, wide=True
        )

    def _scout(self, fit: Fit) -> None:
        """Try every start on the newest blocks; keep the best if it fits all blocks better."""
        problem = self._newest_blocks()
        best = self._trial_from(problem, fit, fit.theta)
        for theta in self.settings.starts():
            other = self._trial_from(problem, fit, theta)
            if other.cost[0] < best.cost[0]:
                best = other
        fit_linear(self._problem, best, False)
        improve(self._problem, best, self._trial, _SCOUTING_STEPS, _SCOUTING_TOLERANCE)
        if best.cost[0] < fit.cost[0]:
            fit.theta[:] = best.theta
            fit.damping[0] = best.damping[0]

    def _newest_blocks(self) -> Problem:
        """Return the problem of the newest blocks, led by those whose pulses still act on them."""
        blocks = self._problem.blocks
        size = int(blocks.size[0])
        order = (int(blocks.head[0]) + np.arange(size)) % len(blocks.start_ns)
        first = max(size - _SCOUTED_BLOCKS, 0)
        begin_ns = blocks.start_ns[order[first]] - nanoseconds(self.memory)
        # the clock may have jumped back
        earlier = np.flatnonzero(blocks.start_ns[order[:first]] < begin_ns)
        lead = int(earlier[-1]) if len(earlier) else 0
        newest = {
            name: values[order[lead:]]
            for name, values in blocks._asdict().items()
            if name not in ('head', 'size')
        }
        newest |= {'head': np.zeros_like(blocks.head), 'size': blocks.size - lead}
        return self._problem._replace(blocks=type(blocks)(**newest), first=first - lead)

    def _trial_from(self, problem: Problem, fit: Fit, theta: FloatArray) -> Fit:
        """Return a fit after a few steps from theta (4,), with the variance of `fit`."""
        other = empty_fit(theta, len(fit.linear), len(fit.levels))
        other.variance[0] = fit.variance[0]
        other.damping[0] = _START_DAMPING
        fit_linear(problem, other, False)
        improve(problem, other, self._trial, _SCOUTING_STEPS, _SCOUTING_TOLERANCE)
        return other


_PART_NS = 5_000_000_000
_LEAST_PART_SAMPLES = 200.0
# What a part's own muscle explains better, as a share of the force (root mean square).  A steady
# muscle with 0.5 % noise has 0.5 % at the most, a move of the coil 13 %.
_SHARE = 0.01
# The same as a multiple of the variance that noise alone would give, 11 in the mean.
_SIGNIFICANT = 100.0
_ROUNDING = 1e-9


def examined(estimate: Estimate, problem: Problem, fit: Fit) -> Estimate:
    """Return the estimate of a fit, with a doubt and its reason if the muscle changed.

    Parameters
    ----------
    estimate : Estimate
        Made of the fit.
    problem, fit : Problem, Fit
        Blocks of the recording, and their fit.
    """
    if not estimate.curve_known or is_constant(problem, fit):
        return estimate
    return replace(
        estimate,
        doubts=(*estimate.doubts, NO_CONSTANT_MUSCLE),
        reasons=(*estimate.reasons, REASON[NO_CONSTANT_MUSCLE]),
    )


def is_constant(problem: Problem, fit: Fit) -> bool:
    """Return whether no part of a recording asks for a muscle of its own.

    Parameters
    ----------
    problem, fit : Problem, Fit
        Blocks of the recording, and their fit.
    """
    return not any(
        share > _SHARE and gain > _SIGNIFICANT for share, gain in unexplained(problem, fit)
    )


def unexplained(problem: Problem, fit: Fit) -> FloatArray:
    """Return for each part what its own muscle would explain better.

    Parameters
    ----------
    problem, fit : Problem, Fit
        Blocks of the recording, and their fit.

    Returns
    -------
    ndarray (parts, 2)
        Root mean square as a share of that of the muscle's force; squared, as a multiple of the
        variance of what the part's own muscle leaves.  Empty if the clock has jumped back.
    """
    blocks = problem.blocks
    order = (int(blocks.head[0]) + np.arange(int(blocks.size[0]))) % len(blocks.start_ns)
    start_ns = blocks.start_ns[order]
    if not len(start_ns) or (np.diff(start_ns) < 0).any():
        return np.empty((0, 2))
    still = no_change(len(fit.linear))
    parts = condensed(problem, fit.theta, fit.linear, int(start_ns[0]), _PART_NS, still)
    found = [
        _gain(gram, right, energy, samples, fit.linear)
        for gram, right, energy, samples in zip(
            parts.gram, parts.right, parts.energy, parts.samples, strict=True
        )
        if samples > _LEAST_PART_SAMPLES
    ]
    return np.array(found).reshape(-1, 2)


def _gain(
    gram: FloatArray, right: FloatArray, energy: float, samples: float, linear: FloatArray
) -> tuple[float, float]:
    """Return what the own muscle of a part explains better; see `unexplained`.

    A baseline of its own comes first: a sensor that drifts is no other muscle.
    """
    joint = PARAMETERS + len(linear)
    muscle = np.zeros(joint + 2)
    muscle[PARAMETERS:joint] = linear
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
