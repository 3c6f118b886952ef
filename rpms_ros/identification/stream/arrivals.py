# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The pulses of a stream: their order, lost and unusable ones, whether the force follows them.

A pulse is *settled* when the force has come so far that an earlier one would be too late.  Only
settled pulses are compared with their predecessors, so the result depends on stamps and
sequence numbers alone, not on the order or the time of arrival.

Pulses stamped far after the newest force are kept for a limited time in case it follows; those
stamped long before it are late, or the first ones after a clock has jumped back.  Each second of
stamps has room for so many pulses: what comes beyond is refused and counted.
"""

from collections import Counter, deque
from collections.abc import Callable

import numpy as np

from rpms_ros.identification.model.estimate import SMALLEST_INTENSITY_SPAN, recruiting_range
from rpms_ros.identification.quality import doubts as faults
from rpms_ros.identification.quality.doubts import FaultCounter
from rpms_ros.pulses import (
    NANOSECONDS_PER_SECOND,
    BoolArray,
    FloatArray,
    ForceTrace,
    IntArray,
    PulseTrain,
)


class PulseRoom:
    """Counts pulses by seconds, first come first served.

    Who is refused follows from what came before in the same second alone: not from what has been
    processed meanwhile, which depends on how a stream is cut into blocks.

    Parameters
    ----------
    most : int
        So many pulses fit into one second.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._taken: Counter[int] = Counter()
        self._refused: Counter[int] = Counter()

    def admitted(self, pulses: PulseTrain, stamp_ns: IntArray) -> PulseTrain:
        """Return the pulses for which there is room in the seconds of these stamps (pulses,)."""
        second = stamp_ns // NANOSECONDS_PER_SECOND
        kept: BoolArray = np.ones(len(pulses), dtype=np.bool_)
        for one in np.unique(second).tolist():
            here = np.flatnonzero(second == one)
            room = self._most - self._taken[one]
            kept[here[room:]] = False
            self._taken[one] += len(here[:room])
            self._refused[one] += len(here[room:])
        return pulses[kept]

    def refused(self, until_ns: int) -> int:
        """Return how many were refused in seconds over by `until_ns`, which are forgotten."""
        over = [one for one in self._taken if (one + 1) * NANOSECONDS_PER_SECOND <= until_ns]
        for one in over:
            del self._taken[one]
        return sum(self._refused.pop(one, 0) for one in over)


# A pulse is far beyond this, and is given up when the force went on as long without it [ns].
FAR_NS = 10 * NANOSECONDS_PER_SECOND
# So many are kept of those that come while the force goes on by a second, or before the first of
# it: pulses of more than an hour at 20 Hz.
MOST_PULSES = 100_000
# Where the force was before its first sample, and where it never comes.
LONG_AGO, _NEVER = -(2**63), 2**63 - 1


class FarPulses:
    """Keeps far pulses, each with the newest stamp of the force when it arrived."""

    def __init__(self) -> None:
        self._kept = PulseTrain.of([])
        self._since_ns = np.empty(0, dtype=np.int64)
        self._room = PulseRoom(MOST_PULSES)

    def take(self, pulses: PulseTrain, newest_ns: int | None) -> PulseTrain:
        """Keep the far pulses; return the others."""
        if newest_ns is None:
            pulses = self._admitted(pulses, LONG_AGO)
        if not len(pulses):
            return pulses
        first_ns = newest_ns if newest_ns is not None else int(pulses.onset_ns.min())
        far = pulses.onset_ns > first_ns + FAR_NS
        if far.any():
            kept = pulses[far] if newest_ns is None else self._admitted(pulses[far], newest_ns)
            self._kept = PulseTrain.joined([self._kept, kept])
            # those before the first sample are not given up
            since_ns = np.full(len(kept), _NEVER if newest_ns is None else newest_ns)
            self._since_ns = np.concatenate((self._since_ns, since_ns))
        return pulses[~far]

    def come_near(self, until_ns: int) -> tuple[PulseTrain, int]:
        """Return the pulses no longer far at `until_ns` [ns], and how many were given up."""
        given_up = self._room.refused(until_ns)
        near = self._kept.onset_ns <= until_ns + FAR_NS
        far_too_long = ~near & (self._since_ns < until_ns - FAR_NS)
        found, kept = self._kept[near], ~near & ~far_too_long
        if not kept.all():
            self._kept, self._since_ns = self._kept[kept], self._since_ns[kept]
        return found, given_up + int(np.count_nonzero(far_too_long))

    def _admitted(self, pulses: PulseTrain, newest_ns: int) -> PulseTrain:
        return self._room.admitted(pulses, np.full(len(pulses), newest_ns, dtype=np.int64))


SEQUENCE_PERIOD = 2**32
_MANY_ARRIVALS = 1000
# Pulses with onsets in one second: twice of what stimulators could give, which are 0.2 ms apart.
MOST_IN_A_SECOND = 10_000
# Pulses closer than this do not come from one stimulator [ns].
_CLOSEST_NS = 200_000
# A second restart of the sequence within this time is not a restart of the driver [ns].
_RESTARTS_NS = 10_000_000_000


class PulseQueue:
    """Orders pulses by onset and finds lost, doubled and unusable ones.

    Parameters
    ----------
    memory_ns : int
        How long a pulse acts on the force [ns].
    pulse_look_ahead_ns : int
        Samples up to this before the pulse that shows a gap in the sequence are not excluded [ns].
    counter : FaultCounter
        Where faults are counted.
    """

    def __init__(self, memory_ns: int, pulse_look_ahead_ns: int, counter: FaultCounter) -> None:
        self.memory_ns = memory_ns
        self._pulse_look_ahead_ns = pulse_look_ahead_ns
        self.counter = counter
        # whether the first pulse that was heard is none of the first of a driver
        self.began_amid = False
        self._last_sequence: int | None = None
        # whether the driver counts its pulses
        self._counts = False
        self.restart()

    def restart(self) -> None:
        """Forget everything but the sequence number: the clock has jumped."""
        self._arrived: list[PulseTrain] = []
        self._ordered = PulseTrain.of([])
        self._far = FarPulses()
        self._room = PulseRoom(MOST_IN_A_SECOND)
        self._unknown: list[tuple[int, int]] = []
        self._last_onset_ns: int | None = None
        self._last_restart_ns = LONG_AGO

    def add(self, pulses: PulseTrain, newest_ns: int | None = None) -> None:
        """Add pulses, in any order, none too late.

        `newest_ns` is the newest stamp of the force on their arrival [ns], None before the first.
        """
        near = self._far.take(pulses, newest_ns)
        if newest_ns is not None:
            near = self._room.admitted(near, near.onset_ns)
        if len(near):
            self._arrived.append(near)
        if len(self._arrived) > _MANY_ARRIVALS:
            # No force arrives: keep one array instead of many small ones.
            self._merge_arrived()

    def settle(self, until_ns: int, cell_ns: int) -> tuple[IntArray, FloatArray]:
        """Return the pulses with onsets up to `until_ns`, ascending, that can be used.

        Parameters
        ----------
        until_ns : int
            How far pulses are settled [ns].
        cell_ns : int
            The same at the beginning of the present cell of the grid of stamps [ns]: far pulses
            are examined once a cell, however it is cut into blocks.

        Returns
        -------
        onset_ns : ndarray of int64, shape (pulses,)
            Onsets [ns].
        intensity : ndarray, shape (pulses,)
            Shares of the maximum, 0..1.
        """
        come_near, given_up = self._far.come_near(cell_ns)
        self.counter.add(faults.PULSE_FAR_AHEAD, given_up)
        self.counter.add(faults.PULSE_TOO_CLOSE, self._room.refused(cell_ns))
        if len(come_near):
            self._arrived.append(come_near)
        self._merge_arrived()
        due = int(np.searchsorted(self._ordered.onset_ns, until_ns, side='right'))
        if not due:
            return self._ordered.onset_ns[:0], self._ordered.intensity[:0]
        train, self._ordered = self._ordered[:due], self._ordered[due:]
        columns = (train.onset_ns, train.sequence, train.intensity)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        kept = np.array([self._accept(*row) for row in rows], dtype=np.bool_)
        return train.onset_ns[kept], train.intensity[kept]

    def unknown(self, stamp_ns: IntArray) -> BoolArray:
        """Return which stamps (samples,) a pulse of unknown strength could act on."""
        touched = np.zeros(len(stamp_ns), dtype=np.bool_)
        if not len(stamp_ns):
            return touched
        for start, end in self._unknown:
            touched |= (stamp_ns > start) & (stamp_ns <= end)
        self._unknown = [span for span in self._unknown if span[1] > stamp_ns[-1]]
        return touched

    def exclude(self, start_ns: int, end_ns: int) -> None:
        """Mark the time after `start_ns` up to `end_ns` as affected by unknown pulses."""
        apart = []
        for start, end in self._unknown:
            if end < start_ns or start > end_ns:
                apart.append((start, end))
            else:
                start_ns, end_ns = min(start, start_ns), max(end, end_ns)
        self._unknown = [*apart, (start_ns, end_ns)]

    def _merge_arrived(self) -> None:
        if self._arrived:
            train = PulseTrain.joined([self._ordered, *self._arrived])
            self._ordered = train[np.lexsort((train.intensity, train.sequence, train.onset_ns))]
            self._arrived = []

    def _accept(self, onset: int, sequence: int, intensity: float) -> bool:
        """Compare one pulse with the one before it; return whether it can be used."""
        if self._last_sequence is None:
            self._look_before(onset, sequence)
        elif self._last_onset_ns is not None and not self._in_sequence(onset, sequence):
            return False
        self._last_onset_ns = onset
        self._last_sequence = sequence
        if 0.0 <= intensity <= 1.0:
            return True
        self.counter.add(faults.PULSE_INTENSITY_INVALID)
        self.exclude(onset, onset + self.memory_ns)
        return False

    def _look_before(self, onset_ns: int, sequence: int) -> None:
        """Exclude what earlier pulses may act on, if the first one that is heard is not number 0.

        The stream began amid stimulation, or pulses were lost before the first one was heard.
        """
        self.began_amid = sequence % SEQUENCE_PERIOD > 0
        if self.began_amid:
            self.exclude(onset_ns - self._pulse_look_ahead_ns, onset_ns + self.memory_ns)

    def _in_sequence(self, onset_ns: int, sequence: int) -> bool:
        """Check sequence number and interval; return whether the pulse is a new one."""
        assert self._last_onset_ns is not None
        assert self._last_sequence is not None
        if onset_ns == self._last_onset_ns and sequence == self._last_sequence:
            self.counter.add(faults.PULSE_DUPLICATE)
            return False
        if onset_ns - self._last_onset_ns < _CLOSEST_NS:
            self.counter.add(faults.PULSE_TOO_CLOSE)
            self.exclude(onset_ns, onset_ns + self.memory_ns)
            return False
        step = (sequence - self._last_sequence) % SEQUENCE_PERIOD
        missing_from_ns = max(self._last_onset_ns, onset_ns - self._pulse_look_ahead_ns)
        if step:
            self._counts = step <= SEQUENCE_PERIOD // 2
        elif self._counts:
            # of a relay that stamps anew, say: which of the two was given is not known
            self.counter.add(faults.PULSE_DUPLICATE)
            self.exclude(missing_from_ns, onset_ns + self.memory_ns)
            return False
        if step == 0:
            self.counter.add(faults.PULSE_SEQUENCE_STUCK)
        elif step > SEQUENCE_PERIOD // 2:
            self.counter.add(faults.PULSE_SEQUENCE_RESTART)
            # the first ones of a driver that was started again may be lost as well
            if sequence or onset_ns - self._last_restart_ns < _RESTARTS_NS:
                self.exclude(missing_from_ns, onset_ns + self.memory_ns)
            self._last_restart_ns = onset_ns
        elif step > 1:
            self.counter.add(faults.PULSE_LOST, step - 1)
            self.exclude(missing_from_ns, onset_ns + self.memory_ns)
        return True


# A stray pulse counts as late when the force has gone on at least this long [ns].
_PATIENCE_NS = NANOSECONDS_PER_SECOND
_MOST_STRAYS = 1000


class StrayPulses:
    """Keeps stray pulses until the force shows whether the clock has jumped; else they are late.

    The result does not depend on how the stream is cut into blocks.

    Parameters
    ----------
    overtaking_ns : int
        How long before the force a pulse of a new time line may arrive [ns].
    counter : FaultCounter
        Where those that are late are counted.
    """

    def __init__(self, overtaking_ns: int, counter: FaultCounter) -> None:
        self._overtaking_ns = overtaking_ns
        self._counter = counter
        self._kept: list[tuple[int, PulseTrain]] = []

    def add(self, pulses: PulseTrain, newest_ns: int) -> None:
        """Keep pulses that arrived when the newest force was at `newest_ns`; they may be none."""
        if not len(pulses):
            return
        self._count(len(pulses), newest_ns)
        self._kept = self._overtaking(newest_ns)
        room = _MOST_STRAYS - sum(len(train) for _, train in self._kept)
        if len(pulses[:room]):
            self._kept.append((newest_ns, pulses[:room]))

    def taken(self, newest_ns: int) -> PulseTrain:
        """Return the pulses that arrived just before the clock jumped; the others are late."""
        recent, self._kept = self._overtaking(newest_ns), []
        for since_ns, train in recent:
            self._count(-len(train), since_ns)
        return PulseTrain.joined([PulseTrain.of([]), *(train for _, train in recent)])

    def _overtaking(self, newest_ns: int) -> list[tuple[int, PulseTrain]]:
        return [one for one in self._kept if one[0] >= newest_ns - self._overtaking_ns]

    def _count(self, count: int, since_ns: int) -> None:
        """Count pulses as late, from when on the clock can no longer have jumped."""
        patience_ns = max(_PATIENCE_NS, self._overtaking_ns)
        self._counter.postpone(faults.PULSE_LATE, since_ns + patience_ns + 1, count)


# Longest pause of the force that does not count as a gap [ns].
GAP_NS = NANOSECONDS_PER_SECOND
# Most samples that may wait: a block of the batch at 100 kHz, and the delays before and after it.
MOST_WAITING = 600_000
# So many samples out of order within this time are treated as a fault that lasts [1], [ns].
_DISORDER = 3
_DISORDER_NS = NANOSECONDS_PER_SECOND


class ForceIntake:
    """Takes samples in the order of arrival and keeps them, with rising stamps, until processed.

    Samples that are not finite, larger than a limit, repeated or stamped wrongly are dropped and
    counted; a stamp far from its predecessor is accepted when a second one follows it.

    Parameters
    ----------
    pulses : PulseQueue
        Learns what time is excluded: there pulses may act of which nobody knows.
    reorder_delay_ns : int
        How long a sample waits [ns].
    largest_force : float
        Larger ones are dropped [N].
    jumped : callable
        Called with the newest stamp of the old time line and the first of a new one [ns], before
        samples of it are kept.
    """

    def __init__(
        self,
        pulses: PulseQueue,
        reorder_delay_ns: int,
        largest_force: float,
        jumped: Callable[[int, int], None],
    ) -> None:
        self._pulses, self._jumped = pulses, jumped
        self._reorder_delay_ns = reorder_delay_ns
        self._largest_force = largest_force
        self._waiting: list[tuple[IntArray, FloatArray]] = []
        self._count = 0
        self.newest_ns: int | None = None
        self._newest_force = 0.0
        # a sample that waits for another one to confirm its stamp
        self.alone: tuple[int, float] | None = None
        self._out_of_order: deque[int] = deque(maxlen=_DISORDER)

    def add(self, forces: ForceTrace) -> None:
        """Add force samples; bad ones are dropped and counted."""
        finite = np.isfinite(forces.force)
        bad = ~self.believes(forces.force)
        start = 0
        for place in (*np.flatnonzero(bad).tolist(), len(bad)):
            if place > start:
                self._take(forces.stamp_ns[start:place], forces.force[start:place])
            if place < len(bad):
                name = faults.FORCE_OUT_OF_BOUNDS if finite[place] else faults.FORCE_NOT_FINITE
                self._postpone(name)
            start = place + 1

    def believes(self, force: FloatArray) -> BoolArray:
        """Return which values (samples,) can be forces."""
        with np.errstate(invalid='ignore'):
            believed: BoolArray = np.abs(force) <= self._largest_force
        return believed

    @property
    def first_ns(self) -> int | None:
        """Stamp of the first sample that waits [ns]."""
        return int(self._waiting[0][0][0]) if self._waiting else None

    def take(self, until_ns: int) -> tuple[IntArray, FloatArray, int]:
        """Return all waiting samples (samples,), and how many have stamps up to `until_ns` [ns].

        The latter are removed; some have to wait.
        """
        stamps = np.concatenate([stamps for stamps, _ in self._waiting])
        values = np.concatenate([values for _, values in self._waiting])
        due = int(np.searchsorted(stamps, until_ns, side='right'))
        self._waiting = [(stamps[due:], values[due:])] if due < len(stamps) else []
        self._count = len(stamps) - due
        return stamps, values, due

    def drop_alone(self) -> None:
        """Drop the sample whose stamp was not confirmed."""
        if self.alone is not None:
            self._postpone(faults.FORCE_STAMP_ALONE)
            self.alone = None

    def exclude(self, start_ns: int, end_ns: int) -> None:
        """Do not learn from samples after `start_ns` up to `end_ns` that are not yet due.

        Samples are due `reorder_delay` before the newest one.  Due samples that wait all the same
        are learnt from, so that the result does not depend on when the stream is advanced.
        """
        if self.newest_ns is not None:
            start_ns = max(start_ns, self.newest_ns - self._reorder_delay_ns)
        if start_ns < end_ns:
            self._pulses.exclude(start_ns, end_ns)

    def _postpone(self, name: str) -> None:
        """Count a fault when the samples up to the newest one are processed."""
        self._pulses.counter.postpone(name, self.newest_ns)

    def _take(self, stamps: IntArray, values: FloatArray) -> None:
        """Take samples (samples,) of possible values, with stamps of any kind."""
        steps = np.diff(stamps)
        ends = np.append(np.flatnonzero((steps <= 0) | (steps > GAP_NS)) + 1, len(stamps))
        start = 0
        while start < len(stamps):
            if not self._goes_on(int(stamps[start]), float(values[start])):
                start += 1
                continue
            end = int(ends[np.searchsorted(ends, start, side='right')])
            self._keep(stamps[start:end], values[start:end])
            start = end

    def _goes_on(self, stamp_ns: int, value: float) -> bool:
        """Return whether a sample continues the time line."""
        if self.newest_ns is None:
            return True
        step = stamp_ns - self.newest_ns
        if -GAP_NS <= step <= 0:
            self._refuse(self.newest_ns, step, value)
            return False
        if abs(step) > GAP_NS and not self._follow_alone(self.newest_ns, stamp_ns, value):
            return False
        self.drop_alone()
        return True

    def _keep(self, stamps: IntArray, values: FloatArray) -> None:
        room = MOST_WAITING - self._count
        for _ in range(len(stamps) - room):
            self._postpone(faults.FORCE_QUEUE_FULL)
        if room > 0:
            self._waiting.append((stamps[:room], values[:room]))
            self._count += len(stamps[:room])
        self.newest_ns = int(stamps[-1])
        self._newest_force = float(values[-1])

    def _refuse(self, newest_ns: int, step: int, value: float) -> None:
        """Count a sample that is stamped like or before its predecessor."""
        if step == 0 and value == self._newest_force:
            self._postpone(faults.FORCE_DUPLICATE)
            return
        if step == 0:
            self._postpone(faults.FORCE_CONFLICT)
            self.exclude(newest_ns - 1, newest_ns)
        else:
            self._postpone(faults.FORCE_STAMP_NOT_AFTER_LAST)
        self._out_of_order.append(newest_ns)
        first_ns = self._out_of_order[0]
        if len(self._out_of_order) == _DISORDER and newest_ns - first_ns <= _DISORDER_NS:
            self.exclude(first_ns - 1, newest_ns + self._pulses.memory_ns)

    def _follow_alone(self, newest_ns: int, stamp_ns: int, value: float) -> bool:
        """Accept a stamp far from its predecessor when a second one follows it.

        Otherwise one wrong stamp would count as two jumps of the clock.  Returns whether
        `stamp_ns` confirms the sample that is waiting alone; if not, it waits in its place.
        """
        if self.alone is None or not 0 < stamp_ns - self.alone[0] <= GAP_NS:
            self.drop_alone()
            self.alone = (stamp_ns, value)
            return False
        (first_ns, first), self.alone = self.alone, None
        if first_ns < newest_ns:
            self._jumped(newest_ns, first_ns)
        else:
            # unknown pulses may have been given during the gap
            self._postpone(faults.FORCE_GAP)
            self.exclude(newest_ns, first_ns + self._pulses.memory_ns)
        self._out_of_order.clear()
        self._keep(np.array([first_ns]), np.array([first]))
        return True


# Above a rounding error or an offset of shares, up to the maximum in per cent.
_PERCENT = (2.0, 100.0)


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
    return ~((intensity >= 0.0) & (intensity <= 1.0))


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
