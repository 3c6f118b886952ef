# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether pulses and force belong together in time, and intensities are shares of the maximum."""

from collections import deque

import numpy as np

from rpms_ros.identification.model.estimate import SMALLEST_INTENSITY_SPAN, recruiting_range
from rpms_ros.identification.quality.doubts import CLOCKS_DIFFER, FORCE_WITHOUT_PULSES
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray, PulseTrain
from rpms_ros.saved_state import Restorable, expect

# Above a rounding error or an offset of shares, up to the maximum in per cent.
_PERCENT = (2.0, 100.0)
# Sums of 30 s, and lags up to 10 s at either side.
_BIN_NS = 5_000_000
_BINS, _LAGS = 6000, 2000
# Pulses are known so far ahead of the samples.
_AHEAD = 40
_FEWEST = 20
# Intensities that are so much alike from pulse to pulse tell no delay.
_FORETOLD = 0.9
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


def no_overlap(onset_ns: IntArray, stamp_ns: IntArray) -> str | None:
    """Return a sentence if no pulse lies in the time of the force; None if they overlap.

    Parameters
    ----------
    onset_ns : ndarray of int64 (pulses,)
        Onsets of the pulses, in any order [ns].
    stamp_ns : ndarray of int64 (samples,)
        Stamps of the force, in any order [ns].
    """
    if not len(onset_ns) or not len(stamp_ns):
        return None
    pulses = int(onset_ns.min()), int(onset_ns.max())
    force = int(stamp_ns.min()), int(stamp_ns.max())
    if pulses[0] <= force[1] and force[0] <= pulses[1]:
        return None
    # people compare seconds more easily than nanoseconds since 1970
    first = min(pulses[0], force[0])
    spans = [
        f'{(begin - first) / NANOSECONDS_PER_SECOND:.1f} s to '
        f'{(end - first) / NANOSECONDS_PER_SECOND:.1f} s'
        for begin, end in (pulses, force)
    ]
    return f'pulses are from {spans[0]}, force from {spans[1]}: they do not overlap'


def outside_shares(intensity: FloatArray) -> BoolArray:
    """Return which intensities (pulses,) are no share of the maximum, NaN included."""
    outside: BoolArray = ~((intensity >= 0.0) & (intensity <= 1.0))
    return outside


def range_outside(intensity: FloatArray) -> str:
    """Return the range of the intensities (pulses,) outside 0 to 1, with a guess at their unit."""
    wrong = intensity[outside_shares(intensity) & np.isfinite(intensity)]
    if not len(wrong):
        return 'not finite'
    low, high = float(wrong.min()), float(wrong.max())
    if low > 0.0 and _PERCENT[0] < high <= _PERCENT[1]:
        return f'up to {high:.3g}: percent?'
    return f'{low:.3g}' if low == high else f'from {low:.3g} to {high:.3g}'


def of_one_intensity(pulses: PulseTrain, stamp_ns: IntArray) -> bool:
    """Return whether the pulses in the time of the force have nearly one intensity above 0.

    Parameters
    ----------
    pulses : PulseTrain
        Pulses; those with an intensity outside 0 to 1 are not used, and do not count.
    stamp_ns : ndarray of int64 (samples,)
        Stamps of the force, in any order [ns].
    """
    if not len(stamp_ns):
        return False
    used = (pulses.onset_ns >= stamp_ns.min()) & (pulses.onset_ns <= stamp_ns.max())
    used &= ~outside_shares(pulses.intensity)
    low, high = recruiting_range(pulses.intensity[used], (np.inf, -np.inf))
    return 0.0 <= high - low < SMALLEST_INTENSITY_SPAN


class Alignment(Restorable):
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

    found: dict[str, str]
    _strange: deque[tuple[int, int, int]]
    _newest_bin: int | None
    _bins: FloatArray

    def __init__(self, lasting: bool) -> None:
        self._lasting = lasting
        self.found = {}
        self.restart()

    def _check_restored(self) -> None:
        expect(self._bins.shape == (4, _BINS), 'Alignment', f'four times {_BINS} sums')

    def restart(self) -> None:
        """Forget earlier stamps: the clock has jumped."""
        self._strange = deque(maxlen=_STRANGE)
        self._newest_bin = None
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
            self._strange.clear()
        newest = int(stamp_ns[-1]) // _BIN_NS + _AHEAD
        before = newest - _BINS if self._newest_bin is None else self._newest_bin
        self._bins[:, np.arange(max(before, newest - _BINS) + 1, newest + 1) % _BINS] = 0.0
        self._newest_bin = newest
        place = stamp_ns // _BIN_NS
        recent = (place > newest - _BINS) & (place <= newest)
        np.add.at(self._bins[0], place[recent] % _BINS, force[recent])
        np.add.at(self._bins[1], place[recent] % _BINS, 1.0)
        place = onset_ns // _BIN_NS
        recent = (place > newest - _BINS) & (place <= newest)
        np.add.at(self._bins[2], place[recent] % _BINS, intensity[recent])
        np.add.at(self._bins[3], place[recent] % _BINS, 1.0)

    def judge(self, until_ns: int) -> None:
        """Look at what came until the newest processed stamp [ns]; to be called now and then."""
        found = dict(self.found)
        if self._newest_bin is not None:
            order = np.arange(self._newest_bin + 1, self._newest_bin + 1 + _BINS) % _BINS
            force, samples, intensity, pulses = self._bins[:, order]
            known = np.flatnonzero(samples)
            if np.count_nonzero(pulses) >= _FEWEST and len(known) > _FEWEST:
                mean = force[known] / samples[known]
                step = np.diff(np.interp(np.arange(_BINS), known, mean))
                found = {} if not self._lasting else found
                found |= _answered_apart(step, intensity[:-1], pulses[:-1], known[0], known[-1])
                found |= _going_on(step, pulses[:-1], known[0], known[-1])
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
    alike = float(given[1:] @ given[:-1]) / float(given @ given) if varied else 1.0
    if alike < _FORETOLD:
        # what the pulse before does not tell, or levels that are held would answer ahead
        drive[:] = 0.0
        drive[places[1:]] = given[1:] - alike * given[:-1]
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
    if ((onset >= _ONSET[0]) & (onset <= _ONSET[1])).any():
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


def _going_on(step: FloatArray, pulses: FloatArray, first: int, last: int) -> dict[str, str]:
    """Return a doubt if the force goes on at the rate of the pulses where there are none."""
    places = np.flatnonzero(pulses)
    period = int(np.median(np.diff(places)))
    every = np.arange(len(step))
    since = every - places[np.maximum(np.searchsorted(places, every, side='right') - 1, 0)]
    since[: places[0]] = _BINS
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

    (alone, power), (driven, _) = beat(rest), beat(inside & (since <= period))
    chance = _CERTAIN * power / np.count_nonzero(rest) ** 0.5
    if alone < chance or not 0.0 < _ALIKE * driven < alone:
        return {}
    seconds = np.count_nonzero(rest) * _BIN_NS / NANOSECONDS_PER_SECOND
    return {
        FORCE_WITHOUT_PULSES: (
            f'{FORCE_WITHOUT_PULSES}: for {seconds:.2g} s without a pulse the force goes on at '
            'the rate of the pulses: some are not in the data'
        )
    }
