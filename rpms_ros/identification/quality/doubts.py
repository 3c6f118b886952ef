# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Faults of the data and doubts of an estimate: names, sentences and when they apply.

Faults are counted.  One that affects too many samples makes an estimate doubtful, because the
curve may be wrong by more than its interval.  Further doubts follow from a comparison:

Whether prediction errors follow the pulses: then the model's response is not the muscle's.
Noise, tremor and effort do not know of the pulses.  A response that begins too early, is too slow
for the functions of the model, or has become weaker does: its errors are the larger the stronger
the pulse was, and have the same course after each.  So they are regressed on the intensity of the
pulse before, apart for each 5 ms after it, and on the predicted force.

Whether a curve and a response are possible for the muscle that was measured.
An estimator can explain the force by impossible parameters: a recursion that forgets within a
tenth of a second does so under a slow sinusoid, with an output error of 1 %.  But a muscle does
not push, and the twitch of one pulse is not larger than the largest force that was measured while
such pulses were given.
"""

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import replace

import numba
import numpy as np

from rpms_ros.identification.model.estimate import (
    SMALLEST_INTENSITY_SPAN,
    Estimate,
    recruiting_range,
)
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray

FORCE_NOT_FINITE = 'force_not_finite'
FORCE_OUT_OF_BOUNDS = 'force_out_of_bounds'
FORCE_DUPLICATE = 'force_duplicate'
FORCE_CONFLICT = 'force_conflict'
FORCE_STAMP_NOT_AFTER_LAST = 'force_stamp_not_after_last'
FORCE_STAMP_ALONE = 'force_stamp_alone'
FORCE_GAP = 'force_gap'
FORCE_QUEUE_FULL = 'force_queue_full'
FORCE_SPIKE = 'force_spike'
FORCE_OUTLIER = 'force_outlier'
FORCE_ARTIFACT = 'force_artifact'
FORCE_ALTERNATING = 'force_alternating'
FORCE_FROZEN = 'force_frozen'
FORCE_CLIPPED = 'force_clipped'
FORCE_CONSTANT = 'force_constant'
FORCE_UNEXPLAINED = 'force_unexplained'
FORCE_PUBLISHERS = 'force_publishers'
CLOCK_JUMP = 'clock_jump'
PULSE_INTENSITY_INVALID = 'pulse_intensity_invalid'
PULSE_LOST = 'pulse_lost'
PULSE_LATE = 'pulse_late'
PULSE_DUPLICATE = 'pulse_duplicate'
PULSE_TOO_CLOSE = 'pulse_too_close'
PULSE_FAR_AHEAD = 'pulse_far_ahead'
PULSE_SEQUENCE_RESTART = 'pulse_sequence_restart'
PULSE_SEQUENCE_STUCK = 'pulse_sequence_stuck'
PULSE_PUBLISHERS = 'pulse_publishers'
SAMPLES_EXCLUDED = 'samples_excluded'
MONITOR_FAILED = 'monitor_failed'
PULSES_TOO_FREQUENT = 'pulses_too_frequent'
FACTORISATION_FAILED = 'factorisation_failed'

MEANING: Mapping[str, str] = {
    FORCE_NOT_FINITE: 'force samples that were NaN or infinite, dropped',
    FORCE_OUT_OF_BOUNDS: 'force samples beyond `largest_force`, dropped',
    FORCE_DUPLICATE: 'force samples that came twice, stamp and value; the second is dropped',
    FORCE_CONFLICT: 'force samples with the stamp of the one before and another value; neither is '
    'learnt from',
    FORCE_STAMP_NOT_AFTER_LAST: 'force samples stamped before their predecessor, dropped; from '
    'three a second on, as two sensors on one topic make them, learning waits',
    FORCE_STAMP_ALONE: 'force samples stamped far from those before and after them, dropped',
    FORCE_GAP: 'gaps in the force longer than allowed; learning waits for one memory after it',
    FORCE_QUEUE_FULL: 'force samples lost on their way, or without room while they waited',
    FORCE_SPIKE: 'force samples that leave the course of their neighbours for less than 10 ms; '
    'not learnt from',
    FORCE_OUTLIER: 'force samples that jump away from their prediction and back within 20 ms '
    'while it was good before; not learnt from',
    FORCE_ARTIFACT: 'the same within 10 ms after a pulse, as a stimulation artifact; not learnt '
    'from',
    FORCE_ALTERNATING: 'force samples that jump between two courses, as two sensors on one topic '
    'do; not learnt from',
    FORCE_FROZEN: 'force samples of a sensor that repeats one value where it varied before; not '
    'learnt from',
    FORCE_CLIPPED: 'force samples at the end of the range of the sensor; not learnt from',
    FORCE_CONSTANT: 'force samples that had not changed in any bit for three seconds',
    FORCE_UNEXPLAINED: 'force samples far from their prediction while it was good before: a '
    'disturbance, or the muscle has changed',
    FORCE_PUBLISHERS: 'further publishers of the force on the graph of a node; all are heard',
    CLOCK_JUMP: 'jumps of the stamps back in time; pulses that still acted are forgotten',
    PULSE_INTENSITY_INVALID: 'pulses whose intensity was not within 0..1; treated as lost',
    PULSE_LOST: 'pulses missing in the sequence; learning stops while they could act',
    PULSE_LATE: 'pulses that came after their samples were used; treated as lost',
    PULSE_DUPLICATE: 'pulses that came twice; the second is dropped, and if it has another stamp '
    'treated as lost',
    PULSE_TOO_CLOSE: 'pulses less than 0.2 ms after another, or beyond 10,000 within a second, as '
    'no stimulator gives them; treated as lost',
    PULSE_FAR_AHEAD: 'pulses stamped more than 10 s after the force, which did not follow within '
    '10 s, or beyond 100,000 of them within a second of the force; dropped',
    PULSE_SEQUENCE_RESTART: 'sequences that started anew, as after a restart of the driver; '
    'learning waits if it happens twice within 10 s, as with two drivers',
    PULSE_SEQUENCE_STUCK: 'pulses of a driver that does not count them; losses cannot show',
    PULSE_PUBLISHERS: 'further publishers of the pulses on the graph of a node; all are heard',
    SAMPLES_EXCLUDED: 'force samples that were predicted but not learnt from; so at the start of '
    'a stream whose first pulse has another sequence number than 0, with no rest before it: '
    'earlier pulses still act',
    MONITOR_FAILED: 'monitors that raised an exception and were taken out',
    PULSES_TOO_FREQUENT: 'pulses between two samples for which the window has no room, dropped',
    FACTORISATION_FAILED: 'steps of an estimator that were not taken: matrix not positive',
}

# Share of the samples that each fault may have without a doubt; monitors may add others.
_LARGEST_SHARES: Mapping[str, float] = {
    **dict.fromkeys((FORCE_OUT_OF_BOUNDS, FORCE_STAMP_NOT_AFTER_LAST, FORCE_STAMP_ALONE), 0.01),
    **dict.fromkeys((FORCE_QUEUE_FULL, FORCE_SPIKE, FORCE_OUTLIER), 0.01),
    **dict.fromkeys((FORCE_FROZEN, FORCE_CLIPPED), 0.01),
    **dict.fromkeys((FORCE_CONFLICT, FORCE_ALTERNATING, FORCE_UNEXPLAINED), 0.002),
    FORCE_NOT_FINITE: 0.1,
    FORCE_CONSTANT: 0.0,
    SAMPLES_EXCLUDED: 0.5,
}

CURVE_NEGATIVE = 'curve_negative'
CURVE_BEYOND_FORCE = 'curve_beyond_force'
RESPONSE_BEYOND_FORCE = 'response_beyond_force'
RESPONSE_NEGATIVE = 'response_negative'
BAND_WIDER_THAN_CURVE = 'band_wider_than_curve'
NO_CONSTANT_MUSCLE = 'no_constant_muscle'
RESPONSE_MISFIT = 'response_misfit'
RESIDUALS_ALIKE = 'residuals_alike'
DISTURBANCE_FOLLOWS = 'disturbance_follows_intensity'
DISTURBANCE_LIVELY = 'disturbance_lively'
FORCE_REPEATS = 'force_repeats_with_pulses'
INTERVALS_VARY = 'intervals_vary'
CHANGED_LATELY = 'changed_lately'
NOT_ISOMETRIC = 'not_isometric'
CLOCKS_DIFFER = 'clocks_differ'
FORCE_WITHOUT_PULSES = 'force_without_pulses'
OF_TIME = (CLOCKS_DIFFER, FORCE_WITHOUT_PULSES)
"""Doubts whether pulses and force belong together."""

REASON: Mapping[str, str] = {
    CURVE_NEGATIVE: 'the curve is negative: a muscle does not push',
    CURVE_BEYOND_FORCE: 'the curve is far above the largest force that was measured',
    RESPONSE_BEYOND_FORCE: 'the response to one pulse is far above the largest force that was '
    'measured',
    RESPONSE_NEGATIVE: 'the response to one pulse is far below zero: the data do not show how '
    'it runs, or it begins before the functions of the model',
    BAND_WIDER_THAN_CURVE: 'the interval of the curve is wider than the curve is high',
    NO_CONSTANT_MUSCLE: 'no constant muscle explains the whole recording: it tired, the coil '
    'moved or the patient tensed it, and the numbers are a mixture',
    RESPONSE_MISFIT: 'what is left of the force follows the pulses: the response is not one of '
    'the model, pulses do not add up as in it, or the muscle changes',
    RESIDUALS_ALIKE: 'what the muscle leaves of neighbouring samples is alike, as with a '
    'sensor that filters its noise: the curve may be wrong by more than its interval',
    DISTURBANCE_FOLLOWS: 'the disturbance runs with the intensity, as if the patient tensed with '
    'what is felt: a part of it may be in the curve, most of it with slow changes of intensity',
    DISTURBANCE_LIVELY: 'the force that no pulse causes moves all the time, as heart and breath '
    'do: the muscle cannot be told from it to within the intervals',
    FORCE_REPEATS: 'what the muscle leaves of the force repeats with every pulse, whatever its '
    'intensity, as hum of the mains at a multiple of the repetition rate: it is in the curve, too',
    INTERVALS_VARY: 'the intervals of the pulses vary, and this estimator weighs a pulse by its '
    'interval as Eq. (10) does, which is not every muscle: use batch or tracking',
    CHANGED_LATELY: 'a change was found less than 5 s of stimulation ago, or less than 20 s where '
    'the intensity changes slowly; or the muscle tires there in a train of less than 9 s',
    NOT_ISOMETRIC: 'the force of the pulses grows and falls with the force beside them, as where '
    'the joint moves: a trial that is not isometric has no curve of its own',
    CLOCKS_DIFFER: 'the stamps of force and pulses do not belong together',
    FORCE_WITHOUT_PULSES: 'the force goes on at the rate of the pulses where there are none',
}
"""Explanation of each doubt, by its name."""


class FaultCounter:
    """Counts faults by name, at once or when the samples before them are processed.

    Parameters
    ----------
    further : mapping of str to str
        Faults besides `MEANING` that may be counted, with what they mean.
    """

    def __init__(self, further: Mapping[str, str] | None = None) -> None:
        self._meaning = {**MEANING, **(further or {})}
        self._counts: Counter[str] = Counter()
        self._postponed: Counter[tuple[int, str]] = Counter()

    def add(self, name: str, count: int = 1) -> None:
        """Count `count` more faults of a known kind."""
        if name not in self._meaning:
            raise KeyError(f'expected a fault of {", ".join(self._meaning)}, got {name}')
        self._counts[name] += count

    def postpone(self, name: str, after_ns: int | None, count: int = 1) -> None:
        """Keep faults that count after a stamp [ns]; None: before the first."""
        # without one, earlier than any stamp
        self._postponed[-(2**63) if after_ns is None else after_ns, name] += count

    def count_until(self, until_ns: int | None) -> None:
        """Count what was found after stamps up to `until_ns`; None: everything."""
        for key in [key for key in self._postponed if until_ns is None or key[0] <= until_ns]:
            self.add(key[1], self._postponed.pop(key))

    def counts(self, found_ns: int | None = None) -> dict[str, int]:
        """Return the counts so far, in the order of the names.

        Those that were found after stamps up to `found_ns` [ns] are included, if it is given.
        """
        total = self._counts.copy()
        for (after_ns, name), count in self._postponed.items():
            total[name] += count if found_ns is not None and after_ns <= found_ns else 0
        return {name: total[name] for name in self._meaning if total[name]}


# A share is taken of at least so many samples [1].
_LEAST_SAMPLES = 1000
# Counts are kept for so many cells of 0.1 s [1].
_RECENT_CELLS = 300


class Doubts:
    """Keeps the shares of faults over the last half minute and over the whole session.

    Parameters
    ----------
    shares : mapping of str to float
        Largest share of the samples that each fault may have without a doubt.
    lasting : bool
        Whether a doubt stays until the end, as for an estimator that forgets nothing.
    """

    def __init__(self, shares: Mapping[str, float], lasting: bool) -> None:
        self._shares = {**_LARGEST_SHARES, **shares}
        self._lasting = lasting
        self._notes: deque[tuple[int, int, dict[str, int]]] = deque([(0, 0, {})])
        self._found: set[str] = set()

    def note(self, cells: int, samples: int, counts: Mapping[str, int]) -> None:
        """Store the total counts after so many cells and samples."""
        if self._lasting:
            found = self.names(samples, counts)
            # what was not learnt from does no harm later
            self._found.update(name for name in found if name != SAMPLES_EXCLUDED)
        self._notes.append((cells, samples, dict(counts)))
        while self._notes[0][0] <= cells - _RECENT_CELLS:
            self._notes.popleft()

    def names(self, samples: int, counts: Mapping[str, int]) -> tuple[str, ...]:
        """Return the faults whose share is too large, in the order of the counts."""
        _, before, earlier = self._notes[0]
        recent = max(samples - before, _LEAST_SAMPLES)
        return tuple(
            name
            for name, count in counts.items()
            if name in self._found
            or (
                name in self._shares
                and (
                    count > self._shares[name] * max(samples, _LEAST_SAMPLES)
                    or count - earlier.get(name, 0) > self._shares[name] * recent
                )
            )
        )


# Sums of 30 s, and lags up to 10 s at either side.
_BIN_NS = 5_000_000
_BINS, _LAGS = 6000, 2000
# Pulses are known so far ahead of the samples.
_AHEAD = 40
_FEWEST = 20
# Intensities that are so much alike from pulse to pulse tell no delay; pulses that foretell one;
# with fewer pulses a delay of some periods is as likely by chance.
_FORETOLD, _TOLD, _MANY = 0.9, 6, 60
# Trains are at least so far apart.
_TRAIN_APART = 80
# Pulses in a row that arrive apart from the force; those kept.
_FEW_APART, _STRANGE = 5, 200
# Peak of a correlation in standard deviations of the rest of it.
_CLEAR = 6.0
# When the force may begin after its pulse [s]: latency of a muscle, and the delay of a filter.
_ONSET = (-0.02, 0.05)
# The response to a pulse is over after 0.6 s; rest of 1 s tells something.
_RESPONSE_BINS, _LEAST_REST = 120, 200
# Share of what pulses cause that is no chance, and how many standard deviations of chance.
_ALIKE, _CERTAIN, _PERIODS = 0.25, 4.0, 4


class Alignment:
    """Whether force and pulses belong together in time, over the last half minute of a stream.

    Pulses of another clock arrive far from the force that came before them, all by the same
    time.  Where that says nothing, the increments of the force are correlated with the pulses: a
    muscle answers a pulse within some tens of milliseconds and not before it.  And force that goes
    on at the rate of the pulses where there are none has pulses that nobody was told of.

    Parameters
    ----------
    lasting : bool
        Whether what was found stays until the end, as for an estimator that forgets nothing.

    Attributes
    ----------
    found : dict of str to str
        Doubts by name, each with its reason for people.
    """

    def __init__(self, lasting: bool) -> None:
        self._lasting = lasting
        self.found: dict[str, str] = {}
        self.restart()

    def restart(self) -> None:
        """Forget earlier stamps: the clock has jumped."""
        self._strange: deque[tuple[int, int, int]] = deque(maxlen=_STRANGE)
        self._newest_bin: int | None = None
        self._bins = np.zeros((4, _BINS))

    def arrived_apart(self, onset_ns: IntArray, newest_ns: int) -> None:
        """Note pulses (pulses,) that arrive far from the newest stamp of the force [ns]."""
        self._strange.extend((newest_ns, onset, onset - newest_ns) for onset in onset_ns.tolist())

    def add(
        self, stamp_ns: IntArray, force: FloatArray, onset_ns: IntArray, intensity: FloatArray
    ) -> None:
        """Add processed samples (samples,) and pulses (pulses,), ascending [ns, N, ns, 1].

        The sums do not depend on how samples are cut into blocks, in no bit.
        """
        if len(onset_ns):
            # these came in time
            later = [one for one in self._strange if one[0] > stamp_ns[-1]]
            self._strange = deque(later, maxlen=_STRANGE)
        newest = int(stamp_ns[-1]) // _BIN_NS + _AHEAD
        before = newest - _BINS if self._newest_bin is None else self._newest_bin
        self._bins[:, np.arange(max(before, newest - _BINS) + 1, newest + 1) % _BINS] = 0.0
        self._newest_bin = newest
        for row, at_ns, values in ((0, stamp_ns, force), (2, onset_ns, intensity)):
            place = at_ns // _BIN_NS
            recent = (place > newest - _BINS) & (place <= newest)
            np.add.at(self._bins[row], place[recent] % _BINS, values[recent])
            np.add.at(self._bins[row + 1], place[recent] % _BINS, 1.0)

    def judge(self, until_ns: int) -> None:
        """Look at what came until the newest processed stamp [ns]; to be called now and then."""
        found = dict(self.found)
        if self._newest_bin is not None:
            order = np.arange(self._newest_bin + 1, self._newest_bin + 1 + _BINS) % _BINS
            force, samples, intensity, pulses = self._bins[:, order]
            known = np.flatnonzero(samples)
            if np.count_nonzero(pulses) >= _FEWEST and len(known) > _FEWEST:
                course = np.interp(np.arange(_BINS), known, force[known] / samples[known])
                step = np.diff(course)
                found = {} if not self._lasting else found
                found |= _answered_apart(step, intensity[:-1], pulses[:-1], known[0], known[-1])
                found |= _going_on(course[:-1], step, pulses[:-1], known[0], known[-1])
        apart = [one for one in self._strange if one[0] <= until_ns]
        if len(apart) >= _FEW_APART:
            lags = np.array([lag for _, _, lag in apart]) / NANOSECONDS_PER_SECOND
            middle = float(np.median(lags))
            lasts = abs(apart[-1][1] - apart[0][1]) >= NANOSECONDS_PER_SECOND
            if lasts and np.ptp(lags) < 0.5 * abs(middle):
                found |= {CLOCKS_DIFFER: _apart(middle, 'pulses are stamped', 'the force')}
        self.found = found


def _apart(seconds: float, what: str, other: str) -> str:
    which = 'before' if seconds < 0.0 else 'after'
    return (
        f'{CLOCKS_DIFFER}: {what} {abs(seconds):.3g} s {which} {other}: the clocks of sensor and '
        'stimulator differ, or one is delayed'
    )


def _answered_apart(
    step: FloatArray, intensity: FloatArray, pulses: FloatArray, first: int, last: int
) -> dict[str, str]:
    """Return a doubt if the increments of the force (bins,) do not follow the pulses (bins,)."""
    step = np.clip(step, *np.quantile(step, (0.005, 0.995)))
    places = np.flatnonzero(pulses)
    given = intensity[places] / pulses[places]
    drive = pulses - pulses.mean()
    varied = float(np.ptp(given)) >= SMALLEST_INTENSITY_SPAN
    given -= given.mean()
    # within trains, if there are any
    apart = np.diff(places, prepend=0) >= _TRAIN_APART
    near = ~apart[1:]
    pair = np.stack((given[1:], given[:-1]))[:, near if near.any() else ~near]
    alike = float(pair[0] @ pair[1]) / max(float(pair[0] @ pair[0]), 1e-100) if varied else 1.0
    if told := alike < _FORETOLD and len(given) >= _MANY:
        # what pulses before do not tell, or levels that are held would answer ahead; one alone
        # would leave an echo of single pulses among slow ones
        before, drive[:] = np.lib.stride_tricks.sliding_window_view(given[:-1], _TOLD), 0.0
        foretold = before @ np.linalg.lstsq(before, given[_TOLD:], rcond=None)[0]
        drive[places[_TOLD:]] = given[_TOLD:] - foretold
    else:
        # a train of alike pulses answers as a whole, and so ahead of its later ones
        begin, trains = places[apart], np.split(given, np.flatnonzero(~near) + 1)
        even = max(map(np.ptp, trains)) < SMALLEST_INTENSITY_SPAN
        if even and _FEW_APART <= len(begin) < len(places):
            drive[:] = 0.0
            drive[begin] = intensity[begin]
            drive -= drive.mean()
    known = (np.arange(len(step)) >= first) & (np.arange(len(step)) < last)
    room = _correlated(known.astype(float), np.square(drive))
    # lags at which little is left to compare are no measure of chance
    enough = room >= 0.25 * room.max()
    together = np.where(enough, _correlated(step - step[known].mean() * known, drive), 0.0)
    together /= np.sqrt(np.where(enough, room, 1.0))
    peak = int(np.argmax(np.abs(together)))
    together *= np.sign(together[peak])
    if together[peak] <= _CLEAR * 1.4826 * float(np.median(np.abs(together[enough]))):
        return {}
    # where pulses are alike, other lags explain as much: none of them may be possible
    high = np.flatnonzero(together >= 0.6 * together[peak])
    low = np.flatnonzero(together <= 0.25 * together[peak])
    begins = low[np.maximum(np.searchsorted(low, high) - 1, 0)] + 1
    onset = (begins - _LAGS + 0.5) * _BIN_NS / NANOSECONDS_PER_SECOND
    possible = ((onset >= _ONSET[0]) & (onset <= _ONSET[1])).any()
    # of pulses that are alike, at one interval, their ripple alone tells a lag, no slow course,
    # which is as high half an interval aside
    intervals, aside = np.diff(places), np.array([-0.5, 0.5])
    beside = np.clip(peak + (aside * np.median(intervals)).astype(int), 0, 2 * _LAGS)
    regular = not told and intervals.max() < 1.5 * np.median(intervals)
    if possible or (regular and np.isin(beside, high).all()):
        return {}
    nearest = float(onset[np.argmin(np.abs(onset))])
    return {CLOCKS_DIFFER: _apart(nearest, 'the force answers', 'the pulses')}


def _correlated(course: FloatArray, drive: FloatArray) -> FloatArray:
    """Return the correlation of a course with a drive (bins,) by lag, that of 0 in the middle."""
    # no shorter lag wraps around
    size = _BINS + _LAGS
    spectrum = np.fft.rfft(course, size) * np.conj(np.fft.rfft(drive, size))
    by_lag = np.fft.irfft(spectrum, size)
    return np.concatenate((by_lag[-_LAGS:], by_lag[: _LAGS + 1]))


def _going_on(
    course: FloatArray, step: FloatArray, pulses: FloatArray, first: int, last: int
) -> dict[str, str]:
    """Return a doubt if the force goes on where there are no pulses.

    It does at their rate, or moves as much as with them: those of random intensity leave no trace
    of their rate.
    """
    places = np.flatnonzero(pulses)
    period = int(np.median(np.diff(places)))
    every = np.arange(len(step))
    since = every - places[np.maximum(np.searchsorted(places, every, side='right') - 1, 0)]
    # those of before the window are not known
    since[: places[0]] = every[: places[0]]
    inside = (every >= first) & (every < last)
    rest = inside & (since > max(_RESPONSE_BINS, 2 * period))
    if period < 2 or np.count_nonzero(rest) < _LEAST_REST:
        return {}

    def beat(chosen: BoolArray) -> tuple[float, float]:
        """Return how alike increments some periods apart are, and their power."""
        total = 0.0
        # not within the response to one pulse, which is alike by itself
        for half in range(3, 2 * _PERIODS + 4):
            lag = half * period // 2
            pair = chosen[lag:] & chosen[:-lag]
            alike = float(np.mean(step[lag:][pair] * step[:-lag][pair])) if pair.any() else 0.0
            weight = 0.5 if half in (3, 2 * _PERIODS + 3) else 1.0
            total += -weight * alike if half % 2 else weight * alike
        return total / _PERIODS, float(np.mean(np.square(step[chosen])))

    active = inside & (since <= period)
    (alone, power), (driven, _) = beat(rest), beat(active)
    chance = _CERTAIN * power / np.count_nonzero(rest) ** 0.5
    found = ''
    if alone >= chance and 0.0 < _ALIKE * driven < alone:
        found = 'goes on at the rate of the pulses: some are not in the data'
    elif course[rest].var() > max(_ALIKE * float(course[active].var()), _CERTAIN**2 * power):
        found = 'moves as with pulses: some are not in the data, or the patient tenses there'
    seconds = np.count_nonzero(rest) * _BIN_NS / NANOSECONDS_PER_SECOND
    said = f'{FORCE_WITHOUT_PULSES}: for {seconds:.2g} s without a pulse the force {found}'
    return {FORCE_WITHOUT_PULSES: said} if found else {}


# Lags after a pulse, of the same length.
_AFTER = 20
# Sums of a lag: samples, intensity, its square, error, error times intensity, error squared.
_SUMS = 6
# Over all lags: samples, prediction, its square, error, error times prediction, force squared,
# error squared.
_ALL = 7
# So many seconds count, those with the largest errors left out: after a sudden change the
# muscle is learnt anew, and an effort of the patient is short.
_SECONDS, _LEFT_OUT = 12, 4
# An estimator learns first [s].
_SETTLING_S = 8
# Root mean square over the lags of the error of a pulse of full intensity, as a share of that of
# the force, and share by which the prediction is too small or too large.  Functions that begin
# 8 ms after the muscle have 1.6 %: the curve is then wrong by less than 1 %, which is no reason
# not to trust it.
_SHAPE, _GAIN = 0.025, 0.01
# Share of the largest force of curve and response above which what repeats is no error of the
# response: hum of 1 % has 0.6 %, behind a low-pass of 30 Hz 0.2 %; functions that do not quite fit
# have 0.1 %.
_REPEATED = 0.0015
# Variance of a slope that noise explains, times this for noise whose neighbours are alike.
_CHANCE = 4.0
# Intensities that differ less do not tell the response from the baseline.
_LEAST_SPREAD = 0.05


@numba.njit(cache=True)
def _add_errors(
    lag: IntArray,
    intensity: FloatArray,
    force: FloatArray,
    prediction: FloatArray,
    by_lag: FloatArray,
    over_all: FloatArray,
) -> None:
    """Add samples to the sums, one after the other, so that no bit depends on the blocks."""
    for place in range(len(lag)):
        pulse, expected, there = intensity[place], prediction[place], by_lag[lag[place]]
        error = force[place] - expected
        sums = (1.0, pulse, pulse**2, error, error * pulse, error**2)
        for column in range(_SUMS):
            there[column] += sums[column]
        both = (error * expected, force[place] ** 2, error**2)
        whole = (1.0, expected, expected**2, error, *both)
        for column in range(_ALL):
            over_all[column] += whole[column]


class ResponseMisfit:
    """Regression of the prediction errors on the pulses, over the last seconds."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget everything: the clock has jumped."""
        self._onset_ns, self._intensity = np.empty(0, dtype=np.int64), np.empty(0)
        self._cell: int | None = None
        self._cells = 0
        self._by_lag = np.zeros((_SECONDS, _AFTER, _SUMS))
        self._over_all = np.zeros((_SECONDS, _ALL))

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending [ns, 1]."""
        self._onset_ns = np.concatenate((self._onset_ns, onset_ns))
        self._intensity = np.concatenate((self._intensity, intensity))

    def add(
        self, stamp_ns: IntArray, force: FloatArray, prediction: FloatArray, usable: BoolArray
    ) -> None:
        """Add samples (samples,), ascending, whose pulses have been added [ns, N, N].

        The sums do not depend on how samples are cut into blocks, in no bit.
        """
        if not len(self._onset_ns):
            return
        cell = stamp_ns // NANOSECONDS_PER_SECOND
        starts = np.flatnonzero(np.diff(cell)) + 1
        for first, last in zip((0, *starts), (*starts, len(stamp_ns)), strict=True):
            if self._cell is not None and cell[first] != self._cell:
                self._cells += 1
                self._by_lag[self._newest] = 0.0
                self._over_all[self._newest] = 0.0
            self._cell = int(cell[first])
            part = slice(first, last)
            if self._cells >= _SETTLING_S:
                self._sum(stamp_ns[part], force[part], prediction[part], usable[part])
        begun = int(np.searchsorted(self._onset_ns, stamp_ns[-1], side='right'))
        self._onset_ns = self._onset_ns[max(begun - 1, 0) :]
        self._intensity = self._intensity[max(begun - 1, 0) :]

    def _sum(
        self, stamp_ns: IntArray, force: FloatArray, prediction: FloatArray, usable: BoolArray
    ) -> None:
        place = np.searchsorted(self._onset_ns, stamp_ns, side='right') - 1
        lag = (stamp_ns - self._onset_ns[np.maximum(place, 0)]) // _BIN_NS
        chosen = usable & (place >= 0) & (lag < _AFTER) & np.isfinite(force - prediction)
        lag, place = lag[chosen], place[chosen]
        force, expected = force[chosen], prediction[chosen]
        muscle = self._intensity[place], force, expected
        _add_errors(lag, *muscle, self._by_lag[self._newest], self._over_all[self._newest])

    @property
    def _newest(self) -> int:
        return self._cells % _SECONDS

    @property
    def sizes(self) -> tuple[float, float, float]:
        """Errors of the response's shape and size, as shares of the force, and what repeats [N].

        That with every pulse, whatever its intensity (root mean square).  0 if unknown.
        """
        counted = np.argsort(self._over_all[:, -1], kind='stable')[: _SECONDS - _LEFT_OUT]
        samples, prediction, squares, error, product, power, noise = self._over_all[counted].sum(0)
        if self._cells < _SETTLING_S + _SECONDS or not power > 0.0:
            return 0.0, 0.0, 0.0
        spread = squares - prediction**2 / samples
        gain = (product - error * prediction / samples) / spread if spread > 0.0 else 0.0
        chance = _CHANCE * (noise - error**2 / samples) / samples / spread if spread > 0.0 else 0.0
        gain = float(np.sqrt(max(gain**2 - chance, 0.0)))
        by_lag = self._by_lag[counted].sum(0)
        some = by_lag[by_lag[:, 0] > 0.0]
        count, intensity, its_square, error_there, both, its_noise = some.T
        share, mean = count / count.sum(), error_there / count
        of_mean = _CHANCE * (its_noise / count - mean**2) / count
        repeats = float(np.sqrt(max(share @ ((mean - share @ mean) ** 2 - of_mean), 0.0)))
        varied = its_square - intensity**2 / count
        enough = varied > count * _LEAST_SPREAD**2
        slope = (both - error_there * intensity / count)[enough] / varied[enough]
        if not enough.any():
            return 0.0, gain, repeats
        by_chance = (its_noise / count)[enough] / varied[enough]
        mean_square = float(np.average(slope**2 - _CHANCE * by_chance, weights=count[enough]))
        return float(np.sqrt(max(mean_square, 0.0) * samples / power)), gain, repeats

    def doubts(self, estimate: Estimate, on_line: bool) -> tuple[str, ...]:
        """Return the doubts of an estimate: whether the errors follow or repeat with the pulses.

        One that works off line compares the force with its one fit itself.
        """
        shape, gain, repeats = self.sizes
        follows = on_line and (shape > _SHAPE or gain > _GAIN)
        # at low rates a single response is higher
        highest = np.abs(np.append(estimate.curve_force, estimate.response_force)).max(initial=0.0)
        holds = {RESPONSE_MISFIT: follows, FORCE_REPEATS: repeats > _REPEATED * highest}
        return tuple(name for name in holds if holds[name] and estimate.curve_known)


EXPECTED_FORCE = 200.0
"""Far above the force of a hand, a forearm or a foot [N]; a strong leg may have more."""

SLOW_INTENSITIES = (
    'the intensity changes too slowly to show a limb or sensor that swings, filters or slips, or '
    'a step of the curve between levels: intervals hold without it (random or catch pulses tell)'
)
# Mean square of the step from pulse to pulse, as a share of the variance of what they recruit: 2
# with random intensities, 0.4 with a tenth of catch pulses, 0.002 with a sinusoid of 9 s at 20 Hz.
_SLOW_STEPS = 0.04
# The response to a pulse is nearly over [ns].
_OVER_NS = 400_000_000
_LEVELS = 101
# A train after a rest is young for one period of the slow sinusoids in use [ns].  A muscle whose
# force or time constant may change by so much [%/min] tires in it as pulses recruit, which looks
# like one of another response, or an effort.
_REST_NS, _YOUNG_NS, _FAST = 1_000_000_000, 9_000_000_000, 10.0


class IntensitySteps:
    """Counts how often one intensity follows another; after a rest, how often it follows none."""

    def __init__(self) -> None:
        self._count, self._begun_ns = np.zeros((_LEVELS, _LEVELS)), -_YOUNG_NS
        self._onset_ns = self._level = np.empty(0, dtype=np.int64)

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending [ns, 1]."""
        onset_ns = np.append(self._onset_ns, onset_ns)
        level = np.append(self._level, np.rint((_LEVELS - 1) * intensity).astype(np.int64))
        gap_ns = np.diff(onset_ns)
        near = np.abs(gap_ns) < _OVER_NS
        np.add.at(self._count, (near * level[:-1], level[1:]), 1.0)
        self._begun_ns = int(np.append(self._begun_ns, onset_ns[1:][gap_ns > _REST_NS])[-1])
        self._onset_ns, self._level = onset_ns[-1:], level[-1:]

    def tires_anew(self, estimate: Estimate) -> bool:
        """Return whether a train after a rest is young, in which the muscle may change fast."""
        ends = np.abs([estimate.rate_lower[:2], estimate.rate_upper[:2]]).max(initial=0.0)
        return 0 < estimate.stamp_ns - self._begun_ns < _YOUNG_NS and bool(ends > _FAST)

    def reasons(self, estimate: Estimate) -> tuple[str, ...]:
        """Return a reason if what pulses recruit hardly changes from one to the next."""
        pulses = self._count.sum(axis=0)
        if not (estimate.curve_known and pulses.any()):
            return ()
        # not its relative recruitment: a curve of zeros, as at the start, says nothing
        share = np.linspace(0.0, 1.0, _LEVELS)
        force = np.interp(share, estimate.curve_intensity, estimate.curve_force)
        spread = np.square(force - np.average(force, weights=pulses))
        steps = self._count * np.square(force[:, None] - force)
        return (SLOW_INTENSITIES,) if steps.sum() < _SLOW_STEPS * pulses @ spread else ()


def doubted(estimate: Estimate, holds: Mapping[str, bool]) -> Estimate:
    """Return an estimate with the doubts that hold, and their reasons; none without a curve."""
    found = [name for name, doubt in holds.items() if doubt and estimate.curve_known]
    return replace(
        estimate,
        doubts=(*estimate.doubts, *found),
        reasons=(*estimate.reasons, *(REASON[name] for name in found)),
    )


def stated_doubt(estimate: Estimate, name: str) -> str:
    """Return a doubt of an estimate by name, with its own reason or else what it means."""
    own = (reason for reason in estimate.reasons if reason.startswith(f'{name}: '))
    return next(own, f'{name}: {meaning_of_doubt(name)}')


def meaning_of_doubt(name: str) -> str:
    """Return the explanation of a doubt of an estimate; monitors may add others."""
    return REASON.get(name) or MEANING.get(name, 'reported by a monitor')


def band_wider_than_curve(estimate: Estimate, low: float, high: float) -> bool:
    """Return whether, between the intensities given, the interval is wider than the curve."""
    if not (estimate.curve_known and len(estimate.curve_upper)):
        return False
    reached = estimate.curve_intensity <= high + 1e-9
    given = reached & (estimate.curve_intensity >= low)
    width = (estimate.curve_upper - estimate.curve_lower)[given].max(initial=0.0)
    return bool(width > np.abs(estimate.curve_force[reached]).max(initial=0.0))


# Limits as shares of the largest force, with room for noise and baseline.
_BEYOND = 1.5
NEGATIVE = 0.2
# Limit as a share of the largest value of the response; noise causes a tenth.
_RESPONSE_NEGATIVE = 0.25
# Pulses slower than this share of the rate of the curve never reach the force of the curve.
_SLOWER = 0.7


class PlausibilityCheck:
    """Compares an estimate with the forces and the pulses that the estimator was given.

    Attributes
    ----------
    largest_force : float
        Of either sign [N].
    pulses : int
        How many there were.
    intensity_range : tuple of float
        Their lowest and highest intensity above 0, shares of the maximum.
    """

    def __init__(self) -> None:
        self.largest_force = 0.0
        self.pulses = 0
        self.intensity_range = (np.inf, -np.inf)
        self._time_ns = 0
        self._last_ns = np.empty(0, dtype=np.int64)

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending [ns, 1]."""
        line = np.append(self._last_ns, onset_ns)
        self._time_ns += int(np.maximum(np.diff(line), 0).sum())
        self._last_ns = line[-1:]
        self.pulses += len(onset_ns)
        self.intensity_range = recruiting_range(intensity, self.intensity_range)

    def add_forces(self, force: FloatArray, usable: BoolArray) -> None:
        """Add samples (samples,) [N]."""
        self.largest_force = float(np.abs(force[usable]).max(initial=self.largest_force))

    def examine(self, estimate: Estimate) -> Estimate:
        """Return the estimate, with doubts and reasons added where it is impossible."""
        if not estimate.curve_known:
            return estimate
        # at intensities that were given
        given = estimate.curve_intensity <= self.intensity_range[1] + 1e-9
        curve = estimate.curve_force[given]
        full = float(estimate.curve_force[-1])
        # The response is to full intensity, which need not have been given.
        share = abs(float(curve[-1]) / full) if full else 1.0
        highest = float(estimate.response_force.max(initial=0.0))
        lowest = float(estimate.response_force.min(initial=0.0))
        most = _BEYOND * self.largest_force
        # of fewer than two pulses there is no rate
        fast = not self._time_ns or (
            (self.pulses - 1) * NANOSECONDS_PER_SECOND / self._time_ns
            > _SLOWER * estimate.repetition_rate
        )
        wrong = {
            CURVE_NEGATIVE: bool(curve.min() < -NEGATIVE * self.largest_force),
            CURVE_BEYOND_FORCE: bool(curve.max() > most and fast),
            RESPONSE_BEYOND_FORCE: min(share, 1.0) * highest > most,
            RESPONSE_NEGATIVE: lowest < -_RESPONSE_NEGATIVE * highest,
            BAND_WIDER_THAN_CURVE: band_wider_than_curve(estimate, *self.intensity_range),
        }
        return doubted(estimate, wrong)
