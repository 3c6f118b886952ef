# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""On-line estimator of a muscle that changes: exact fits of a window, widths by evidence.

Samples of the last minute are kept in blocks of one pulse each.  Four times a second the present
muscle, its slow change and the disturbance are fitted to all of them together; the priors of the
speed of change and of the disturbance are chosen by the evidence (`window_fit`).  A sudden change
is found by its prediction errors, and the window restarts with the part of the muscle that did not
change (`changes`).  Latency and time constant of the basis are chosen by the samples
(`basis_choice`).
Steps are triggered by stamps alone, so the answer does not depend on how the data are cut.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.estimate import DEFAULT_RATE
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.faults import PULSES_TOO_FREQUENT
from rpms_ros.identification.laguerre import LaguerreBasis
from rpms_ros.identification.projection.data_intake import recompute_state
from rpms_ros.identification.projection.estimate_builder import EstimateBuilder
from rpms_ros.identification.projection.estimator import ProjectionEstimator
from rpms_ros.identification.projection.normal_equations import within_knots
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.projection.problem import BaselineKnots
from rpms_ros.identification.tracking.assembly import point_at
from rpms_ros.identification.tracking.basis_choice import LIVELY
from rpms_ros.identification.tracking.basis_choice import BasisChoice
from rpms_ros.identification.tracking.basis_choice import Explained
from rpms_ros.identification.tracking.basis_choice import conversion
from rpms_ros.identification.tracking.change_watch import Alert
from rpms_ros.identification.tracking.change_watch import ChangeWatch
from rpms_ros.identification.tracking.change_watch import first_block_after
from rpms_ros.identification.tracking.change_watch import origin_of
from rpms_ros.identification.tracking.changes import DYNAMICS
from rpms_ros.identification.tracking.changes import MUSCLE
from rpms_ros.identification.tracking.changes import Explanation
from rpms_ros.identification.tracking.changes import after
from rpms_ros.identification.tracking.changes import snapshot
from rpms_ros.identification.tracking.intervals import Origin
from rpms_ros.identification.tracking.intervals import no_change
from rpms_ros.identification.tracking.knowledge import Knowledge
from rpms_ros.identification.tracking.knowledge import coordinates
from rpms_ros.identification.tracking.knowledge import informed
from rpms_ros.identification.tracking.knowledge import knowledge_of
from rpms_ros.identification.tracking.knowledge import scaled_inverse
from rpms_ros.identification.tracking.raw_samples import RawSamples
from rpms_ros.identification.tracking.report import described_fit
from rpms_ros.identification.tracking.settings import LONGEST_BASIS
from rpms_ros.identification.tracking.settings import TrackingSettings
from rpms_ros.identification.tracking.tremor import SEARCHED_NS
from rpms_ros.identification.tracking.tremor import Tremor
from rpms_ros.identification.tracking.window_fit import Scales
from rpms_ros.identification.tracking.window_fit import Window
from rpms_ros.identification.tracking.window_fit import WindowFit
from rpms_ros.identification.tracking.window_fit import explained
from rpms_ros.identification.tracking.window_fit import fresh_fit
from rpms_ros.identification.tracking.window_fit import improved
from rpms_ros.identification.warm_start import DayToDay
from rpms_ros.identification.warm_start import Knowledge as KnownMuscle
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

# Pulses up to this rate fit into the window [Hz]; at a higher one it is shorter.
_HIGHEST_RATE = 120.0
_SPARE_BLOCKS = 128
_BLOCKS_OF_PAUSES = 4
INTERVAL_NS = 125_000_000
# Distance of two knots of the slow change, in intervals.
_KNOT_INTERVALS = 40
_KNOT_S = _KNOT_INTERVALS * INTERVAL_NS / NANOSECONDS_PER_SECOND
# The window ends where the muscle was so different that what it was then says little of now, and
# seven functions no longer hold the stretched response.
_LARGEST_GAIN = 0.25
_LARGEST_SLOWING = 0.25
_SHORTEST_S = 20.0
# That of the slowest muscle.
_LONGEST_LAG_S = 0.3
_STEPS, _FIRST_STEPS = 2, 6
_RECENT_PULSES, _MOST_RATES = 100, 3
_DOUBTED_NS = 10 * NANOSECONDS_PER_SECOND
_CHALLENGED_NS = 30 * NANOSECONDS_PER_SECOND
# A window that is not quite young is challenged once in so many steps.
_RESTS, _OFTEN_NS = 4, 5 * NANOSECONDS_PER_SECOND
_CHALLENGER_STEPS = 5
_CHALLENGER_DECISION = 3.0
_SETTLING_NS = NANOSECONDS_PER_SECOND // 2
_YOUNG_NS = 10 * NANOSECONDS_PER_SECOND
# When the basis is compared with others, since a response shows; later with this period [s].
_CHOICES_S = (1.0, 3.0, 7.0, 16.0, 32.0)
_CHOICE_PERIOD_S = 32.0
# Where all seems well it is compared with its neighbours only, but so often with all that people
# have.  Neighbouring residuals of a basis that fits are seldom alike: then it is compared sooner.
_GRIDS, _ALIKE = 4, 1.3
_AGAIN_NS = 3 * NANOSECONDS_PER_SECOND
_CHOICE_NS = 16 * NANOSECONDS_PER_SECOND
# After the first pulse, if no response shows.
_UNSEEN_NS = 2 * NANOSECONDS_PER_SECOND


class TrackingEstimator(ProjectionEstimator):
    """Estimator of a muscle that changes.

    Parameters
    ----------
    settings : TrackingSettings or None
        Model and numerics.
    rate_hz : float
        Rate for which the recruitment curve is stated [Hz].

    Raises
    ------
    IdentificationError
        If the rate is not above zero.
    """

    name = 'tracking'

    _basis: LaguerreBasis
    _last_ns: int | None
    _begun_ns: int | None
    _stimulated_ns: int | None
    _choices: int
    _compared_ns: int
    _turn: int
    _from_before: bool
    _knowledge: Knowledge
    _window: WindowFit
    _origin: Origin
    _watch: ChangeWatch
    _raw: RawSamples
    _tremor: Tremor

    def __init__(
        self,
        settings: TrackingSettings | None = None,
        rate_hz: float = DEFAULT_RATE,
    ) -> None:
        settings = settings if settings is not None else TrackingSettings()
        seconds = settings.horizon + LONGEST_BASIS.duration
        self._choose, self._find = settings.choose_basis, settings.find_changes
        self._capacity = int(seconds * _HIGHEST_RATE) + _SPARE_BLOCKS
        super().__init__(settings, rate_hz, self._capacity, 2)
        self._step_ns = round(settings.step_period * NANOSECONDS_PER_SECOND)
        functions = settings.basis.functions
        self._basis = settings.basis
        self._last_ns = None
        self._begun_ns = None
        self._stimulated_ns = None
        self._choices = 0
        self._compared_ns = -(2**62)
        self._turn = 0
        self._from_before = False
        self._starts = settings.starts()
        self._prior = knowledge_of(settings)
        self._knowledge = self._prior
        self._window = fresh_fit(np.array(settings.start), functions)
        self._origin = no_change(functions)
        self._watch = ChangeWatch()
        self._raw = RawSamples()
        self._tremor = Tremor()
        self._use(settings.basis)

    @property
    def memory(self) -> float:
        """Longest time for which a pulse may act on the model's output [s]."""
        return LONGEST_BASIS.duration

    def restore(self, state: Mapping[str, Any]) -> None:
        """Remember what was saved; see `Restorable.restore`."""
        super().restore(state)
        self._use(self._basis)

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending, none before one that was already added [ns, 1]."""
        super().add_pulses(onset_ns, intensity)
        if len(onset_ns):
            weight = self._delay_line.weight[-len(onset_ns) :]
            self._raw.add_pulses(onset_ns, intensity, weight)
            if self._stimulated_ns is None and intensity.any():
                self._stimulated_ns = int(onset_ns[np.argmax(intensity > 0.0)])

    def update(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        """Learn from samples (samples,), ascending; return their a-priori prediction [N].

        See `rpms_ros.identification.estimate.Estimator.update`.
        """
        prediction = np.empty(len(stamp_ns))
        if not len(stamp_ns):
            return prediction
        period = stamp_ns // self._step_ns
        starts = np.flatnonzero(np.diff(period)) + 1
        for first, last in zip((0, *starts), (*starts, len(stamp_ns)), strict=True):
            if self._last_ns is not None and period[first] != self._last_ns // self._step_ns:
                self._step()
            part = slice(first, last)
            self._make_room(int(stamp_ns[first]), int(stamp_ns[last - 1]))
            tremor = self._tremor.force(stamp_ns[part])
            rest = force[part] - tremor
            self._take(stamp_ns[part], rest, usable[part], prediction[part])
            self._raw.add(stamp_ns[part], force[part], tremor, usable[part])
            muscle = prediction[part] - self._disturbance(stamp_ns[part])
            self._tremor.add(stamp_ns[part], force[part], muscle, usable[part])
            prediction[part] += tremor
            self._last_ns = int(stamp_ns[last - 1])
        return prediction

    def predict(self, stamp_ns: IntArray) -> FloatArray:
        """Return what is expected of samples (samples,) that come next [N]."""
        return super().predict(stamp_ns) + self._tremor.force(stamp_ns)

    def forget_pulses(self) -> None:
        """Drop the pulses that still act; the knowledge of the muscle is kept."""
        super().forget_pulses()
        self._begin_anew()
        self._begun_ns = self._stimulated_ns = None
        self._compared_ns = -(2**62)
        self._tremor.forget()
        self._last_ns = None

    def start_from(self, known: KnownMuscle) -> None:
        """Use the result of an earlier session, and its basis, as prior.

        Raises
        ------
        IdentificationError
            If there have been data.
        """
        if self._last_ns is not None or self._pulses:
            raise IdentificationError('expected a fresh estimator to start from what is known')
        basis = replace(known.basis, functions=self.settings.basis.functions)
        if not self._choose:
            basis = self.settings.basis
        known = known.on(basis)
        prior = self._problem.prior
        theta = np.clip(known.theta, prior.lower, prior.upper)
        self._prior.part(theta)
        self._use(basis)
        self._problem = self._problem._replace(input_gain=basis.input_gain)
        self._window.point = point_at(theta, known.linear, 0)
        self._knowledge = replace(
            self._prior,
            information=scaled_inverse(known.widened(DayToDay())),
            reference=np.concatenate((coordinates(theta), known.linear)),
        )
        self._from_before = True

    def tell_change(self, kind: str) -> None:
        """Tell the estimator that the muscle has changed after the newest sample.

        Parameters
        ----------
        kind : str
            `gain`, `thresholds` (the coil was moved) or `dynamics`.

        Raises
        ------
        IdentificationError
            If there is no such kind, or the muscle is not known yet.
        """
        if kind not in MUSCLE:
            raise IdentificationError(f'expected a change of {", ".join(MUSCLE)}, got {kind!r}')
        if self._last_ns is None or not self._window.shows_response:
            raise IdentificationError('expected a known muscle before it changes, got none')
        before = snapshot(self._window, self._last_ns)
        self._watch.forget()
        self._knowledge = after(before, kind, self._prior, 0.0)
        self._origin = origin_of(before)
        size = int(self._problem.blocks.size[0])
        self._problem = self._problem._replace(first=size)

    def estimate(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Return the present estimate."""
        return described_fit(
            self._build(stamp_ns, faults),
            self._window,
            self._watch.found,
            self._watch.count,
            self._watch.deliberating,
            _KNOT_S,
            INTERVAL_NS * 1e-9,
            self._basis.area,
            self._tremor,
        )

    def _build(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Return the estimate of the window's fit."""
        return self._builder.stated(
            stamp_ns,
            self._fit,
            self._window.uncertainty(self._prior.deviation, self.settings.confidence),
            self._prior.deviation,
            self._counters(),
            self._with_own(faults),
        )

    def _step(self) -> None:
        """Fit the window."""
        if self._intake.learnt[0] == 0.0:
            return
        if self._begun_ns is None and self._window.shows_response:
            self._begun_ns, self._choices = self._last_ns, 0
        self._slide()
        self._follow_tremor()
        if not self._holds_samples():
            return
        basis = self._basis
        self._choose_basis()
        window = self._span()
        self._look_for_change(window)
        if not self._watch.deliberating:
            young = window.now_ns - window.first_ns < _YOUNG_NS
            steps = _FIRST_STEPS if young or basis != self._basis else _STEPS
            self._challenge(self._span())
            improved(self._problem, self._window, self._knowledge, self._span(), steps)
            self._doubt_what_is_from_before(self._span())
            if self._find:
                self._watch.remember(snapshot(self._window, window.now_ns))
        self._predict_by_window()

    def _rates(self) -> FloatArray:
        """Return the rates of the newest pulses (rates,) [Hz], none if they are many."""
        blocks = self._problem.blocks
        order = (int(blocks.head[0]) + np.arange(int(blocks.size[0]))) % len(blocks.start_ns)
        recent = blocks.start_ns[order][blocks.intensity[order] > 0.0][-_RECENT_PULSES:]
        intervals = 1e-9 * np.diff(recent)
        rates = np.unique(np.round(1.0 / intervals[intervals > 1e-3], 1))
        return rates if len(rates) <= _MOST_RATES else rates[:0]

    def _follow_tremor(self) -> None:
        """Follow a tremor, or look whether what may be one explains the samples."""
        if not self._tremor.follow(self._rates()):
            return
        if self._begun_ns is None:
            # nothing is known that would be lost
            self._watch.forget()
            size = int(self._problem.blocks.size[0])
            self._problem = self._problem._replace(first=size)
            self._begin_without_tremor()
            return
        self._tremor.reject()
        span = self._span()
        if span.now_ns - span.first_ns < SEARCHED_NS:
            # what an earlier muscle leaves may look like one
            return
        explained = self._choice().explained(self._basis)
        if explained.tremor:
            self._take_up(explained, self._basis)

    def _take_up(self, explained: Explained, basis: LaguerreBasis) -> None:
        """Go on with a basis as it explains the newest samples."""
        found, fit = explained.fit, self._window
        if explained.tremor:
            point, prior = found.point, self._problem.prior
            rest = explained.raw.rest(basis, point.theta, point.linear, prior)
            self._raw = explained.raw
            self._tremor.accept(explained.tremor, *rest)
            self._begun_ns, self._choices = self._last_ns, 0
        first_ns = self._span().first_ns
        if explained.tremor or basis != self._basis:
            self._change_basis(basis)
        if not explained.tremor and first_ns < self._compared_from():
            # of the earlier disturbance the fit of the newest samples says nothing
            fit.point = fit.point._replace(theta=found.point.theta, linear=found.point.linear)
            if fit.together > _ALIKE:
                fit.scales, fit.variance, fit.together = found.scales, found.variance, 1.0
            return
        fit.point = found.point
        fit.scales, fit.variance, fit.together = found.scales, found.variance, found.together
        fit.levels, fit.first = found.levels, found.first

    def _begin_without_tremor(self) -> None:
        """Forget the widths that were found: they are those of the tremor."""
        fit = self._window
        fit.point = point_at(fit.point.theta, fit.point.linear, 0)
        fit.scales, fit.variance = Scales(), 0.0
        fit.levels = np.full(2, float(np.median(fit.levels)))
        self._begun_ns, self._choices = self._last_ns, 0

    def _doubt_what_is_from_before(self, window: Window) -> None:
        """Give up what another session, or a change, has left where the samples contradict it."""
        if not self._from_before:
            return
        self._from_before = window.now_ns - window.first_ns < _DOUBTED_NS
        alone = fresh_fit(self._window.point.theta, self._basis.functions)
        improved(self._problem, alone, self._prior, window, _FIRST_STEPS)
        if self._knowledge.contradicted(self._window, alone):
            self._from_before = False
            self._knowledge = self._prior
            self._window = alone
            self._watch.forget()

    def _challenge(self, window: Window) -> None:
        """While the window is young try another start, in turn; go on from there if it is better.

        A fit that has begun with few samples may hang in a local minimum.
        """
        fit = self._window
        length_ns = window.now_ns - window.first_ns
        if length_ns > _CHALLENGED_NS or not fit.shows_response:
            return
        self._turn = (self._turn + 1) % (_RESTS * len(self._starts))
        if length_ns > _OFTEN_NS and self._turn % _RESTS:
            return
        functions = self._basis.functions
        other = fresh_fit(self._starts[self._turn // _RESTS], functions)
        other.variance, other.together = fit.variance, fit.together
        mine = replace(fit)
        problem, knowledge = self._problem, self._knowledge
        if not explained(problem, other, knowledge, window, _CHALLENGER_STEPS):
            return
        if explained(problem, mine, knowledge, window, 1) and (
            other.evidence > mine.evidence + _CHALLENGER_DECISION
        ):
            fit.point, fit.scales, fit.levels = other.point, other.scales, other.levels
            fit.first = other.first

    def _look_for_change(self, window: Window) -> None:
        """Search for a change of the muscle; restart the window after it."""
        if not self._find:
            return
        intake = self._intake
        samples = float(intake.recent[0])
        alert = Alert(
            float(intake.error_energy[0]) / max(samples, 1.0),
            float(intake.force_energy[0]) / max(samples, 1.0),
            samples,
        )
        change = self._watch.look(self._problem, window, self._window, self._prior, alert)
        if change is not None:
            self._begin_after(change)

    def _begin_after(self, change: Explanation) -> None:
        """Restart the window after a change."""
        self._window = replace(change.fit)
        self._knowledge = change.knowledge
        # if it is of another kind than it seems, what it leaves alone is wrong
        self._from_before = True
        self._origin = origin_of(change.before)
        # The force of earlier pulses gets the new dynamics too: it has to decay first.
        settling = _SETTLING_NS if change.kind == DYNAMICS else 0
        first = first_block_after(self._problem, change.before.stamp_ns + settling)
        first = min(first, int(self._problem.blocks.size[0]) - 2)
        self._problem = self._problem._replace(first=first)

    def _holds_samples(self) -> bool:
        """Return whether the window holds enough blocks to be fitted."""
        return int(self._problem.blocks.size[0]) - self._problem.first >= 2

    def _span(self) -> Window:
        """Return the present window."""
        assert self._last_ns is not None
        blocks = self._problem.blocks
        begin = (int(blocks.head[0]) + self._problem.first) % len(blocks.start_ns)
        first_ns = int(blocks.start_ns[begin])
        # without a known response there is no slow change
        known = self._begun_ns is not None
        knots = int((self._last_ns - first_ns) / INTERVAL_NS / _KNOT_INTERVALS + 0.5) * known
        return Window(
            first_ns,
            self._last_ns,
            INTERVAL_NS,
            float(_KNOT_INTERVALS),
            knots,
            self._lag(),
            self._origin,
        )

    def _lag(self) -> float:
        """Return how long after its pulse the force acts in the mean, in intervals."""
        linear = self._window.point.linear
        area = float(self._basis.area @ linear)
        seconds = float(self._basis.moment @ linear) / area if area > 0.0 else 0.0
        return min(max(seconds, 0.0), _LONGEST_LAG_S) * NANOSECONDS_PER_SECOND / INTERVAL_NS

    def _disturbance(self, stamp_ns: IntArray) -> FloatArray:
        """Return the disturbance (samples,) [N] in the prediction."""
        baseline, levels = self._problem.baseline, self._fit.levels
        position = (stamp_ns - baseline.origin_ns) / baseline.spacing_ns
        share = np.clip(position, within_knots(-np.inf, baseline), within_knots(np.inf, baseline))
        disturbance: FloatArray = (1.0 - share) * levels[0] + share * levels[1]
        return disturbance

    def _predict_by_window(self) -> None:
        """Use the fit of the window for the predictions of the intake."""
        window, fit = self._window, self._fit
        fit.theta[:] = window.point.theta
        fit.linear[:] = window.point.linear
        fit.levels[:] = window.levels[-2:]
        fit.failures[0] = window.failures
        fit.moved[0] = float(np.abs(window.moved).max())
        origin = (window.first + len(window.levels) - 2) * INTERVAL_NS
        self._problem = self._problem._replace(baseline=BaselineKnots(2, origin, INTERVAL_NS))
        recompute_state(self._problem, self._intake, fit)

    def _slide(self) -> None:
        """Drop blocks before the window, except those that advance its first state."""
        assert self._last_ns is not None
        blocks = self._problem.blocks
        capacity = len(blocks.start_ns)
        head, size = int(blocks.head[0]), int(blocks.size[0])
        start_ns = blocks.start_ns[(head + np.arange(size)) % capacity]
        surplus = size - (capacity - _SPARE_BLOCKS)
        oldest = self._last_ns - self._length_ns()
        first = max(int(np.searchsorted(start_ns, oldest)), self._problem.first, surplus)
        first = max(min(first, size), 0)
        if first == size:
            return
        memory_ns = round(self._basis.duration * NANOSECONDS_PER_SECOND)
        dropped = int(np.searchsorted(start_ns, int(start_ns[first]) - memory_ns))
        dropped = max(min(max(dropped, surplus), first), 0)
        if dropped:
            blocks.head[0] = (head + dropped) % capacity
            blocks.size[0] -= dropped
        self._problem = self._problem._replace(first=first - dropped)
        self._raw.drop(int(start_ns[first]) - round(self.memory * NANOSECONDS_PER_SECOND))

    def _length_ns(self) -> int:
        """Return the length of the window [ns], shorter for a muscle that changes fast."""
        point = self._window.point
        large = (np.abs(point.gain) > _LARGEST_GAIN) | (np.abs(point.slowing) > _LARGEST_SLOWING)
        longest = self.settings.horizon
        seconds = _KNOT_S * int(np.argmax(large)) if large.any() else longest
        return round(min(max(seconds, _SHORTEST_S), longest) * NANOSECONDS_PER_SECOND)

    def _make_room(self, first_ns: int, last_ns: int) -> None:
        """Make room for the blocks up to `last_ns`.

        Pulses that began long before the first sample, in an outage of the force, no longer act.
        """
        pending = self._delay_line
        memory_ns = round(2.0 * self.memory * NANOSECONDS_PER_SECOND)
        pending.drop(pending.begin_until(first_ns - memory_ns))
        capacity = len(self._problem.blocks.start_ns)
        coming = pending.begin_until(last_ns)
        most = capacity - _BLOCKS_OF_PAUSES
        if coming > most:
            self._faults.add(PULSES_TOO_FREQUENT, coming - most)
            pending.drop(coming - most)
            coming = most
        lacking = int(self._problem.blocks.size[0]) + coming + _BLOCKS_OF_PAUSES - capacity
        if lacking > 0:
            self._begin_anew()

    def _begin_anew(self) -> None:
        """Begin with an empty window and the knowledge of the muscle."""
        if self._window.variance > 0.0:
            self._knowledge = informed(self._prior, self._window)
        self._problem.blocks.size[0] = 0
        self._problem = self._problem._replace(first=0)
        self._intake.fresh[0] = 1.0
        self._origin = no_change(self._basis.functions)
        self._window.levels = self._window.levels[-2:].copy()
        self._watch.forget()
        self._raw.forget()

    def _choose_basis(self) -> None:
        """Compare the basis with others when it is time to."""
        if not self._choose or self._watch.deliberating:
            return
        since_ns = self._begun_ns
        if since_ns is None and self._stimulated_ns is not None:
            # with a basis that does not fit a response may not show
            since_ns = self._stimulated_ns + _UNSEEN_NS
        if since_ns is None:
            return
        assert self._last_ns is not None
        seconds = (self._last_ns - since_ns) / NANOSECONDS_PER_SECOND
        done = self._choices
        due = _CHOICES_S[done] if done < len(_CHOICES_S) else _CHOICE_PERIOD_S * (done - 3)
        alike = self._window.together > _ALIKE
        if seconds >= due:
            self._choices += 1
        elif not alike or self._last_ns < self._compared_ns + _AGAIN_NS:
            return
        self._compared_ns = self._last_ns
        if self._tremor.frequency:
            # the muscle is known better than it was
            point, prior = self._window.point, self._problem.prior
            rest = self._raw.rest(self._basis, point.theta, point.linear, prior)[-1]
            self._raw = self._raw.without(self._tremor.frequency, rest)
            self._change_basis(self._basis)
        choice = self._choice()
        fit = self._window
        found = choice.better(done < _GRIDS or alike)
        explained = choice.explained(found)
        quieter = explained.fit.scales.disturbance < LIVELY <= fit.scales.disturbance
        freed = explained.fit.together < _ALIKE < fit.together
        if found != self._basis or explained.tremor or quieter or freed:
            self._take_up(explained, found)

    def _compared_from(self) -> int:
        """Return the first sample to which bases are fitted [ns]."""
        assert self._last_ns is not None
        return max(self._span().first_ns, self._last_ns - _CHOICE_NS)

    def _choice(self) -> BasisChoice:
        """Return the choice of a basis for the newest samples."""
        assert self._last_ns is not None
        return BasisChoice(
            self._raw,
            self._basis,
            self._window,
            self._prior,
            self._problem.prior,
            self._compared_from(),
            self._last_ns,
            INTERVAL_NS,
            float(_KNOT_INTERVALS),
            self._lag(),
            self._origin,
            None if self._tremor.frequency else self._rates(),
        )

    def _change_basis(self, basis: LaguerreBasis) -> None:
        """Put the samples of the window into blocks of another basis."""
        matrix = conversion(self._basis, basis)
        fit = self._window
        linear = matrix @ fit.point.linear
        first_ns = self._span().first_ns
        problem, intake, pending = self._raw.condensed(
            basis, fit.point.theta, linear, first_ns, self._problem.prior, self._capacity
        )
        self._problem = problem._replace(baseline=self._problem.baseline)
        for name in ('error_energy', 'force_energy', 'recent', 'learnt', 'previous_ns'):
            getattr(intake, name)[:] = getattr(self._intake, name)
        self._intake = intake
        self._delay_line.restart(*self._raw.newest_pulses(pending), basis.latency)
        both = np.eye(PARAMETERS + basis.functions)
        both[PARAMETERS:, PARAMETERS:] = matrix
        self._knowledge = self._knowledge.converted(both, float(np.linalg.norm(linear)))
        self._window.point = fit.point._replace(linear=linear)
        self._origin = self._origin._replace(linear=matrix @ self._origin.linear)
        self._watch.forget()
        self._use(basis)

    def _use(self, basis: LaguerreBasis) -> None:
        """Use a basis from now on."""
        self._basis = basis
        self._rate = 2.0 / basis.time_constant
        self._delay_line.latency(basis.latency)
        self._builder = EstimateBuilder(
            self.name, basis, self.rate_hz, self.settings.confidence, wide=True
        )
