# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Takes pulses and force in any order, and marks the samples that are not learnt from.

Settings of the alignment of samples and pulses.

Faults that are counted when the samples before them are processed, not when they are found.

Pulses stamped long before the force: late, or the first ones after a clock has jumped back.
"""

import math
from abc import abstractmethod
from collections import deque
from dataclasses import dataclass

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.stream import faults
from rpms_ros.identification.stream.faults import FaultCounter
from rpms_ros.identification.stream.force_intake import ForceIntake
from rpms_ros.identification.stream.pulse_checks import Alignment
from rpms_ros.identification.stream.pulse_queue import FAR_NS, PulseQueue
from rpms_ros.identification.stream.sensor_checks import MONITORS
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, ForceTrace, IntArray, PulseTrain, nanoseconds
from rpms_ros.saved_state import Restorable, RestorableWithSettings

LARGEST_FORCE = 10_000.0
"""No muscle and no sensor for people reaches it [N]."""


@dataclass(frozen=True)
class StreamSettings:
    """Settings of the alignment of samples and pulses.

    Attributes
    ----------
    reorder_delay : float
        How long a sample waits for late pulses, and for the samples after it that show whether it
        is an outlier [s]; below 20 ms samples are not checked before they are learnt from.
    pulse_look_ahead : float
        Up to this time after a sample pulses are checked before it is used [s]; a pulse may be
        late by the rest of `reorder_delay`.
    estimate_period : float
        Time between two estimates, by the stamps [s].
    longest_gap : float
        Longest pause of the force that does not count as a gap [s].
    largest_force : float
        Samples with a larger force, of either sign, are dropped [N].
    monitors : tuple of str
        Names of the monitors, of `rpms_ros.identification.stream.sensor_checks` or of other
        packages.

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    reorder_delay: float = 0.2
    pulse_look_ahead: float = 0.1
    estimate_period: float = 0.1
    longest_gap: float = 1.0
    largest_force: float = LARGEST_FORCE
    monitors: tuple[str, ...] = tuple(MONITORS)

    def __post_init__(self) -> None:
        if not 0 <= self.pulse_look_ahead <= self.reorder_delay < math.inf:
            raise IdentificationError(
                'expected 0 <= pulse_look_ahead <= reorder_delay, got '
                f'{self.pulse_look_ahead} and {self.reorder_delay}'
            )
        if not (0 < self.estimate_period < math.inf and 0 < self.longest_gap < math.inf):
            raise IdentificationError(
                'expected an estimate period and a longest gap above 0 s, got '
                f'{self.estimate_period} and {self.longest_gap}'
            )
        if not 0 < self.largest_force < math.inf:
            raise IdentificationError(
                f'expected a largest force above 0 N, got {self.largest_force}'
            )


_LONG_AGO = -(2**63)


class PostponedFaults(Restorable):
    """Faults by the stamp after which they were found.

    Parameters
    ----------
    counter : FaultCounter
        Where they are counted.
    """

    _waiting: dict[tuple[int, str], int]

    def __init__(self, counter: FaultCounter) -> None:
        self._counter = counter
        self._waiting = {}

    def add(self, name: str, after_ns: int | None, count: int = 1) -> None:
        """Keep faults that were found after a stamp; None: before the first."""
        key = (_LONG_AGO if after_ns is None else after_ns, name)
        self._waiting[key] = self._waiting.get(key, 0) + count

    def add_now(self, name: str, count: int) -> None:
        """Count faults at once."""
        self._counter.add(name, count)

    def count(self, until_ns: int | None) -> None:
        """Count what was found after stamps up to `until_ns`; None: everything."""
        for key in [key for key in self._waiting if until_ns is None or key[0] <= until_ns]:
            self._counter.add(key[1], self._waiting.pop(key))

    def counts(self) -> dict[str, int]:
        """Return all counts so far, those not yet due included."""
        total = self._counter.copy()
        for (_, name), count in self._waiting.items():
            total.add(name, count)
        return total.counts()


# A stray pulse counts as late when the force has gone on at least this long [ns].
_PATIENCE_NS = NANOSECONDS_PER_SECOND
_MOST = 1000


class StrayPulses(Restorable):
    """Keeps stray pulses until the force shows whether the clock has jumped.

    The result does not depend on how the stream is cut into blocks.

    Parameters
    ----------
    overtaking_ns : int
        How long before the force a pulse of a new time line may arrive [ns].
    """

    _kept: deque[tuple[int, PulseTrain]]
    _count: int
    _late: deque[tuple[int, int]]

    def __init__(self, overtaking_ns: int) -> None:
        self._overtaking_ns = overtaking_ns
        # While a pulse may be of a new time line, it is not late.
        self._patience_ns = max(_PATIENCE_NS, overtaking_ns)
        self._kept = deque()
        self._count = 0
        self._late = deque()

    def add(self, pulses: PulseTrain, newest_ns: int) -> None:
        """Keep pulses that arrived when the newest force was at `newest_ns`; they may be none."""
        if not len(pulses):
            return
        while self._kept and self._kept[0][0] + self._overtaking_ns < newest_ns:
            self._count -= len(self._kept.popleft()[1])
        kept = pulses[: max(_MOST - self._count, 0)]
        if len(kept):
            self._kept.append((newest_ns, kept))
            self._count += len(kept)
        before = self._late.pop()[1] if self._late and self._late[-1][0] == newest_ns else 0
        self._late.append((newest_ns, before + len(pulses)))

    def taken(self, newest_ns: int) -> PulseTrain:
        """Return the pulses that arrived just before the clock jumped; the others are late."""
        kept, self._kept, self._count = self._kept, deque(), 0
        recent = [one for one in kept if one[0] >= newest_ns - self._overtaking_ns]
        late = dict(self._late)
        for since, train in recent:
            late[since] -= len(train)
        self._late = deque(late.items())
        return PulseTrain.joined([PulseTrain.of([]), *(train for _, train in recent)])

    def given_up(self, until_ns: int | None) -> int:
        """Return how many are late, now that the force has come to `until_ns` [ns].

        None: the session ends.
        """
        count = 0
        while self._late and (until_ns is None or self._late[0][0] + self._patience_ns < until_ns):
            count += self._late.popleft()[1]
        if until_ns is None:
            self._kept, self._count = deque(), 0
        return count


# Earlier than any stamp [ns].
_BEFORE_ALL = -(2**63)


class StreamInput(RestorableWithSettings):
    """Keeps pulses and samples until they are processed, and counts their faults.

    Parameters
    ----------
    settings : StreamSettings
        Waiting times and bounds.
    memory : float
        How long a pulse acts on the force [s].
    counter : FaultCounter
        Counts the faults.
    """

    _counter: FaultCounter
    _queue: PulseQueue
    _strays: StrayPulses
    _postponed: PostponedFaults
    _intake: ForceIntake
    _alignment: Alignment
    # samples after this stamp are predicted and not learnt from [ns]
    _held_ns: int | None

    def __init__(self, settings: StreamSettings, memory: float, counter: FaultCounter) -> None:
        self.settings = settings
        self._counter = counter
        self._memory_ns = nanoseconds(memory)
        self._reorder_delay_ns = nanoseconds(settings.reorder_delay)
        self._pulse_look_ahead_ns = nanoseconds(settings.pulse_look_ahead)
        self._queue = PulseQueue(self._memory_ns, self._pulse_look_ahead_ns, counter)
        self._strays = StrayPulses(2 * self._pulse_look_ahead_ns + self._memory_ns)
        self._postponed = PostponedFaults(counter)
        longest_gap_ns = nanoseconds(settings.longest_gap)
        self._intake = ForceIntake(self, longest_gap_ns, self._memory_ns, settings.largest_force)
        self._held_ns = None

    @property
    def held(self) -> bool:
        """Whether `hold` was called: samples are predicted only."""
        return self._held_ns is not None

    @property
    def fault_counts(self) -> dict[str, int]:
        """Counts of faults so far by name, those of waiting samples included."""
        return self._postponed.counts()

    def add_pulses(self, pulses: PulseTrain) -> None:
        """Add pulses, in any order, valid or not."""
        newest_ns = self._intake.newest_ns
        if newest_ns is None or not len(pulses):
            self._queue.add(pulses)
            return
        used_ns = newest_ns - self._reorder_delay_ns
        late = pulses.onset_ns <= used_ns + self._pulse_look_ahead_ns
        apart = late | (pulses.onset_ns > newest_ns + FAR_NS)
        self._alignment.arrived_apart(pulses.onset_ns[apart], newest_ns)
        self._queue.add(pulses[~late], newest_ns)
        # Far too late for this time line; they belong to the next one if the clock has jumped.
        stray = pulses.onset_ns < newest_ns - self._intake.gap_ns
        self._strays.add(pulses[stray], newest_ns)
        for onset_ns in pulses.onset_ns[late & ~stray].tolist():
            self._postponed.add(faults.PULSE_LATE, newest_ns)
            self.exclude(onset_ns, onset_ns + self._memory_ns)

    def hold(self) -> None:
        """Predict without learning, from the sample after the newest one on."""
        if self._held_ns is None:
            newest_ns = self._intake.newest_ns
            self._held_ns = _BEFORE_ALL if newest_ns is None else newest_ns

    def resume(self) -> None:
        """Learn again as soon as the pulses given meanwhile no longer act."""
        held_ns, newest_ns = self._held_ns, self._intake.newest_ns
        self._held_ns = None
        if held_ns is not None and newest_ns is not None:
            self.exclude(held_ns, newest_ns + self._memory_ns)

    def takes_early(self, pulses: PulseTrain, forces: ForceTrace, before: IntArray) -> bool:
        """Return whether pulses may be added before samples that arrived before them.

        They may if the forces (samples,) can be forces and have no gap or jump, and no pulse is
        late or far; `before` (pulses,) is how many of the samples arrived before each pulse.
        """
        newest_ns, stamp_ns = self._intake.newest_ns, forces.stamp_ns
        if not self._intake.believes(forces.force).all():
            return False
        if newest_ns is None and len(pulses):
            # There is room for so many before the first sample.
            return False
        line = stamp_ns if newest_ns is None else np.append(newest_ns, stamp_ns)
        steps = np.diff(line)
        if self._intake.in_doubt or not ((steps > 0) & (steps <= self._intake.gap_ns)).all():
            return False
        if not (pulses.onset_ns <= line[0] + FAR_NS).all():
            return False
        used_ns = line[before] - self._reorder_delay_ns
        return bool((pulses.onset_ns > used_ns + self._pulse_look_ahead_ns).all())

    def add_forces(self, forces: ForceTrace) -> None:
        """Add force samples; bad ones are dropped and counted."""
        self._intake.add(forces)

    def postpone(self, name: str) -> None:
        """Count a fault when the samples up to the newest one are processed."""
        self._postponed.add(name, self._intake.newest_ns)

    def exclude(self, start_ns: int, end_ns: int) -> None:
        """Do not learn from samples after `start_ns` up to `end_ns` that are not yet due.

        Samples are due `reorder_delay` before the newest one.  Due samples that wait all the same
        are learnt from, so that the result does not depend on when `advance` is called.
        """
        if self._intake.newest_ns is not None:
            start_ns = max(start_ns, self._intake.newest_ns - self._reorder_delay_ns)
        if start_ns < end_ns:
            self._queue.exclude(start_ns, end_ns)

    def meet_gap(self, until_ns: int) -> None:
        """Continue after a gap, during which unknown pulses may have been given."""
        self.postpone(faults.FORCE_GAP)
        assert self._intake.newest_ns is not None
        self.exclude(self._intake.newest_ns, until_ns + self._memory_ns)

    @abstractmethod
    def jump_back(self, stamp_ns: int) -> None:
        """Process the waiting samples, then continue from an earlier stamp."""
