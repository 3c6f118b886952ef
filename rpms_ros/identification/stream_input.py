# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Takes pulses and force in any order, and marks the samples that are not learnt from."""

from abc import abstractmethod

import numpy as np

from rpms_ros.identification import faults
from rpms_ros.identification.far_pulses import FAR_NS
from rpms_ros.identification.faults import FaultCounter
from rpms_ros.identification.force_intake import ForceIntake
from rpms_ros.identification.postponed import PostponedFaults
from rpms_ros.identification.pulse_checks import Alignment
from rpms_ros.identification.pulse_queue import PulseQueue
from rpms_ros.identification.saved_state import RestorableWithSettings
from rpms_ros.identification.stray_pulses import StrayPulses
from rpms_ros.identification.stream_settings import StreamSettings
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain
from rpms_ros.pulses import nanoseconds

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

    def add_foreign(self, samples: int, onset_ns: IntArray) -> None:
        """Count messages of publishers that are not used, in the order of arrival.

        Nothing is learnt while pulses with these onsets (pulses,) may act, because it is not known
        whether they were given.
        """
        newest_ns = self._intake.newest_ns
        if samples:
            self._postponed.add(faults.FORCE_PUBLISHERS, newest_ns, samples)
        if len(onset_ns):
            self._postponed.add(faults.PULSE_PUBLISHERS, newest_ns, len(onset_ns))
        near_ns = onset_ns if newest_ns is None else onset_ns[onset_ns <= newest_ns + FAR_NS]
        for onset in near_ns.tolist():
            self.exclude(onset, onset + self._memory_ns)

    def add_foreign_between(self, stamp_ns: IntArray, before: IntArray) -> None:
        """Count samples of publishers that are not used, among samples that are added next.

        Parameters
        ----------
        stamp_ns : ndarray of int64 (samples,)
            Stamps of the samples that are used, without gaps or jumps.
        before : ndarray of int64 (others,)
            How many of them come before each of the others.
        """
        places, counts = np.unique(before, return_counts=True)
        for place, count in zip(places.tolist(), counts.tolist(), strict=True):
            after_ns = int(stamp_ns[place - 1]) if place else self._intake.newest_ns
            self._postponed.add(faults.FORCE_PUBLISHERS, after_ns, count)

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
