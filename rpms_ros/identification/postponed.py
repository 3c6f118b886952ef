# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Faults that are counted when the samples before them are processed, not when they are found."""

from rpms_ros.identification.faults import FaultCounter
from rpms_ros.identification.saved_state import Restorable

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
