# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which faults put an estimate in doubt: those that concern more than a few of its samples."""

from collections import deque
from collections.abc import Mapping

from rpms_ros.identification import faults
from rpms_ros.identification.saved_state import Restorable

# Of the samples; more than that, and the curve may be wrong by more than its interval says.
SHARES: Mapping[str, float] = {
    faults.FORCE_NOT_FINITE: 0.1,
    faults.FORCE_OUT_OF_BOUNDS: 0.01,
    faults.FORCE_CONFLICT: 0.002,
    faults.FORCE_STAMP_NOT_AFTER_LAST: 0.01,
    faults.FORCE_STAMP_ALONE: 0.01,
    faults.FORCE_QUEUE_FULL: 0.01,
    faults.SAMPLES_EXCLUDED: 0.5,
}
# Fewer samples are not enough for a share [1].
_LEAST_SAMPLES = 1000
# How long the past counts, as many notes [1].
_NOTES = 30


class Doubts(Restorable):
    """Keeps the shares of faults over the last half minute and over all.

    Parameters
    ----------
    shares : mapping of str to float
        Largest share of the samples of each fault that is no reason to doubt.
    lasting : bool
        Whether a doubt stays for good, as it does where nothing is forgotten.
    """

    _notes: deque[tuple[int, dict[str, int]]]
    _found: set[str]

    def __init__(self, shares: Mapping[str, float], lasting: bool) -> None:
        self._shares = {**SHARES, **shares}
        self._lasting = lasting
        self._notes = deque([(0, {})], maxlen=_NOTES)
        self._found = set()

    def note(self, samples: int, counts: Mapping[str, int]) -> None:
        """Remember the counts (of all time) after so many samples; once a second is enough."""
        if self._lasting:
            self._found.update(self.names(samples, counts))
        self._notes.append((samples, dict(counts)))

    def names(self, samples: int, counts: Mapping[str, int]) -> tuple[str, ...]:
        """Return the faults that are reasons to doubt, in the order of the counts."""
        before, earlier = self._notes[0]
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
