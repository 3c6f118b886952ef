# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a result may be used: good, doubtful or no, with reasons.

The checks look for signs of wrong input (unit, clock, topic or axis) or failed identification in
the pulses and the force, the force simulated with the estimate
(`rpms_ros.identification.quality.explained_force`), the prediction of the end of the session by an
earlier estimate, the a-priori residual, and the doubts and intervals of the estimator.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rpms_ros.axis import QUANTITIES
from rpms_ros.errors import IdentificationError, check_number
from rpms_ros.identification.analysis.dynamics import TrainDynamics
from rpms_ros.identification.model.estimate import (
    NOT_INFORMED,
    SMALLEST_INTENSITY_SPAN,
    Estimate,
    recruiting_range,
)
from rpms_ros.identification.offline import IdentifiedSession, settled
from rpms_ros.identification.quality.doubts import (
    CLOCKS_DIFFER,
    EXPECTED_FORCE,
    FORCE_UNEXPLAINED,
    MEANING,
    NO_CONSTANT_MUSCLE,
    OF_TIME,
    PULSE_INTENSITY_INVALID,
    SAMPLES_EXCLUDED,
    SLOW_INTENSITIES,
    stated_doubt,
)
from rpms_ros.identification.quality.explained_force import (
    SimulatedFit,
    informed_physiology,
    is_no_twitch,
    simulated_fit,
    white_noise,
)
from rpms_ros.identification.stream.arrivals import no_overlap, outside_shares, range_outside
from rpms_ros.identification.stream.stream import StreamSettings
from rpms_ros.printable import percent_explained
from rpms_ros.pulses import (
    NANOSECONDS_PER_SECOND,
    BoolArray,
    FloatArray,
    ForceTrace,
    IntArray,
    PulseTrain,
    nanoseconds,
)
from rpms_ros.schema import documented

GOOD, DOUBTFUL, NO = 'good', 'doubtful', 'no'
GRADES = (GOOD, DOUBTFUL, NO)

Reason = tuple[str, str]
"""Grade and sentence."""


# Least range of the force [N].  Sensors for people resolve 0.01 to 0.1 N, and muscles of rats pull
# with some newtons; in kN a force of 10 N is 0.01.
_LEAST_FORCE = 0.05
# Share of the force's variance, noise apart, that the estimate has to explain, or it is not used,
# or doubted.  Equal pulses explain about 0.98 of trains of real muscle, whose pulses are not equal
# (docs/analysis.md); muscle that tires explains no less than 0.95 over twenty seconds.
_LEAST_EXPLAINED, _GOOD_EXPLAINED = 0.7, 0.9
# Error of the simulated force, noise excluded, residual that is no white noise, and change of the
# baseline over the time that is judged, as shares of the range of the force.
_LARGEST_ERROR, _LARGEST_RESIDUAL, _LARGEST_DRIFT = 0.08, 0.03, 0.1
# How far the response to a pulse may go below zero, as a share of its peak, before the result is
# doubtful, or not used: a muscle does not push.
_DEEPEST_SWING, _WORST_SWING = 0.15, 0.5
# The error on the end of the session with an earlier estimate may be so many times that with the
# final one, or this share of the range of the force.
_HELD_OUT_TIMES, _LARGEST_HELD_OUT = 3.0, 0.05
# Half the interval of a curve that is known whatever its parameters are: share of its maximum.
_NARROW = 0.03
# That of a good one: an error of 2 % would be 3.3 standard deviations, one of a thousand.
_KNOWN = 0.012
# That of a response, as a share of its peak: a slow sinusoid tells those of the model's muscles to
# a fifth at 20 Hz, two fifths at 30 Hz, random intensities to a fiftieth.
_UNTOLD = 0.5
# Length of the end that is judged: two periods of the slow sinusoids in use; a muscle that tires
# changes by a quarter meanwhile, which leaves 0.03 of the variance unexplained.  Half of it for an
# estimator that follows such changes, because its estimate is that of the end.
_SPAN_NS = 20 * NANOSECONDS_PER_SECOND
# A pulse counts from this share of the largest force; its force is over by then.
_STRONG = 0.1
_AFTER_NS = NANOSECONDS_PER_SECOND // 2
# The estimate after this share of the session has to predict the rest.
_LEARNT_SHARE = 0.8
FOLLOWER = 'tracking'
"""The estimator that follows a muscle that changes."""
_HINT = f'; --estimator {FOLLOWER} tells a muscle that changes, efforts and tremor apart'
_SLOW_NO_TWITCH = (
    'the response, which slow intensities hardly show, is not the course of a twitch: does a limb '
    'or sensor swing, was the sensor zeroed, did it slip? (random or catch pulses tell)'
)
_DYNAMICS_ONLY = 'dynamics only: one intensity shows no recruitment curve'
# With so many estimates there is one close to that time.
_ESTIMATES = 8


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether a result may be used."""

    grade: str = documented('good, doubtful or no')
    reasons: tuple[str, ...] = documented('why, the most serious first')

    @property
    def line(self) -> str:
        """The verdict in one line."""
        return f'{self.grade}: {"; ".join(self.reasons)}'


def of_reasons(reasons: Sequence[Reason], praise: str) -> Verdict:
    """Return the verdict with the grade of the most serious reason; `praise` if there is none."""
    ordered = sorted(reasons, key=lambda reason: -GRADES.index(reason[0]))
    if not ordered:
        return Verdict(grade=GOOD, reasons=(praise,))
    return Verdict(grade=ordered[0][0], reasons=tuple(text for _, text in ordered))


def period_of_estimates(duration: float) -> float:
    """Return the estimate period needed to judge a session of a duration [s].

    It is the period on line times a power of two, so that every estimate of a coarser grid is one
    of each finer grid: the verdict does not depend on how many other estimates there are.
    """
    on_line = StreamSettings().estimate_period
    return on_line * doublings(duration / (_ESTIMATES * on_line))


def doublings(least: float) -> int:
    """Return the smallest power of two that is not below `least`, at least 1."""
    return 1 if not least > 1.0 else int(2 ** math.ceil(math.log2(least)))


def verdict_of(
    session: IdentifiedSession,
    pulses: PulseTrain,
    forces: ForceTrace,
    expected_force: float = EXPECTED_FORCE,
    dynamics: TrainDynamics | None = None,
) -> Verdict:
    """Return the verdict on a session.

    Parameters
    ----------
    session : IdentifiedSession
        The result.
    pulses, forces : PulseTrain, ForceTrace
        The recording.
    expected_force : float
        Largest force that the muscle can have at the sensor [N].
    dynamics : TrainDynamics, optional
        Dynamics found from trains of one intensity; judged if the estimate has no curve.

    Raises
    ------
    IdentificationError
        If `expected_force` is not above 0.
    """
    check_number(IdentificationError, 'largest force', expected_force, 0, above=True, unit='N')
    unit = session.last.unit
    reasons = list(reasons_of_data(pulses, forces, expected_force, unit))
    if not any(grade == NO for grade, _ in reasons):
        reasons += [
            (NO if name == CLOCKS_DIFFER else DOUBTFUL, stated_doubt(session.last, name))
            for name in OF_TIME
            if name in session.last.doubts
        ]
    if any(grade == NO for grade, _ in reasons):
        return of_reasons(reasons, '')
    if dynamics is not None and not session.last.curve_known:
        return _of_dynamics(reasons, dynamics, unit)
    part = _looked_at(session, pulses)
    if np.count_nonzero(part) < 3:
        nothing = 'there is no force to judge by while pulses act'
        faults = session.last.faults
        # excluded samples follow from another fault, if there is one
        often = sorted(faults, key=lambda name: (name == SAMPLES_EXCLUDED, -faults[name]))
        if faults.get(PULSE_INTENSITY_INVALID):
            nothing += f': {invalid_intensities(pulses)}'
        elif often:
            nothing += f': {often[0]} {faults[often[0]]}, {MEANING.get(often[0], often[0])}'
        return of_reasons([*reasons, (NO, nothing)], '')
    found = simulated_fit(session.last, pulses, session.stamp_ns[part], session.force[part])
    span = float(np.ptp(session.force[session.usable]))
    reasons += _of_the_estimate(session.last, found, span)
    reasons += _of_the_fit(session, part, found, span)
    reasons += _of_the_end(session, pulses, span)
    reasons += _of_the_estimator(session, pulses, found.explained >= _GOOD_EXPLAINED)
    # without a curve the force is explained at one intensity only
    scope = '' if session.last.curve_known else f'{_DYNAMICS_ONLY}; '
    share = f'{percent_explained(found.explained)} % of the {QUANTITIES[unit]}'
    return of_reasons(reasons, f'{scope}the identified muscle explains {share}')


def _of_dynamics(reasons: list[Reason], dynamics: TrainDynamics, unit: str) -> Verdict:
    """Return the verdict on trains of one intensity, which give dynamics but no curve."""
    if dynamics.gain < 0.0:
        below = f'negative, {dynamics.gain:.3g} {unit}: sign or axis of the sensor is wrong'
        text = f'the {QUANTITIES[unit]} of a pulse comes out {below} (--sign, --axis)'
        return of_reasons([*reasons, (NO, text)], '')
    explained = 1.0 - (1.0 - dynamics.fit_percent / 100.0) ** 2
    share = f'{percent_explained(explained)} % of the variance of the {QUANTITIES[unit]}'
    text = f'{_DYNAMICS_ONLY}; the model of the trains ({dynamics.model}) explains {share}'
    if explained < _GOOD_EXPLAINED:
        reasons.append((NO if explained < _LEAST_EXPLAINED else DOUBTFUL, text))
    if dynamics.onset_s is None:
        reasons.append((DOUBTFUL, 'noise hides when the force begins'))
    return of_reasons(reasons, text)


def _looked_at(session: IdentifiedSession, pulses: PulseTrain) -> BoolArray:
    """Return which samples (samples,) are judged: those of the end, or all of a short session.

    The end is that of the last pulse of some strength: a series may end below the threshold.
    """
    stamps = session.stamp_ns
    inside = (pulses.onset_ns >= stamps[0]) & (pulses.onset_ns <= stamps[-1])
    onset = pulses.onset_ns[inside]
    if not len(onset):
        return np.zeros(len(stamps), dtype=np.bool_)
    strong = onset[session.last.relative_recruitment(pulses.intensity[inside]) > _STRONG]
    begin, end = int(onset.min()), int((strong if len(strong) else onset).max()) + _AFTER_NS
    span_ns = _SPAN_NS // 2 if session.last.rate_names else _SPAN_NS
    if end - begin > 1.5 * span_ns:
        begin = end - span_ns
    return session.in_order & (stamps >= begin) & (stamps <= end)


def _of_the_fit(
    session: IdentifiedSession, part: BoolArray, found: SimulatedFit, span: float
) -> Iterator[Reason]:
    """Yield reasons from residual, held-out error and baseline."""
    force, stamps = session.force, session.stamp_ns
    late = part & np.isfinite(session.shown_prediction)
    judged = slice(int(np.flatnonzero(part)[-1]) + 1)
    late[judged] &= settled(stamps[judged])
    if session.last.curve_known and not late.any():
        yield (DOUBTFUL, 'too short: no sample was predicted before it was learnt')
    residual = (force - session.prediction)[late]
    error = float(np.sqrt(np.mean(np.square(residual)))) if len(residual) else 0.0
    # the estimate of the end may explain what could not be predicted
    error = min(error, found.error)
    slow = max(error**2 - white_noise(force[late]) ** 2, 0.0) ** 0.5 if error else 0.0
    if slow > _LARGEST_RESIDUAL * span:
        hint = '' if session.last.rate_names else _HINT
        what = f'{slow:.2g} {session.last.unit} of it, {100 * slow / span:.2g} % of the range of '
        what += f'the force, is no noise of the sensor{hint}'
        yield DOUBTFUL, f'the residual is not white: {what}'
    seconds = float(np.ptp(stamps[part])) / NANOSECONDS_PER_SECOND
    if abs(found.slope) * seconds > _LARGEST_DRIFT * span:
        a_minute = f'{60 * found.slope:.2g} {session.last.unit} a minute'
        yield DOUBTFUL, f'the baseline drifts by {a_minute}'


def _of_the_end(session: IdentifiedSession, pulses: PulseTrain, span: float) -> Iterator[Reason]:
    """Yield a reason if an earlier estimate misses the end of the session more than the last."""
    stamps = session.stamp_ns
    duration = int(stamps[-1] - stamps[0])
    grid = nanoseconds(period_of_estimates(duration / NANOSECONDS_PER_SECOND))
    boundary = (int(stamps[0]) + round(_LEARNT_SHARE * duration)) // grid * grid
    before = [one for one in session.estimates[:-1] if one.stamp_ns < boundary]
    end = session.usable & (stamps >= boundary)
    if not before or not before[-1].samples or np.count_nonzero(end) < 3:
        return
    if np.any(np.diff(stamps[end]) <= 0):
        return
    held_out, fitted = (
        simulated_fit(one, pulses, stamps[end], session.force[end]).error
        for one in (before[-1], session.last)
    )
    if held_out > max(_HELD_OUT_TIMES * fitted, _LARGEST_HELD_OUT * span):
        by = f'{100 * held_out / span:.2g} % of the range of the force, fitted it is '
        by += f'{100 * fitted / span:.2g} %'
        yield DOUBTFUL, f'the end of the session, held out, is missed by {by}'


# A twitch rises within 20 to 100 ms: fewer samples a second do not show it.
_LEAST_SAMPLING_HZ = 100.0
# Fewer changes of the force than this do not tell whether they are those of a slower sensor.
_FEW = 20
# No force sensor of the field is sampled faster.
_MOST_SAMPLING_HZ = 100_000.0
# Stimulators repeat at up to 100 Hz.
_MOST_PULSES_HZ = 200.0


def reasons_of_data(
    pulses: PulseTrain, forces: ForceTrace, expected_force: float, unit: str = 'N'
) -> Iterator[tuple[str, str]]:
    """Yield grade and sentence for everything that cannot be right.

    Parameters
    ----------
    pulses, forces : PulseTrain, ForceTrace
        The recording.
    expected_force : float
        Largest force that the muscle can have [N].
    unit : str
        Unit of the force: ``N``, or ``N m`` for a torque.
    """
    force = forces.force[np.isfinite(forces.force)]
    with np.errstate(over='ignore'):
        span = float(np.ptp(force)) if len(force) else 0.0
    # an intensity of NaN was not recorded: dynamics can be found without it
    wrong = outside_shares(pulses.intensity) & ~np.isnan(pulses.intensity)
    if 2 * np.count_nonzero(wrong) > len(pulses):
        yield NO, invalid_intensities(pulses)
        return
    if not np.any(pulses.intensity > 0.0) and not np.isnan(pulses.intensity).any():
        yield NO, 'there is no pulse above intensity 0'
        return
    if (apart := no_overlap(pulses.onset_ns, forces.stamp_ns)) is not None:
        yield NO, f'{CLOCKS_DIFFER}: {apart}'
        return
    if span == 0.0:
        other = QUANTITIES['N' if unit != 'N' else 'N m']
        text = f'another topic or axis, a {other} (--quantity {other}), or a dead sensor'
        yield NO, f'the {QUANTITIES[unit]} never changes: {text}'
        return
    yield from _of_time(pulses, forces.stamp_ns, force)
    if span > expected_force:
        more = f'more than the {expected_force:g} {unit} that are expected: are these grams or '
        more += 'millinewtons, or has this muscle a higher --expected-force?'
        yield DOUBTFUL, f'the {QUANTITIES[unit]} spans {span:.4g} {unit}, {more}'
    if unit == 'N' and span < _LEAST_FORCE:
        less = f'{_LEAST_FORCE:g} N that a sensor for people resolves: is the force in kN?'
        yield DOUBTFUL, f'the force spans {span:.2g} N, less than the {less}'


def invalid_intensities(pulses: PulseTrain) -> str:
    """Return how many pulses have an intensity that is no share of the maximum, and which."""
    count = np.count_nonzero(outside_shares(pulses.intensity))
    outside = f'{count} of {len(pulses)} pulses is outside 0 to 1'
    outside += f' ({range_outside(pulses.intensity)})'
    return f'{PULSE_INTENSITY_INVALID}: the intensity of {outside}'


def _of_time(
    pulses: PulseTrain, stamp_ns: IntArray, force: FloatArray
) -> Iterator[tuple[str, str]]:
    if rate := _rate(stamp_ns):
        held = _held(force)
        if held > 1.0:
            text = f'each force is held for {held:.3g} samples: take it once, at its own time'
            yield (NO if rate < held * _LEAST_SAMPLING_HZ else DOUBTFUL), text
        elif rate < _LEAST_SAMPLING_HZ:
            need = f'a twitch needs {_LEAST_SAMPLING_HZ:g}: is the time in another unit, as ms?'
            yield NO, f'the force has {rate:.3g} samples a second, {need}'
        elif rate > _MOST_SAMPLING_HZ:
            yield NO, f'the force has {rate:.3g} samples a second: is the time in another unit?'
    if (rate := _rate(pulses.onset_ns)) > _MOST_PULSES_HZ:
        yield DOUBTFUL, f'there are {rate:.3g} pulses a second: is the time in another unit?'


def _held(force: FloatArray) -> float:
    """Return for how many samples a slower sensor holds its values, 1 if it is none.

    Neighbours of a coarse or quiet one are alike, too; but they differ where the force moves fast,
    or all by the least step.
    """
    step = np.diff(force)
    change = np.flatnonzero(step)
    apart, step = np.diff(change), np.abs(step[change])
    if len(apart) < _FEW or np.quantile(apart, 0.05) < 2 or np.median(step) < 5.0 * step.min():
        return 1.0
    return float(np.median(apart))


def _rate(stamp_ns: IntArray) -> float:
    """Return the rate of stamps (n,) [Hz]; 0 if there are fewer than two."""
    steps = np.diff(stamp_ns)
    if (steps <= 0).any():
        steps = np.diff(np.unique(stamp_ns))
    return NANOSECONDS_PER_SECOND / float(np.median(steps)) if len(steps) else 0.0


def _of_the_estimate(last: Estimate, found: SimulatedFit, span: float) -> Iterator[Reason]:
    """Yield what is wrong with an estimate, compared with a force of a range `span`."""
    if found.signal < 1.5 * found.noise:
        yield NO, 'the force holds noise only: the pulses leave no trace in it (topic, axis?)'
        return
    response = last.response_force
    extreme = float(max(response, key=abs, default=0.0))
    full = float(last.curve_force[-1]) if last.curve_known else extreme
    if abs(extreme) < 1e-9 * found.signal:
        yield NO, 'no force comes out: the estimator has learnt nothing (topic, axis?)'
        return
    if full < 0.0 or extreme < 0.0:
        worst = full if full < 0.0 else extreme
        why = 'sign or axis of the sensor is wrong (--sign, --axis)'
        if found.explained < _LEAST_EXPLAINED:
            why = 'the estimator has not converged'
        yield NO, f'the force comes out negative, {worst:.3g} {last.unit}: {why}'
        return
    yield from _of_the_explanation(found, span, last.unit)
    swing = -float(response.min()) / extreme
    if swing > _DEEPEST_SWING:
        lowest = f'{response.min():.3g} {last.unit}'
        text = f'the response to a pulse swings to {lowest}: a muscle only pulls'
        yield (NO if swing > _WORST_SWING else DOUBTFUL), text
    twitch = informed_physiology(last).get('twitch_peak_n')
    # functions that are fixed take another course even for a twitch
    chosen = last.estimator != 'recursive'
    if chosen and SLOW_INTENSITIES in last.reasons and is_no_twitch(twitch, extreme):
        yield DOUBTFUL, _SLOW_NO_TWITCH
    if len(last.curve_lower) and not last.curve_lower[-1] > 0.0:
        yield NO, 'the force at full intensity cannot be told from nothing'


def _of_the_explanation(found: SimulatedFit, span: float, unit: str) -> Iterator[Reason]:
    """Yield a reason if the simulated force differs too much from the measured one."""
    missed = max(found.error**2 - found.noise**2, 0.0) ** 0.5
    if found.explained_straight < _LEAST_EXPLAINED:
        grade = NO
    elif found.explained < _GOOD_EXPLAINED or missed > _LARGEST_ERROR * span:
        grade = DOUBTFUL
    else:
        return
    share = percent_explained(max(found.explained, 0.0))
    text = f'the identified muscle explains {share} % of the {QUANTITIES[unit]}, its error is '
    text += f'{missed:.2g} {unit}, {100 * missed / span:.2g} % of the range'
    if 0.0 < found.gain < 0.8 or found.gain > 1.25:
        text += f'; its force would fit best {found.gain:.2g} times as large'
    yield grade, text


# A train ends with a rest of this length; what goes back by less than this share of the way there
# is the jitter of a stimulator.
_REST_NS, _BACK = NANOSECONDS_PER_SECOND, 0.1


def _of_one_way(pulses: PulseTrain) -> Iterator[Reason]:
    """Yield a reason if the intensity goes one way alone in all trains."""
    pulses = pulses[np.argsort(pulses.onset_ns, kind='stable')]
    pulses = pulses[pulses.intensity > 0.0]
    ends = np.flatnonzero(np.diff(pulses.onset_ns) >= _REST_NS) + 1
    trains = np.split(pulses.intensity, ends)
    spread = max(float(np.ptp(one)) for one in trains)
    least = _BACK * spread if spread >= SMALLEST_INTENSITY_SPAN else 0.0
    for way, sign in (('rises', 1.0), ('falls', -1.0)):
        back = max(float((np.maximum.accumulate(sign * one) - sign * one).max()) for one in trains)
        if back < least:
            text = 'a muscle that tires, warms up or lags in a train looks like one of another '
            text += 'recruitment (random or catch pulses tell)'
            yield DOUBTFUL, f'between rests the intensity only {way}: {text}'


def _of_the_estimator(
    session: IdentifiedSession, pulses: PulseTrain, explained: bool
) -> Iterator[Reason]:
    """Yield reasons from doubts, parameters and intervals of the estimate.

    `explained`: whether the estimate, as it stands, explains the force of the last seconds.
    """
    last, first = session.last, session.estimates[0]
    for name in (one for one in last.doubts if one not in OF_TIME):
        # One that follows changes and efforts names them; what counts is the muscle of the end.
        if name == FORCE_UNEXPLAINED and last.rate_names and explained:
            continue
        if name == SAMPLES_EXCLUDED and last.faults.get(PULSE_INTENSITY_INVALID):
            # its cause says what to correct
            cause = invalid_intensities(pulses)
            yield DOUBTFUL, f'{cause}; where these act nothing is learnt ({SAMPLES_EXCLUDED})'
            continue
        hint = f'; --estimator {FOLLOWER} follows it' if name == NO_CONSTANT_MUSCLE else ''
        yield DOUBTFUL, stated_doubt(last, name) + hint
    if not last.curve_known:
        return
    yield from _of_one_way(pulses)
    if first is not last and first.samples and np.array_equal(first.nonlinear, last.nonlinear):
        yield NO, 'the parameters of the recruitment curve are still those of the start'
    flags = dict(zip(last.nonlinear_names, last.nonlinear_identifiability.tolist(), strict=False))
    # a curve of another shape may be known without the parameters of the nearest arctangents
    half = (last.curve_upper - last.curve_lower) / 2 / np.abs(last.curve_force).max(initial=1e-99)
    narrow = len(half) and half.max() < _NARROW
    unknown = [name for name, flag in flags.items() if flag == NOT_INFORMED and not narrow]
    if flags and len(unknown) == len(flags):
        yield NO, 'the data tell nothing about the recruitment curve: no parameter is informed'
    elif 'u_thr' in unknown:
        why = '; '.join(one for one in last.reasons if one != SLOW_INTENSITIES)
        yield DOUBTFUL, 'the data do not determine the threshold' + (f': {why}' if why else '')
    if len(half):
        yield from _of_the_intervals(last, pulses)


def _of_the_intervals(last: Estimate, pulses: PulseTrain) -> Iterator[Reason]:
    """Yield a reason where the interval of curve or response is widest, if it is too wide."""
    low, high = recruiting_range(pulses.intensity, (1.0, 0.0))
    given = (last.curve_intensity >= low) & (last.curve_intensity <= high)
    curve = last.curve_intensity, last.curve_force, last.curve_lower, last.curve_upper
    response = last.response_time, last.response_force, last.response_lower, last.response_upper
    for (at, force, lower, upper), told, most, where in (
        (curve, given, _KNOWN, 'at intensity {:.2g}'),
        (response, True, _UNTOLD, '{:.3g} s after a pulse of full intensity'),
    ):
        half = np.where(told, upper - lower, 0.0) / 2
        place = int(np.argmax(half))
        if half[place] > most * np.abs(force).max():
            ends = f'{lower[place]:.3g} to {upper[place]:.3g} {last.unit}'
            yield DOUBTFUL, f'the force {where.format(at[place])} is known only as {ends}'
