# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""On-line estimator of a muscle that changes: exact fits of a window, widths by evidence.

Samples of the last minute are kept in blocks of one pulse each.  Four times a second the present
muscle, its slow change and the disturbance are fitted to all of them together; the priors of the
speed of change and of the disturbance are chosen by the evidence (`window_fit`).  A sudden change
is found by its prediction errors, and the window restarts with the part of the muscle that did not
change (`change_detection`).  Latency and time constant of the basis are chosen by the samples
(`basis_choice`).  Steps are triggered by stamps alone, so the answer does not depend on how the
data are cut.
"""

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag
from scipy.special import ndtri

from rpms_ros.errors import IdentificationError, check_number
from rpms_ros.identification.estimation.basis_choice import (
    LIVELY,
    BasisChoice,
    BasisFit,
    BasisSchedule,
)
from rpms_ros.identification.estimation.blocks import ring_order
from rpms_ros.identification.estimation.change_detection import (
    DYNAMICS,
    ChangeWatch,
    Explanation,
    Present,
    first_block_after,
    origin_of,
)
from rpms_ros.identification.estimation.estimator import ProjectionEstimator
from rpms_ros.identification.estimation.normal_equations import near_knots
from rpms_ros.identification.estimation.prior import (
    DayToDay,
    FittedMuscle,
    WindowPrior,
    posterior_as_prior,
    scaled_inverse,
)
from rpms_ros.identification.estimation.settings import Problem, ProjectionSettings
from rpms_ros.identification.estimation.tremor import SEARCHED_NS, Tremor, repetition_rates
from rpms_ros.identification.estimation.window_equations import (
    MOVING,
    Point,
    no_change,
    steady,
    time_scale_derivative,
    time_scaled,
)
from rpms_ros.identification.estimation.window_fit import (
    INTERVAL_NS,
    KNOT_INTERVALS,
    Linearised,
    Scales,
    Window,
    WindowFit,
    fresh_fit,
    gain_swing,
    gauss_newton_steps,
    short_events,
    steps_at_fixed_scales,
)
from rpms_ros.identification.model.basis import LaguerreBasis, conversion
from rpms_ros.identification.model.estimate import DEFAULT_RATE, Estimate
from rpms_ros.identification.model.recruitment import (
    PARAMETERS,
    SUMMATION,
    coordinates,
    from_coordinates,
    recruitment_curve,
)
from rpms_ros.identification.quality.doubts import (
    BAND_WIDER_THAN_CURVE,
    CURVE_NEGATIVE,
    DISTURBANCE_FOLLOWS,
    DISTURBANCE_LIVELY,
    NEGATIVE,
    NOT_ISOMETRIC,
    PULSES_TOO_FREQUENT,
    RESIDUALS_ALIKE,
    RESPONSE_NEGATIVE,
    band_wider_than_curve,
    doubted,
)
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray

RATE_NAMES = ('force_percent', 'time_constant_percent', 'u_thr', 'u_sat')
_MINUTE = 60.0
# A muscle does not tire evenly between two knots: deviation of a rate as a share of it, so that
# nineteen of twenty intervals hold the mean rate of the last knot (bench/rates.py).
_UNEVEN = 0.06
# The disturbance counts as lively above this share of the force, by `LIVELINESS`.
_LIVELY = 6
_WIDE = 0.05
# From this share of the force on it is said that estimates were wrong.
_WRONG = 0.005
# The gain follows the disturbance by this share: bench/league.py, `length`, has 5 to 8 %, a held
# muscle 0.4 %.
_SWING = 0.03
# The disturbance counts as following the intensity if its course in the last 1.5 s, smoothed over
# so many intervals and as many apart, explains this share of its variance, and moves it by this
# share of the force at full intensity; in less than twenty seconds any course does.  Of a little,
# as of a strap that gives way, it has to explain nearly all.
_SMOOTHED, _LAGS, _LEAST_COMPARED, _EXPLAINED, _FOLLOWED = 2, 6, 160, 0.5, 0.02
_NEARLY_ALL, _LITTLE = 0.8, 1e-3
# It is lively where it moves by this share of that force in an interval, in the median: a heart of
# 2 % and a breath of 3 % do by 1 %, efforts now and then do not.
_LIVELY_SHARE = 5e-3


def follows_intensity(problem: Problem, fit: WindowFit, full: float) -> float:
    """Return by which share of a force `full` [N] the disturbance runs with the intensity.

    An effort that does so, as under a slow sinusoid, cannot be told from recruitment: as much may
    be in the curve.  0 where it does not, or by too little.
    """
    blocks, levels, count = problem.blocks, fit.levels, len(fit.levels)
    order = ring_order(blocks)[problem.first :]
    if count < _LEAST_COMPARED:
        return 0.0
    place = blocks.start_ns[order] / INTERVAL_NS - fit.first
    at = np.arange(count)
    columns, lags = [np.ones(count), at], range(0, _SMOOTHED * (_LAGS + 1), _SMOOTHED)
    given, theta = blocks.intensity[order], fit.point.theta[: SUMMATION.start]
    # a curve that is too high by what follows each pulse, however strong, shows in their number
    for drive in (np.sign(given), given, recruitment_curve(given, theta)[0]):
        # each lasts until the next one: counted whole, pulses would beat with the intervals
        before = [np.interp(at - lag, place, np.cumsum(drive) - drive) for lag in lags]
        columns += [late - early for late, early in pairwise(before)]
    matrix = np.column_stack(columns)
    part = matrix @ np.linalg.lstsq(matrix, levels, rcond=None)[0]
    straight = np.polynomial.Polynomial.fit(at, levels, 1)(at)
    explained = 1.0 - np.var(levels - part) / max(float(np.var(levels - straight)), 1e-300)
    share = float(np.ptp(part - straight)) / max(full, 1e-100)
    least = _EXPLAINED if share > _FOLLOWED else _NEARLY_ALL
    return share if explained > least and share > _LITTLE else 0.0


def liveliness(levels: FloatArray, full: float) -> float:
    """Return by which share of a force `full` [N] the disturbance (intervals,) moves all the time.

    0 where it is less than `_LIVELY_SHARE`, or too little is known of it.
    """
    if len(levels) <= _LEAST_COMPARED // 4:
        return 0.0
    share = float(np.median(np.abs(np.diff(levels)))) / max(full, 1e-100)
    return share if share > _LIVELY_SHARE else 0.0


def _rates(fit: WindowFit, area: FloatArray) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Return names, rates a minute and their standard deviations; nothing without a past."""
    knots = len(fit.point.gain)
    if not knots:
        return (), np.empty(0), np.empty(0)
    a_minute = _MINUTE * NANOSECONDS_PER_SECOND / INTERVAL_NS
    base = len(fit.point.theta) + len(fit.point.linear)
    # a slower twitch of the same height has a larger area, and so a larger steady force
    steady = float(area @ fit.point.linear)
    by_slowing = float(area @ time_scale_derivative(fit.point.linear)) / steady if steady else 0.0
    # the parameters are past minus present: a force that was larger has fallen
    scale = 100.0 * a_minute / float(fit.point.times[0] - fit.point.times[1])
    matrix = np.zeros((len(RATE_NAMES), len(fit.covariance)))
    matrix[0, base], matrix[0, base + knots] = -scale, -scale * by_slowing
    matrix[1, base + knots] = -scale
    matrix[2, base + 2 * knots] = matrix[3, base + 3 * knots] = -0.01 * scale
    changed = np.concatenate((np.zeros(base), fit.point.changes.ravel()))
    variance = np.einsum('ij,jk,ik->i', matrix, fit.covariance, matrix)
    rate = matrix @ changed
    variance[:2] += np.square(_UNEVEN * rate[:2])
    return RATE_NAMES, rate, np.sqrt(np.maximum(variance, 0.0))


def _force_at(point: Point, time: float, area: FloatArray) -> FloatArray:
    """Return the steady force at `_SAID_OF`, for pulses of 1 Hz, at a time in intervals [N s]."""
    past, theta = point.at_times(np.array([point.times[0], time])), point.theta.copy()
    theta[:MOVING] += past.thresholds[:, 0]
    linear = (1.0 + past.gain[0]) * time_scaled(point.linear, float(past.slowing[0]))
    return float(area @ linear) * recruitment_curve(_SAID_OF, theta[: SUMMATION.start])[0]


def _reasons(
    estimate: Estimate, fit: WindowFit, deliberating: bool, tremor: Tremor, hindsight: float
) -> Iterator[str]:
    """Yield why intervals are wide or samples are not learnt from, as sentences.

    `hindsight` is by how much the last steady forces were wrong, as a share of the largest.
    """
    if deliberating:
        yield 'the newest samples do not fit the muscle; looking for what has changed'
    if tremor.frequency:
        # without a unit: an estimator is not told whether it is a force or a torque
        yield (
            f'a tremor of {tremor.frequency:.1f} Hz with an amplitude of '
            f'{tremor.amplitude:.2g} is taken off'
        )
    if fit.scales.lively > _LIVELY:
        yield 'a lively disturbance cannot be told from the muscle everywhere'
    if estimate.curve_known and len(estimate.curve_upper):
        width = float(np.max(estimate.curve_upper - estimate.curve_lower))
        if width > 2.0 * _WIDE * float(np.max(np.abs(estimate.curve_force))):
            yield 'the pulses so far do not tell the recruitment curve'
    if hindsight > _WRONG:
        yield 'the last estimates were wrong by more than their intervals'


# What was said once in each of so many seconds is held against what is known of that time now; so
# many of these comparisons count.
_SAID, _MOMENTS, _SAID_OF = 5, 9, np.linspace(0.3, 1.0, 8)
_CHALLENGED_NS = 30 * NANOSECONDS_PER_SECOND
# Samples that tell the colour of the noise.
_COLOUR_NS = 4 * NANOSECONDS_PER_SECOND
# A window that is not quite young is challenged once in so many steps.
_RESTS, _OFTEN_NS = 4, 5 * NANOSECONDS_PER_SECOND
_TRIAL_STEPS = 5
# From this place in `SIZES` on the arctangents may be where the curve is not, and the deviation
# makes up for it: they are tried elsewhere with less of it.
_FAR_FROM_ARCTANGENTS = 5
# The other has to be better by so much [nat].
_DECISION = 3.0


def knots_of_change(
    acting_ns: IntArray, first_ns: int, now_ns: int, lag: float
) -> tuple[FloatArray, tuple[bool, ...]]:
    """Return the knots of a slow change and which of their distances are pauses, see `Window`.

    They are `KNOT_INTERVALS` apart, counted from now, and at the ends of pauses.

    Parameters
    ----------
    acting_ns : ndarray of int64 (pulses,)
        When pulses began to act, ascending [ns].
    first_ns, now_ns : int
        The window [ns].
    lag : float
        How long after its pulse the force acts in the mean, in intervals.
    """
    inside = acting_ns[(acting_ns >= first_ns) & (acting_ns < now_ns)]
    times = np.concatenate(([first_ns], inside, [now_ns]))
    gaps = np.diff(times)
    longest = max(_PAUSE_NS, _PAUSE_INTERVALS * float(np.median(gaps)))
    pauses = np.flatnonzero(gaps > longest)
    ends = np.concatenate(
        ([first_ns], times[np.column_stack((pauses, pauses + 1)).ravel()], [now_ns])
    )
    knots, paused = [now_ns / INTERVAL_NS], []
    for place in range(len(ends) - 1, 0, -1):
        newer, older = ends[place] / INTERVAL_NS, ends[place - 1] / INTERVAL_NS
        pause = place % 2 == 0
        count = 1 if pause else int((newer - older) / KNOT_INTERVALS + 0.5)
        if len(pauses) and newer > older:
            count = max(count, 1)
        elif newer == older:
            continue
        knots += [newer - KNOT_INTERVALS * (1 + index) for index in range(count)]
        paused += [pause] * count
        if len(pauses):
            knots[-1] = older
    if paused and paused[-1]:
        # nothing is known from before the pause
        del knots[-1], paused[-1]
    return np.array(knots) + lag, tuple(paused)


# Slowest twitch and longest latency of the bases that are tried.
_LONGEST_BASIS = LaguerreBasis(7, 90e-3, 30e-3)


@dataclass(frozen=True)
class TrackingSettings(ProjectionSettings):
    """Model and numerics of the tracking estimator.

    `basis` and `start` are the first ones.

    Attributes
    ----------
    window : float
        Longest window [s].
    step_period : float
        Time between two steps, by the stamps [s].
    choose_basis : bool
        Choose latency and time constant of the basis by the samples.
    find_changes : bool
        Look for sudden changes of the muscle.

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    window: float = 60.0
    step_period: float = 0.25
    choose_basis: bool = True
    find_changes: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ('window', 'step_period'):
            check_number(IdentificationError, name, getattr(self, name), 0, above=True, unit='s')


# Pulses up to this rate fit into the window [Hz]; at a higher one it is shorter.
_HIGHEST_RATE = 120.0
_SPARE_BLOCKS = 128
_BLOCKS_OF_PAUSES = 4
# Without a pulse for so long, and so many times their median interval, the muscle recovers [ns].
_PAUSE_NS, _PAUSE_INTERVALS = 1_000_000_000, 4.0
# Pulses that recruit less than this share let it recover.
_RECRUITS = 0.03
# The window ends where the muscle was so different that what it was then says little of now, and
# seven functions no longer hold the stretched response.
_LARGEST_GAIN = 0.25
_LARGEST_SLOWING = 0.25
_SHORTEST_S = 20.0
# That of the slowest muscle.
_LONGEST_LAG_S = 0.3
_STEPS, _FIRST_STEPS = 2, 6
_DOUBTED_NS = 10 * NANOSECONDS_PER_SECOND
# After a rest of this length what is known of the muscle is kept as prior.
_REST_NS = 30 * NANOSECONDS_PER_SECOND
_SETTLING_NS = NANOSECONDS_PER_SECOND // 2
_YOUNG_NS = 10 * NANOSECONDS_PER_SECOND
# Neighbouring residuals of a basis that fits are seldom alike.
_ALIKE = 1.3
# Of the newest samples to which bases are fitted.
_CHOICE_NS = 16 * NANOSECONDS_PER_SECOND


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

    def __init__(
        self, settings: TrackingSettings | None = None, rate_hz: float = DEFAULT_RATE
    ) -> None:
        settings = settings if settings is not None else TrackingSettings()
        seconds = settings.window + _LONGEST_BASIS.duration
        self._choose, self._find = settings.choose_basis, settings.find_changes
        self._longest = settings.window
        self._capacity = int(seconds * _HIGHEST_RATE) + _SPARE_BLOCKS
        super().__init__(settings, rate_hz, self._capacity)
        self._step_ns = round(settings.step_period * NANOSECONDS_PER_SECOND)
        functions = settings.basis.functions
        self._last_ns: int | None = None
        self._schedule = BasisSchedule()
        self._turn = 0
        self._from_before = False
        self._since_ns = 0
        self._knowledge = self._prior
        self._origin = no_change(functions)
        self._watch = ChangeWatch()
        self._tremor = Tremor()
        self._said: deque[tuple[int, FloatArray, FloatArray]] = deque(maxlen=_SAID)
        self._wrong: deque[float] = deque(maxlen=_MOMENTS)

    @property
    def memory(self) -> float:
        """Longest time for which a pulse may act on the model's output [s]."""
        return _LONGEST_BASIS.duration

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending, none before one that was already added [ns, 1]."""
        super().add_pulses(onset_ns, intensity)
        if len(onset_ns):
            self._schedule.add_pulses(onset_ns, intensity)

    def update(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        """Learn from samples (samples,), ascending; return their a-priori prediction [N].

        See `rpms_ros.identification.model.estimate.Estimator.update`.
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
            prediction[part] = self._add_samples(stamp_ns[part], rest, usable[part])
            self._raw.add(stamp_ns[part], force[part], tremor, usable[part])
            muscle = prediction[part] - self._disturbance(stamp_ns[part])
            self._tremor.add(stamp_ns[part], force[part], muscle, usable[part])
            prediction[part] += tremor
            if self._last_ns is not None:
                since_ns = self._since_ns + int(stamp_ns[last - 1]) - self._last_ns
                self._since_ns = min(since_ns, self._step_ns)
            self._last_ns = int(stamp_ns[last - 1])
        return prediction

    def predict(self, stamp_ns: IntArray) -> FloatArray:
        """Return what is expected of samples (samples,) that come next [N]."""
        return super().predict(stamp_ns) + self._tremor.force(stamp_ns)

    def forget_pulses(self) -> None:
        """Drop the pulses that still act; the knowledge of the muscle is kept."""
        super().forget_pulses()
        self._begin_anew()
        # when they were; how many there were stays
        self._watch.found.clear()
        self._schedule.forget()
        self._tremor.forget()
        self._last_ns = None

    def start_from(self, known: FittedMuscle) -> None:
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
        theta = coordinates(known.theta)
        theta[:PARAMETERS] = np.clip(theta[:PARAMETERS], self._prior.lower, self._prior.upper)
        theta = from_coordinates(theta)
        self._prior.separate(theta)
        self._use(basis)
        self._problem = self._problem._replace(input_gain=basis.input_gain)
        self._window.point = steady(theta, known.linear)
        self._knowledge = replace(
            self._prior,
            information=scaled_inverse(known.widened(DayToDay())),
            reference=np.concatenate((coordinates(theta), known.linear)),
        )
        self._from_before = True

    def estimate(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Return the present estimate, with rates, changes, disturbance, doubts and reasons."""
        fit, watch = self._window, self._watch
        force = _force_at(fit.point, float(fit.point.times[0]), self._basis.area)
        full = self.rate_hz * abs(float(force[-1]))
        follows = follows_intensity(self._problem, fit, full)
        lively = liveliness(fit.levels, full)
        wrong = float(np.median(self._wrong)) if self._wrong else 0.0
        self._model_error = float(np.linalg.norm((wrong, follows, lively)))
        estimate = super().estimate(stamp_ns, faults)
        names, rate, deviation = _rates(fit, self._basis.area)
        half = float(ndtri(0.5 + 0.5 * estimate.confidence)) * deviation
        rest = float(np.median(fit.levels))
        behind = max(stamp_ns / INTERVAL_NS - (fit.first + len(fit.levels) - 1), 0.0) + 1.0
        slope = abs(float(np.diff(fit.levels[-2:]).sum()))
        described = replace(
            estimate,
            rate_names=names,
            rate=rate,
            rate_lower=rate - half,
            rate_upper=rate + half,
            changes=watch.count,
            change_kinds=tuple(one.kind for one in watch.found),
            change_ago=np.array([1e-9 * (stamp_ns - one.stamp_ns) for one in watch.found]),
            disturbance=float(fit.levels[-1]) - rest,
            disturbance_deviation=math.hypot(fit.level_deviation, slope * min(behind, 4.0)),
            reasons=tuple(_reasons(estimate, fit, watch.deliberating, self._tremor, wrong)),
        )
        # alike, and more than the model's own error
        alike = fit.residuals_alike and fit.misfit * fit.weighting_variance > 0.5 * fit.variance
        size = float(np.abs(described.curve_force).max(initial=0.0))
        highest = float(np.abs(described.response_force).max(initial=0.0))
        doubts = {
            BAND_WIDER_THAN_CURVE: band_wider_than_curve(described, *self._intensity_range),
            # where all of the interval is
            CURVE_NEGATIVE: described.curve_upper.min(initial=0.0) < -NEGATIVE * size,
            RESPONSE_NEGATIVE: described.response_upper.min(initial=0.0) < -NEGATIVE * highest,
            RESIDUALS_ALIKE: alike,
            DISTURBANCE_FOLLOWS: follows > 0.0,
            DISTURBANCE_LIVELY: lively > 0.0,
            NOT_ISOMETRIC: fit.swing > _SWING,
        }
        return doubted(described, doubts)

    @property
    def _theta(self) -> FloatArray:
        """Theta of now: since the last fit the thresholds have gone on to change."""
        theta = super()._theta.copy()
        theta[:MOVING] -= self._since_ns / INTERVAL_NS * self._window.point.speed[-MOVING:]
        return theta

    @property
    def _now_ns(self) -> int:
        """Newest stamp [ns]."""
        assert self._last_ns is not None
        return self._last_ns

    def _step(self) -> None:
        """Fit the window."""
        if self._intake.learnt[0] == 0.0:
            return
        if self._schedule.begun_ns is None and self._window.shows_response:
            self._schedule.begin(self._now_ns)
        acting_ns = self._acting_ns()
        if len(acting_ns) and self._now_ns - int(acting_ns[-1]) > _REST_NS:
            self._begin_anew()
            self._from_before = True
        self._slide()
        self._follow_tremor()
        if int(self._problem.blocks.size[0]) - self._problem.first < 2:
            return
        basis, fit = self._basis, self._window
        if self._choose and fit.variance > 0.0:
            fit.colour = self._colour(self._now_ns - _COLOUR_NS)
        self._choose_basis()
        self._look_for_change(self._span())
        window = self._span()
        if not self._watch.deliberating:
            young = window.now_ns - window.first_ns < _YOUNG_NS
            steps = _FIRST_STEPS if young or basis != self._basis else _STEPS
            knowledge = self._of_any_shape(self._knowledge)
            self._try_other_start(knowledge, self._span())
            at = gauss_newton_steps(self._problem, self._window, knowledge, self._span(), steps)
            self._since_ns = 0
            self._window.swing = 0.0 if at is None else gain_swing(self._window, at)
            if at is not None:
                self._window.left_out = short_events(self._window, at)
            self._doubt_what_is_from_before(self._span())
            if self._find and self._window.variance > 0.0:
                self._watch.remember(self._window, window.now_ns)
            self._look_back()
        self._predict_by_window(INTERVAL_NS)

    def _look_back(self) -> None:
        """Hold what was said in the last seconds against what the window says of that time now.

        If the muscle is one of the model, later samples move a force within its interval.  If not,
        what a fit has taken for known moves with the samples that come, and so by how much is an
        error of the next estimate too.
        """
        now_ns, said = self._now_ns, self._said
        last_ns = said[-1][0] if said else -(2**62)
        if now_ns < last_ns + NANOSECONDS_PER_SECOND:
            return
        point, area, sure = self._window.point, self._basis.area, self._uncertainty()
        now = float(point.times[0])
        # where no pulse has recruited since then, nothing more is known of that time
        if sure is None or not (self._acting_ns(_RECRUITS)[-1:] > last_ns).any():
            return
        force, beyond = _force_at(point, now, area), []
        for stamp_ns, then, variance in said:
            away = then - _force_at(point, now - (now_ns - stamp_ns) / INTERVAL_NS, area)
            beyond.append(np.maximum(np.square(away) - variance, 0.0))
        if beyond:
            # a single moment, as when pulses begin or come again, is none
            wrong = math.sqrt(np.median(beyond, axis=0).max())
            self._wrong.append(wrong / max(abs(float(force[-1])), 1e-100))
        gradient = sure.gradient(area, *recruitment_curve(_SAID_OF, sure.theta))
        variance = np.square(sure.half_width(gradient) / sure.quantile)
        said.append((now_ns, force, variance))

    def _try_other_start(self, knowledge: WindowPrior, window: Window) -> None:
        """While the window is young try the next start; go on from there if it is better."""
        problem, fit, starts = self._problem, self._window, self.settings.starts(self.sines)
        length_ns = window.now_ns - window.first_ns
        lively = fit.scales.lively >= LIVELY
        if (length_ns > _CHALLENGED_NS or not fit.shows_response) and not lively:
            return
        self._turn = (self._turn + 1) % (2 * _RESTS * len(starts))
        if length_ns > _OFTEN_NS and self._turn % _RESTS:
            return
        again, place = divmod(self._turn // _RESTS, len(starts))
        other, steps = fresh_fit(starts[place], len(fit.point.linear)), _TRIAL_STEPS
        other.variance, other.inflation, other.colour = fit.variance, fit.inflation, fit.colour
        other.left_out = fit.left_out
        if again and fit.scales.size >= _FAR_FROM_ARCTANGENTS:
            smaller = replace(fit.scales, size=fit.scales.size - 2)
            other, steps = replace(fit, point=other.point, scales=smaller), 3 * _TRIAL_STEPS
        mine = replace(fit)
        if not steps_at_fixed_scales(problem, other, knowledge, window, steps):
            return
        if steps_at_fixed_scales(problem, mine, knowledge, window, 1) and (
            other.evidence > mine.evidence + _DECISION
        ):
            fit.point, fit.scales, fit.levels = other.point, other.scales, other.levels
            fit.first = other.first

    def _follow_tremor(self) -> None:
        """Follow a tremor, or look whether what may be one explains the samples."""
        if not self._tremor.follow(repetition_rates(self._problem.blocks)):
            return
        if self._schedule.begun_ns is None:
            # nothing is known that would be lost
            self._watch.forget()
            self._problem = self._problem._replace(first=int(self._problem.blocks.size[0]))
            self._begin_without_tremor()
            return
        self._tremor.reject()
        span = self._span()
        if span.now_ns - span.first_ns < SEARCHED_NS:
            # what an earlier muscle leaves may look like one
            return
        explained = self._choice().explained(self._basis)
        if explained.tremor:
            self._adopt(explained, self._basis)

    def _adopt(self, explained: BasisFit, basis: LaguerreBasis) -> None:
        """Go on with a basis as it explains the newest samples."""
        found, fit = explained.fit, self._window
        if explained.tremor:
            point = found.point
            rest = explained.raw.rest(basis, point.theta, point.linear)
            self._raw = explained.raw
            self._tremor.accept(explained.tremor, *rest)
            self._schedule.begin(self._now_ns)
        first_ns = self._span().first_ns
        if explained.tremor or basis != self._basis:
            self._change_basis(basis)
        if not explained.tremor and first_ns < self._compared_from():
            # of the earlier disturbance the fit of the newest samples says nothing
            fit.point = fit.point._replace(theta=found.point.theta, linear=found.point.linear)
            if fit.inflation > _ALIKE * fit.colour:
                fit.scales, fit.variance, fit.inflation = found.scales, found.variance, 1.0
            return
        # its knots are others: until the next step an estimate has to be of one fit
        fit.point, fit.covariance, fit.known_at = found.point, found.covariance, found.known_at
        fit.scales, fit.variance = found.scales, found.variance
        fit.inflation = found.inflation
        fit.levels, fit.first = found.levels, found.first

    def _begin_without_tremor(self) -> None:
        """Forget the widths that were found: they are those of the tremor."""
        fit = self._window
        fit.point = steady(fit.point.theta, fit.point.linear)
        fit.scales, fit.variance = Scales(), 0.0
        fit.levels = np.full(2, float(np.median(fit.levels)))
        self._schedule.begin(self._now_ns)

    def _doubt_what_is_from_before(self, window: Window) -> None:
        """Give up what another session, or a change, has left where the samples contradict it."""
        acting_ns = self._acting_ns()
        acting_ns = acting_ns[acting_ns >= window.first_ns]
        if not (self._from_before and len(acting_ns)):
            return
        self._from_before = window.now_ns - int(acting_ns[0]) < _DOUBTED_NS
        alone = fresh_fit(self._window.point.theta, self._basis.functions)
        mine = self._window
        alone.colour, alone.left_out, alone.swing = mine.colour, mine.left_out, mine.swing
        prior = self._of_any_shape(self._prior)
        gauss_newton_steps(self._problem, alone, prior, window, _FIRST_STEPS)
        if self._knowledge.contradicted(self._window, alone):
            self._from_before = False
            self._knowledge = self._prior
            self._window = alone
            self._watch.forget()

    def _look_for_change(self, window: Window) -> None:
        """Leave out short events and search for a change; restart the window after it."""
        intake, fit = self._intake, self._window
        samples = max(float(intake.recent[0]), 1.0)
        error, force = float(intake.error_energy[0]), float(intake.force_energy[0])
        present = Present(
            self._problem, window, self._prior, error / samples, force / samples, samples
        )
        if present.is_unexpected(fit):
            at = Linearised(self._problem, fit, self._knowledge, window)
            fit.left_out = short_events(replace(fit, point=at.point), at)
        change = self._watch.look(fit, present) if self._find else None
        if change is not None:
            self._begin_after(change)

    def _begin_after(self, change: Explanation) -> None:
        """Restart the window after a change."""
        self._said.clear()
        # whether the joint is held does not change with the muscle
        self._window = replace(change.fit, swing=self._window.swing)
        self._knowledge = change.knowledge
        # if it is of another kind than it seems, what it leaves alone is wrong
        self._from_before = True
        self._origin = origin_of(change.before)
        # The force of earlier pulses gets the new dynamics too: it has to decay first.
        settling = _SETTLING_NS if change.kind == DYNAMICS else 0
        first = first_block_after(self._problem, change.before.stamp_ns + settling)
        first = min(first, int(self._problem.blocks.size[0]) - 2)
        self._problem = self._problem._replace(first=first)

    def _span(self, oldest_ns: int = -(2**62)) -> Window:
        """Return the present window, of samples from `oldest_ns` on."""
        blocks = self._problem.blocks
        begin = (int(blocks.head[0]) + self._problem.first) % len(blocks.start_ns)
        first_ns = max(int(blocks.start_ns[begin]), oldest_ns)
        now_ns = self._now_ns
        knots, pauses = knots_of_change(self._acting_ns(), first_ns, now_ns, self._lag())
        if any(pauses):
            # a muscle that rests at times recovers while pulses recruit nothing, too
            recruiting_ns = self._acting_ns(_RECRUITS)
            knots, pauses = knots_of_change(recruiting_ns, first_ns, now_ns, self._lag())
        window = Window(first_ns, now_ns, INTERVAL_NS, knots, pauses, self._origin)
        # without a known response there is no slow change
        return window.without_past if self._schedule.begun_ns is None else window

    def _lag(self) -> float:
        """Return how long after its pulse the force acts in the mean, in intervals."""
        linear = self._window.point.linear
        area = float(self._basis.area @ linear)
        seconds = float(self._basis.moment @ linear) / area if area > 0.0 else 0.0
        return min(max(seconds, 0.0), _LONGEST_LAG_S) * NANOSECONDS_PER_SECOND / INTERVAL_NS

    def _disturbance(self, stamp_ns: IntArray) -> FloatArray:
        """Return the disturbance (samples,) [N] in the prediction."""
        baseline, levels = self._problem.baseline, self._predictor.levels
        position = (stamp_ns - baseline.origin_ns) / baseline.spacing_ns
        share = np.clip(position, near_knots(-np.inf, baseline), near_knots(np.inf, baseline))
        disturbance: FloatArray = (1.0 - share) * levels[0] + share * levels[1]
        return disturbance

    def _acting_ns(self, least: float = 0.0) -> IntArray:
        """Return when pulses that recruit more than a share began to act (pulses,) [ns]."""
        blocks = self._problem.blocks
        order = ring_order(blocks)
        strength = blocks.intensity[order]
        if least:
            theta = self._window.point.theta[: SUMMATION.start]
            rho = recruitment_curve(np.append(strength, 1.0), theta)[0]
            strength = rho[:-1] / rho[-1]
        return np.compress(strength > least, blocks.start_ns[order])

    def _slide(self) -> None:
        """Drop blocks before the window, except those that advance its first state."""
        blocks = self._problem.blocks
        capacity = len(blocks.start_ns)
        head, size = int(blocks.head[0]), int(blocks.size[0])
        start_ns = blocks.start_ns[ring_order(blocks)]
        surplus = size - (capacity - _SPARE_BLOCKS)
        oldest = self._now_ns - self._length_ns()
        first = max(int(np.searchsorted(start_ns, oldest)), self._problem.first, surplus)
        first = max(min(first, size), 0)
        if first == size:
            return
        memory_ns = round(self._basis.duration * NANOSECONDS_PER_SECOND)
        begin_ns = self._watch.explained_from(int(start_ns[first]))
        dropped = int(np.searchsorted(start_ns, begin_ns - memory_ns))
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
        behind = point.times[0] - point.times[int(np.argmax(large))] if large.any() else np.inf
        seconds = behind * INTERVAL_NS / NANOSECONDS_PER_SECOND
        return round(min(max(seconds, _SHORTEST_S), self._longest) * NANOSECONDS_PER_SECOND)

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
            self._knowledge = posterior_as_prior(self._prior, self._window)
        self._problem.blocks.size[0] = 0
        self._problem = self._problem._replace(first=0)
        self._intake.fresh[0] = 1.0
        self._origin = no_change(self._basis.functions)
        self._window.levels = self._window.levels[-2:].copy()
        self._watch.forget()
        self._said.clear()
        self._raw.forget()

    def _choose_basis(self) -> None:
        """Compare the basis with others when it is time to."""
        if not self._choose or self._watch.deliberating or not len(self._acting_ns()):
            return
        fit = self._window
        misfit = fit.inflation > _ALIKE * fit.colour or fit.scales.lively >= LIVELY
        everywhere = self._schedule.due(self._now_ns, misfit)
        if everywhere is None:
            return
        if self._tremor.frequency:
            # the muscle is known better than it was
            point = self._window.point
            rest = self._raw.rest(self._basis, point.theta, point.linear)[-1]
            self._raw = self._raw.without(self._tremor.frequency, rest)
            self._change_basis(self._basis)
        choice = self._choice()
        found = choice.better(everywhere)
        # a lively disturbance takes up what a basis leaves
        found = choice.richer(found if fit.scales.lively >= LIVELY else choice.finer(found))
        explained = choice.explained(found)
        quieter = explained.fit.scales.lively < LIVELY <= fit.scales.lively
        freed = explained.fit.inflation < _ALIKE * fit.colour < fit.inflation
        # what happens just now is no reason to take all for a disturbance
        livelier = max(fit.scales.lively, LIVELY - 1) < explained.fit.scales.lively
        better = (found != self._basis or quieter or freed) and not livelier
        adopts = explained.tremor or better
        basis = found if adopts else self._basis
        self._basis_spread = choice.spread(basis, self._span().first_ns)
        if adopts:
            self._adopt(explained, found)

    def _compared_from(self) -> int:
        """Return the first sample to which bases are fitted [ns]."""
        return max(self._span().first_ns, self._now_ns - _CHOICE_NS)

    def _choice(self) -> BasisChoice:
        """Return the choice of a basis for the newest samples."""
        prior = self._of_any_shape(self._prior)
        span = self._span(self._compared_from())
        rates = None if self._tremor.frequency else repetition_rates(self._problem.blocks)
        return BasisChoice(self._raw, self._basis, self._window, prior, span, rates)

    def _change_basis(self, basis: LaguerreBasis) -> None:
        """Put the samples of the window into blocks of another basis."""
        matrix = conversion(self._basis, basis)
        fit = self._window
        linear = matrix @ fit.point.linear
        self._into_other_blocks(basis, self._span().first_ns, self._capacity, linear)
        self._knowledge = self._knowledge.in_basis(matrix, float(np.linalg.norm(linear)))
        fit.point = fit.point._replace(linear=linear)
        if fit.known_at is not None:
            fit.known_at = fit.known_at._replace(linear=matrix @ fit.known_at.linear)
        nonlinear = len(fit.point.theta)
        past = len(fit.covariance) - nonlinear - matrix.shape[1]
        both = block_diag(np.eye(nonlinear), matrix, np.eye(past))
        fit.covariance = both @ fit.covariance @ both.T
        self._origin = self._origin._replace(linear=matrix @ self._origin.linear)
        self._watch.forget()
