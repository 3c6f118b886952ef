# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Queue that orders pulses by onset and counts lost, repeated and unusable ones.

A pulse is *settled* when the force has come so far that an earlier one would be too late.  Only
settled pulses are compared with their predecessors, so the result depends on stamps and
sequence numbers alone, not on the order or the time of arrival.
"""

import numpy as np

from rpms_ros.identification import faults
from rpms_ros.identification.far_pulses import FarPulses
from rpms_ros.identification.faults import FaultCounter
from rpms_ros.identification.pulse_room import PulseRoom
from rpms_ros.identification.saved_state import Restorable
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain

SEQUENCE_PERIOD = 2**32
LONG_AGO = -(2**63)
_MANY_ARRIVALS = 1000
# Pulses with onsets in one second: twice of what stimulators could give, which are 0.2 ms apart.
MOST_IN_A_SECOND = 10_000
# Pulses closer than this do not come from one stimulator [ns].
_CLOSEST_NS = 200_000
# The topic of the pulses may be found so much later than that of the force [ns].
_FOUND_WITHIN_NS = 2_000_000_000
# A second restart of the sequence within this time is not a restart of the driver [ns].
_RESTARTS_NS = 10_000_000_000


class PulseQueue(Restorable):
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

    _arrived: list[PulseTrain]
    _ordered: PulseTrain
    _far: FarPulses
    _room: PulseRoom
    _begun_ns: int | None
    _last_onset_ns: int | None
    _last_sequence: int | None
    _last_restart_ns: int
    _unknown: list[tuple[int, int]]

    def __init__(self, memory_ns: int, pulse_look_ahead_ns: int, counter: FaultCounter) -> None:
        self._memory_ns = memory_ns
        self._pulse_look_ahead_ns = pulse_look_ahead_ns
        self._counter = counter
        self._arrived = []
        self._ordered = PulseTrain.of([])
        self._far = FarPulses()
        self._room = PulseRoom(MOST_IN_A_SECOND)
        self._begun_ns = None
        self._last_onset_ns = None
        self._last_sequence = None
        self._last_restart_ns = LONG_AGO
        self._unknown = []

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

    def begin(self, stamp_ns: int) -> None:
        """Take the stamp of the first sample of the stream [ns]."""
        self._begun_ns = stamp_ns

    def settle(self, until_ns: int, cell_ns: int | None = None) -> tuple[IntArray, FloatArray]:
        """Return the pulses with onsets up to `until_ns`, ascending, that can be used.

        Parameters
        ----------
        until_ns : int
            How far pulses are settled [ns].
        cell_ns : int or None
            The same at the beginning of the present cell of the grid of stamps [ns]: far pulses
            are examined once a cell, however it is cut into blocks.  None: as `until_ns`.

        Returns
        -------
        onset_ns : ndarray of int64, shape (pulses,)
            Onsets [ns].
        intensity : ndarray, shape (pulses,)
            Shares of the maximum, 0..1.
        """
        begun_ns = until_ns if cell_ns is None else cell_ns
        come_near, given_up = self._far.come_near(begun_ns)
        self._counter.add(faults.PULSE_FAR_AHEAD, given_up)
        self._counter.add(faults.PULSE_TOO_CLOSE, self._room.refused(begun_ns))
        self._arrived += come_near
        self._merge_arrived()
        due = int(np.searchsorted(self._ordered.onset_ns, until_ns, side='right'))
        train, self._ordered = self._ordered[:due], self._ordered[due:]
        if self._regular(train):
            self._last_onset_ns = int(train.onset_ns[-1])
            self._last_sequence = int(train.sequence[-1])
            return train.onset_ns, train.intensity
        kept = np.array([self._accept(train, index) for index in range(due)], dtype=np.bool_)
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

    def restart(self) -> None:
        """Forget everything but the sequence number: the clock has jumped."""
        self._arrived = []
        self._ordered = PulseTrain.of([])
        self._far = FarPulses()
        self._room = PulseRoom(MOST_IN_A_SECOND)
        self._unknown = []
        self._last_onset_ns = None
        self._last_restart_ns = LONG_AGO

    def _merge_arrived(self) -> None:
        if self._arrived:
            self._ordered = _merge([self._ordered, *self._arrived])
            self._arrived = []

    def _regular(self, train: PulseTrain) -> bool:
        """Return whether there are pulses and every one follows on the one before it."""
        if not len(train) or self._last_sequence is None or self._last_onset_ns is None:
            return False
        onset_ns = np.append(self._last_onset_ns, train.onset_ns)
        sequence = np.append(self._last_sequence, train.sequence)
        apart = (np.diff(onset_ns) >= _CLOSEST_NS) & (np.diff(sequence) == 1)
        return bool(np.all(apart & (train.intensity >= 0.0) & (train.intensity <= 1.0)))

    def _accept(self, train: PulseTrain, index: int) -> bool:
        """Compare one pulse with the one before it; return whether it can be used."""
        onset = int(train.onset_ns[index])
        sequence = int(train.sequence[index])
        if self._last_sequence is None:
            self._look_before(onset, sequence)
        elif self._last_onset_ns is not None and not self._in_sequence(onset, sequence):
            return False
        self._last_onset_ns = onset
        self._last_sequence = sequence
        if 0.0 <= train.intensity[index] <= 1.0:
            return True
        self._counter.add(faults.PULSE_INTENSITY_INVALID)
        self.exclude(onset, onset + self._memory_ns)
        return False

    def _look_before(self, onset_ns: int, sequence: int) -> None:
        """Exclude what earlier pulses may act on, if the first one that is heard is not number 0.

        The stream began amid stimulation, or pulses were lost before the first one was heard.
        After a rest in which the force was heard none acts.
        """
        known_ns = self._memory_ns + _FOUND_WITHIN_NS
        rested = self._begun_ns is not None and onset_ns - self._begun_ns > known_ns
        if sequence % SEQUENCE_PERIOD and not rested:
            self.exclude(onset_ns - self._pulse_look_ahead_ns, onset_ns + self._memory_ns)

    def _in_sequence(self, onset_ns: int, sequence: int) -> bool:
        """Check sequence number and interval; return whether the pulse is a new one."""
        assert self._last_onset_ns is not None
        assert self._last_sequence is not None
        if onset_ns == self._last_onset_ns and sequence == self._last_sequence:
            self._counter.add(faults.PULSE_DUPLICATE)
            return False
        if onset_ns - self._last_onset_ns < _CLOSEST_NS:
            self._counter.add(faults.PULSE_TOO_CLOSE)
            self.exclude(onset_ns, onset_ns + self._memory_ns)
            return False
        step = (sequence - self._last_sequence) % SEQUENCE_PERIOD
        missing_from_ns = max(self._last_onset_ns, onset_ns - self._pulse_look_ahead_ns)
        if step == 0:
            self._counter.add(faults.PULSE_SEQUENCE_STUCK)
        elif step > SEQUENCE_PERIOD // 2:
            self._counter.add(faults.PULSE_SEQUENCE_RESTART)
            if onset_ns - self._last_restart_ns < _RESTARTS_NS:
                self.exclude(missing_from_ns, onset_ns + self._memory_ns)
            self._last_restart_ns = onset_ns
        elif step > 1:
            self._counter.add(faults.PULSE_LOST, step - 1)
            self.exclude(missing_from_ns, onset_ns + self._memory_ns)
        return True


def _merge(trains: list[PulseTrain]) -> PulseTrain:
    """Return all pulses ascending in onset, equal onsets by sequence and intensity."""
    train = PulseTrain.joined(trains)
    return train[np.lexsort((train.intensity, train.sequence, train.onset_ns))]
