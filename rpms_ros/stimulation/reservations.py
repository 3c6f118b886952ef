# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses of a run are put into the dose ledger before they are fired.

How long it takes to put pulses on the disk is not known, so it is done by a thread of its own,
some pulses at a time; a pulse that is not there yet is not fired.
"""

import threading
from collections.abc import Sequence

from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation.dose import PlannedPulse
from rpms_ros.stimulation.dose_ledger import MemoryLedger
from rpms_ros.stimulation.limits import Limits
from rpms_ros.stimulation.run import Run


class Reservations:
    """The pulses of one run in a ledger.

    Parameters
    ----------
    ledger : MemoryLedger
        A dose ledger, on the disk or not.
    run : Run
        Whose pulses are reserved.
    limits : Limits
        What an intensity means in energy.
    ahead_s : float
        How far ahead [s].
    """

    def __init__(self, ledger: MemoryLedger, run: Run, limits: Limits, ahead_s: float) -> None:
        self._ledger = ledger
        self._run = run
        self._limits = limits
        self._ahead_ns = nanoseconds(ahead_s)
        self._lock = threading.Lock()
        # numbers in the ledger of the pulses that are reserved and not taken, by their index
        self._open: dict[int, int] = {}
        self._next = 0

    def extend(self, now_ns: int) -> None:
        """Reserve what is due soon [ns], or give back what is left when the run is over.

        Raises
        ------
        LedgerError
            If the ledger does not take it; `DoseExceeded` if it is more than the patient may get.
        """
        run = self._run
        with self._lock:
            if run.ended:
                left, self._open = list(self._open.values()), {}
                self._ledger.settle(left)
                return
            first, last = self._next, self._next
            # half of it at a time: few large writes instead of many small ones
            if first < run.count and run.onset_ns(first) > now_ns + self._ahead_ns // 2:
                return
            while last < run.count and run.onset_ns(last) <= now_ns + self._ahead_ns:
                last += 1
            if last == first:
                return
            energy = self._limits.energy_j
            pulses = [
                PlannedPulse(run.onset_ns(index), intensity, energy(intensity))
                for index, intensity in enumerate(run.intensities[first:last], first)
            ]
            self._open.update(enumerate(self._ledger.reserve(pulses), first))
            self._next = last

    def holds(self, index: int) -> bool:
        """Return whether a pulse of the run is reserved and not taken."""
        return index in self._open

    def count(self, pulses: Sequence[PlannedPulse]) -> None:
        """Count pulses that were given beside the run's; raises LedgerError as `extend` does."""
        self._ledger.count(pulses)

    def take(self, index: int) -> None:
        """Note that a pulse of the run is triggered now.

        Raises
        ------
        LedgerError
            If it is not reserved, or given back.
        """
        self._ledger.take(self._open.pop(index, -1))
