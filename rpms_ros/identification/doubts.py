# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Faults that make an estimate doubtful, because they affect too many of its samples."""

from collections import deque
from collections.abc import Mapping

from rpms_ros.identification import faults
from rpms_ros.identification.saved_state import Restorable

# Share of the samples above which the curve may be wrong by more than its interval.
SHARES: Mapping[str, float] = {
    faults.FORCE_NOT_FINITE: 0.1,
    faults.FORCE_OUT_OF_BOUNDS: 0.01,
    faults.FORCE_CONFLICT: 0.002,
    faults.FORCE_STAMP_NOT_AFTER_LAST: 0.01,
    faults.FORCE_STAMP_ALONE: 0.01,
    faults.FORCE_QUEUE_FULL: 0.01,
    faults.SAMPLES_EXCLUDED: 0.5,
}
# A share is taken of at least so many samples [1].
_LEAST_SAMPLES = 1000
# Counts that are kept, one a second [1].
_NOTES = 30


class Doubts(Restorable):
    """Keeps the shares of faults over the last half minute and over the whole session.

    Parameters
    ----------
    shares : mapping of str to float
        Largest share of the samples that each fault may have without a doubt.
    lasting : bool
        Whether a doubt stays until the end, as for an estimator that forgets nothing.
    """

    _notes: deque[tuple[int, dict[str, int]]]
    _found: set[str]

    def __init__(self, shares: Mapping[str, float], lasting: bool) -> None:
        self._shares = {**SHARES, **shares}
        self._lasting = lasting
        self._notes = deque([(0, {})], maxlen=_NOTES)
        self._found = set()

    def note(self, samples: int, counts: Mapping[str, int]) -> None:
        """Store the total counts after so many samples; to be called once a second."""
        if self._lasting:
            found = self.names(samples, counts)
            # what was not learnt from does no harm later
            self._found.update(name for name in found if name != faults.SAMPLES_EXCLUDED)
        self._notes.append((samples, dict(counts)))

    def names(self, samples: int, counts: Mapping[str, int]) -> tuple[str, ...]:
        """Return the faults whose share is too large, in the order of the counts."""
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
