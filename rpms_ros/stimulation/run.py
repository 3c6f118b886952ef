"""One run of a schedule: which pulse is next, what became of those before."""

from dataclasses import dataclass

from rpms_ros.stimulation.schedule import Schedule


@dataclass
class Run:
    """Progress of a schedule.

    Attributes
    ----------
    schedule : Schedule
        What is run.
    start_ns : int
        Its beginning on the driver's monotonic clock [ns].
    cursor : int
        Index of the next pulse.
    delivered, dropped : int
        Pulses that the device gave, and that were too late to be sent.
    energy_j : float
        Energy of the pulses that were sent [J].
    ended : str
        Why it is over; empty while it runs.
    """

    schedule: Schedule
    start_ns: int
    cursor: int = 0
    delivered: int = 0
    dropped: int = 0
    energy_j: float = 0.0
    ended: str = ''

    def __post_init__(self) -> None:
        # plain lists: an element of an array costs ten times as much, once a pulse
        plan = self.schedule.plan
        self._onset = plan.onset_ns.tolist()
        self._intensity = plan.intensity.tolist()
        self._segment = plan.segment.tolist()

    @property
    def exhausted(self) -> bool:
        """Whether no pulse is left."""
        return self.cursor >= len(self._onset)

    @property
    def end_ns(self) -> int:
        """When the schedule ends [ns]."""
        return self.start_ns + self.schedule.plan.duration_ns

    @property
    def due_ns(self) -> int:
        """When the next pulse is due, or the end if there is none [ns]."""
        return self.end_ns if self.exhausted else self.start_ns + int(self._onset[self.cursor])

    @property
    def intensity(self) -> float:
        """Intensity of the next pulse (share)."""
        return float(self._intensity[self.cursor])

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
        return self.exhausted and self.delivered == len(self._onset)
