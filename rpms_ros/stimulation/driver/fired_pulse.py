# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One pulse as listeners are told of it.

A hash of pulses that were given, one after the other: a driver's and a recording's agree.
"""

import hashlib
import struct
import threading
from dataclasses import dataclass

import numpy as np

from rpms_ros.pulses import Pulse, PulseTrain
from rpms_ros.stimulation.devices.registry import Delivery


@dataclass(frozen=True)
class Fired:
    """One pulse whose trigger was sent to the device.

    Attributes
    ----------
    due_ns : int
        When the schedule wanted it, monotonic clock [ns].
    intensity : float
        What was commanded (share).
    width_s : float
        Duration [s].
    sequence : int
        Counts the commanded pulses.
    delivery : Delivery or None
        What the device says it did; all of it unverified if the device did not answer; None if it
        says that no pulse came.
    delivered_sequence : int
        Counts those with a delivery.
    answered : bool
        Whether the device answered.
    """

    due_ns: int
    intensity: float
    width_s: float
    sequence: int
    delivery: Delivery | None
    delivered_sequence: int
    answered: bool = True


# Onset [ns], intensity, number and width [s], little-endian.
_RECORD = struct.Struct('<qdqd')
_COLUMNS = np.dtype(
    [('onset_ns', '<i8'), ('intensity', '<f8'), ('sequence', '<i8'), ('width', '<f8')]
)
_SEQUENCES = 2**32


@dataclass(frozen=True)
class HashedPulses:
    """Pulses in a row.

    Attributes
    ----------
    count : int
        Number of them.
    first_ns : int
        Onset of the first [ns].
    sha256 : str
        Of onset, intensity, number and width of each, as hexadecimal digits.
    """

    count: int
    first_ns: int
    sha256: str


class PulseHash:
    """Collects pulses as they are given; any thread may call it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._begin()

    def _begin(self) -> None:
        self._digest = hashlib.sha256()
        self._count = self._first_ns = 0

    def add(self, pulse: Pulse) -> None:
        """Take the next pulse."""
        number = pulse.sequence % _SEQUENCES
        record = _RECORD.pack(pulse.onset_ns, pulse.intensity, number, pulse.width)
        with self._lock:
            if not self._count:
                self._first_ns = pulse.onset_ns
            self._count += 1
            self._digest.update(record)

    def taken(self) -> HashedPulses | None:
        """Return the pulses since the last call, None without any; the next begins anew."""
        with self._lock:
            if not self._count:
                return None
            found = HashedPulses(self._count, self._first_ns, self._digest.hexdigest())
            self._begin()
            return found


def hash_of(pulses: PulseTrain) -> str:
    """Return the hash that `PulseHash` has after the same pulses, as hexadecimal digits."""
    records = np.empty(len(pulses), _COLUMNS)
    for name in _COLUMNS.names or ():
        records[name] = getattr(pulses, name)
    records['sequence'] %= _SEQUENCES
    return hashlib.sha256(records.tobytes()).hexdigest()
