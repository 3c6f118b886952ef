"""Pulses in any order in, pulses in the order of their onsets out, with what was lost named.

A pulse is *settled* when the force has come so far that an earlier one would be too late.  Only
settled pulses are compared with their predecessors, so the answer depends on stamps and
sequence numbers alone, not on the order or the moment of arrival.
"""

from collections import deque

import numpy as np

from rpms_ros.identification import faults
from rpms_ros.identification.faults import FaultCounter
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain

SEQUENCE_PERIOD = 2**32
_LONG_AGO = -(2**63)
_MANY_ARRIVALS = 1000
_KEPT_REJECTED = 100


class PulseQueue:
    """Orders pulses by onset and finds lost, late, doubled and unusable ones.

    Parameters
    ----------
    memory_ns : int
        How long a pulse acts on the force [ns].
    pulse_look_ahead_ns : int
        How far before a gap in the sequence is known samples are spared from it [ns].
    counter : FaultCounter
        Where faults are counted.
    """

    def __init__(self, memory_ns: int, pulse_look_ahead_ns: int, counter: FaultCounter) -> None:
        self._memory_ns = memory_ns
        self._pulse_look_ahead_ns = pulse_look_ahead_ns
        self._counter = counter
        self._arrived: list[PulseTrain] = []
        self._ordered = PulseTrain.of([])
        self._settled_ns = _LONG_AGO
        self._last_onset_ns: int | None = None
        self._last_sequence = 0
        self._unknown: list[tuple[int, int]] = []
        self._rejected: deque[tuple[int, PulseTrain]] = deque(maxlen=_KEPT_REJECTED)

    def add(self, pulses: PulseTrain) -> None:
        """Add pulses, in any order."""
        if not len(pulses):
            return
        late = pulses.onset_ns <= self._settled_ns
        for onset in pulses.onset_ns[late]:
            self._reject_late(int(onset))
        if late.any():
            self._rejected.append((self._settled_ns, pulses[late]))
        if not late.all():
            self._arrived.append(pulses[~late])
        if len(self._arrived) > _MANY_ARRIVALS:
            # No force comes: one array instead of many small ones.
            self._merge_arrived()

    def settle(self, until_ns: int) -> tuple[IntArray, FloatArray]:
        """Return the pulses with onsets up to `until_ns`, ascending, that can be used.

        Returns
        -------
        onset_ns : ndarray of int64, shape (pulses,)
            Onsets [ns].
        intensity : ndarray, shape (pulses,)
            Shares of the maximum, 0..1.
        """
        self._settled_ns = max(self._settled_ns, until_ns)
        self._merge_arrived()
        due = int(np.searchsorted(self._ordered.onset_ns, until_ns, side='right'))
        train, self._ordered = self._ordered[:due], self._ordered[due:]
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
        """Mark the span after `start_ns` up to `end_ns` as touched by unknown pulses."""
        self._unknown.append((start_ns, end_ns))

    def restart(self) -> None:
        """Forget everything but the sequence: the clock has jumped.

        Pulses that came too late just now may have been the first ones of the new time line,
        faster than its first force sample.
        """
        recent_ns = self._settled_ns - 2 * self._pulse_look_ahead_ns - self._memory_ns
        self._arrived = [train for since_ns, train in self._rejected if since_ns >= recent_ns]
        self._rejected.clear()
        self._ordered = PulseTrain.of([])
        self._unknown = []
        self._settled_ns = _LONG_AGO
        self._last_onset_ns = None

    def _merge_arrived(self) -> None:
        if self._arrived:
            self._ordered = _merge([self._ordered, *self._arrived])
            self._arrived = []

    def _reject_late(self, onset_ns: int) -> None:
        self._counter.add(faults.PULSE_LATE)
        self.exclude(onset_ns, onset_ns + self._memory_ns)

    def _accept(self, train: PulseTrain, index: int) -> bool:
        """Compare one pulse with the one before it; return whether it can be used."""
        onset = int(train.onset_ns[index])
        sequence = int(train.sequence[index])
        if self._last_onset_ns is not None and not self._in_sequence(onset, sequence):
            return False
        self._last_onset_ns = onset
        self._last_sequence = sequence
        if 0.0 <= train.intensity[index] <= 1.0:
            return True
        self._counter.add(faults.PULSE_INTENSITY_INVALID)
        self.exclude(onset, onset + self._memory_ns)
        return False

    def _in_sequence(self, onset_ns: int, sequence: int) -> bool:
        """Count what the sequence shows; return whether the pulse is a new one."""
        assert self._last_onset_ns is not None
        if onset_ns == self._last_onset_ns:
            self._counter.add(faults.PULSE_DUPLICATE)
            return False
        step = (sequence - self._last_sequence) % SEQUENCE_PERIOD
        if step == 0:
            self._counter.add(faults.PULSE_SEQUENCE_STUCK)
        elif step > SEQUENCE_PERIOD // 2:
            self._counter.add(faults.PULSE_SEQUENCE_RESTART)
        elif step > 1:
            self._counter.add(faults.PULSE_LOST, step - 1)
            start = max(self._last_onset_ns, onset_ns - self._pulse_look_ahead_ns)
            self.exclude(start, onset_ns + self._memory_ns)
        return True


def _merge(trains: list[PulseTrain]) -> PulseTrain:
    """Return all pulses ascending in onset, equal onsets by sequence and intensity."""
    train = PulseTrain.joined(trains)
    return train[np.lexsort((train.intensity, train.sequence, train.onset_ns))]
