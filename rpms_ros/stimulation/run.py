# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One run of a schedule: which pulse is next, and what was delivered."""

from dataclasses import dataclass

from rpms_ros.stimulation.schedule import Schedule

CAUSES = ('completed', 'incomplete', 'cancelled', 'limit', 'disarmed', 'stopped', 'fault')


@dataclass
class Run:
    """Progress of a schedule.

    Attributes
    ----------
    schedule : Schedule
        What is run.
    start_ns : int
        Its beginning on the driver's monotonic clock [ns].
    intensities : list of float
        Of its pulses, as the device can be set to them (share).
    cursor : int
        Index of the next pulse.
    delivered, dropped : int
        Pulses that the device says it gave, and that were not sent because they were late.
    energy_j : float
        Energy of the pulses that were sent [J].
    ended : str
        Why it is over; empty while it runs.
    cause : str
        The same in one word of `CAUSES`; empty while it runs.
    announced : bool
        Whether its first pulse may come: whoever has to know of it was told.
    """

    schedule: Schedule
    start_ns: int
    intensities: list[float]
    cursor: int = 0
    delivered: int = 0
    dropped: int = 0
    energy_j: float = 0.0
    ended: str = ''
    cause: str = ''
    announced: bool = False

    def __post_init__(self) -> None:
        # plain lists: an element of an array costs ten times as much, once a pulse
        plan = self.schedule.plan
        self._onset = plan.onset_ns.tolist()
        self._segment = plan.segment.tolist()

    @property
    def count(self) -> int:
        """Number of pulses of the schedule."""
        return len(self._onset)

    @property
    def exhausted(self) -> bool:
        """Whether no pulse is left."""
        return self.cursor >= self.count

    @property
    def end_ns(self) -> int:
        """When the schedule ends [ns]."""
        return self.start_ns + self.schedule.plan.duration_ns

    @property
    def due_ns(self) -> int:
        """When the next pulse is due, or the end if there is none [ns]."""
        return self.end_ns if self.exhausted else self.onset_ns(self.cursor)

    @property
    def intensity(self) -> float:
        """Intensity of the next pulse (share)."""
        return self.intensities[self.cursor]

    def onset_ns(self, index: int) -> int:
        """Return when a pulse of the schedule is due [ns]."""
        return self.start_ns + int(self._onset[index])

    def end(self, reason: str, cause: str) -> None:
        """Note why it is over; the first reason counts."""
        if not self.ended:
            self.ended, self.cause = reason, cause

    @property
    def segment(self) -> int:
        """Index of the segment of the next pulse; of the last one when none is left."""
        if self.exhausted:
            return len(self.schedule.segments) - 1
        return int(self._segment[self.cursor])

    def time_left_s(self, now_ns: int) -> float:
        """Return the time to the end of the schedule [s]."""
        return max(0.0, (self.end_ns - now_ns) / 1e9)

    @property
    def completed(self) -> bool:
        """Whether every pulse of the schedule was delivered."""
        return self.exhausted and self.delivered == self.count
