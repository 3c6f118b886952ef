# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The state machine of a driver: which command is legal in which state, and where it leads.

A stop is latched beside the state, because it has to work in every one of them: it takes the
state to where no pulse is possible and keeps it from being armed until it is reset.

Beside it: one run of a schedule, its pulses in the dose ledger and as they were fired, and the
settings that belong to neither a schedule nor a device.
"""

import enum
import threading
from dataclasses import dataclass

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, nanoseconds
from rpms_ros.stimulation.devices.registry import Delivery
from rpms_ros.stimulation.limits.limiter import BookedPulse, Limits
from rpms_ros.stimulation.records.dose_ledger import MemoryLedger
from rpms_ros.stimulation.schedule.fields import Bound, Bounded, bounded
from rpms_ros.stimulation.schedule.schedule import Schedule


class State(enum.Enum):
    """Where a driver is; values as in rpms_msgs/DriverStatus."""

    UNCONFIGURED = 0
    DISARMED = 1
    ARMED = 2
    RUNNING = 3
    FAULT = 5


class Command(enum.Enum):
    """What may be asked of a driver, or happen to it."""

    CONFIGURE = 'configure'
    ARM = 'arm'
    START = 'start'
    FINISH = 'finish'
    DISARM = 'disarm'
    CLEANUP = 'cleanup'
    FAIL = 'fail'
    STOP = 'stop'


TRANSITIONS: dict[tuple[State, Command], State] = {
    (State.UNCONFIGURED, Command.CONFIGURE): State.DISARMED,
    (State.DISARMED, Command.ARM): State.ARMED,
    (State.ARMED, Command.START): State.RUNNING,
    (State.RUNNING, Command.FINISH): State.DISARMED,
}
POSSIBLE = (State.ARMED, State.RUNNING)
"""States in which a pulse is possible."""
for _state in State:
    # what makes pulses impossible is legal everywhere; no device is open when unconfigured, so
    # there is no fault to clean up
    _safe = State.DISARMED if _state in POSSIBLE else _state
    _failed = _state if _state is State.UNCONFIGURED else State.FAULT
    TRANSITIONS[_state, Command.DISARM] = TRANSITIONS[_state, Command.STOP] = _safe
    TRANSITIONS[_state, Command.FAIL] = _failed
    TRANSITIONS[_state, Command.CLEANUP] = State.UNCONFIGURED
"""Every legal transition; any other pair is refused and changes nothing."""


def after(state: State, command: Command) -> State:
    """Return the state that ``command`` leads to from ``state``.

    Raises
    ------
    StimulationError
        If the command is not legal there.
    """
    found = TRANSITIONS.get((state, command))
    if found is None:
        legal = sorted(source.name for source, what in TRANSITIONS if what is command)
        raise StimulationError(
            f'{command.value}: expected state {" or ".join(legal)}, got {state.name}'
        )
    return found


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
        The same in one word: completed, incomplete, cancelled, limit, disarmed, stopped or fault;
        empty while it runs.
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
            self.ended, self.cause = reason or cause, cause

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
    """

    due_ns: int
    intensity: float
    width_s: float
    sequence: int
    delivery: Delivery | None
    delivered_sequence: int


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
        self._ledger, self._run, self._limits = ledger, run, limits
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
                left = [self._open.pop(index, None) for index in [*self._open]]
                self._ledger.settle(number for number in left if number is not None)
                return
            first, last = self._next, self._next
            # half of it at a time: few large writes instead of many small ones
            if first < run.count and run.onset_ns(first) > now_ns + self._ahead_ns // 2:
                return
            while last < run.count and run.onset_ns(last) <= now_ns + self._ahead_ns:
                last += 1
            if last == first:
                return
            pulses = [
                BookedPulse(run.onset_ns(index), intensity, self._limits.energy_j(intensity))
                for index, intensity in enumerate(run.intensities[first:last], first)
            ]
            self._open.update(enumerate(self._ledger.reserve(pulses), first))
            self._next = last

    def holds(self, index: int) -> bool:
        """Return whether a pulse of the run is reserved and not taken."""
        return index in self._open

    def take(self, index: int) -> None:
        """Note that a pulse of the run is triggered now.

        Raises
        ------
        LedgerError
            If it is not reserved, or given back.
        """
        self._ledger.take(self._open.pop(index, -1))


@dataclass
class Lateness:
    """Running mean and maximum of actual minus scheduled onset.

    Attributes
    ----------
    count : int
        Delivered pulses.
    mean_s, max_s : float
        Mean and maximum [s]; 0 before the first pulse.
    """

    count: int = 0
    mean_s: float = 0.0
    max_s: float = 0.0

    def add(self, late_ns: int) -> None:
        """Take one delivered pulse into account."""
        late_s = late_ns / NANOSECONDS_PER_SECOND
        self.count += 1
        self.mean_s += (late_s - self.mean_s) / self.count
        self.max_s = max(self.max_s, late_s)


_SECONDS = Bound(0.0, 10.0, 's', above=True)


@dataclass(frozen=True)
class DriverSettings(Bounded):
    """How a driver watches over itself.

    Attributes
    ----------
    lead_s : float
        From the acceptance of a schedule to its beginning [s].
    lateness_limit_s : float
        A pulse later than this is dropped, not sent [s].
    response_limit_s : float
        Longest time from a command to the pulse; more is a fault [s].  Without real-time priority
        the operating system alone may hold a thread up for tens of milliseconds.
    stuck_limit_s : float
        Longest time that a command may hang before the device is silenced [s].
    open_limit_s : float
        The same for opening and closing the device [s].
    intensity_tolerance : float
        Largest difference between commanded and delivered intensity (share); more is a fault.
    executor_timeout_s : float
        Longest silence of the executor that serves stops and cancels [s]; after 0.4 of it pulses
        are held back.
    supervisor_timeout_s : float
        Longest silence of the thread that watches over the others [s].
    force_limit_n : float
        Largest force, or torque [N, or `force_unit`]; 0 watches none.
    force_timeout_s : float
        Longest silence of the force sensor when a force limit is set [s].
    force_unit : str
        In which the sensor measures, for messages.
    keep_alive_s : float
        Time between two signs of life to an armed device [s].
    temperature_limit : float
        Coil temperature at which it is stopped [Celsius].
    prepare_s : float
        How long before its trigger the intensity of a pulse is set, at least; in a longer pause
        the intensity is zero [s].
    reserve_s : float
        How far ahead pulses are put into the dose ledger [s].
    """

    lead_s: float = bounded(_SECONDS, 0.05)
    lateness_limit_s: float = bounded(Bound(0.0, 0.1, 's', above=True), 10e-3)
    response_limit_s: float = bounded(_SECONDS, 0.1)
    stuck_limit_s: float = bounded(_SECONDS, 0.2)
    open_limit_s: float = bounded(_SECONDS, 5.0)
    # the device is told a number that it can be set to: what is left is rounding
    intensity_tolerance: float = bounded(Bound(0.0, 1.0), 0.005)
    executor_timeout_s: float = bounded(_SECONDS, 0.5)
    supervisor_timeout_s: float = bounded(_SECONDS, 0.5)
    force_limit_n: float = bounded(Bound(0.0, 1e5, 'N'), 0.0)
    force_timeout_s: float = bounded(_SECONDS, 0.2)
    force_unit: str = 'N'
    keep_alive_s: float = bounded(_SECONDS, 0.4)
    temperature_limit: float = bounded(Bound(-20.0, 100.0, 'Celsius'), 40.0)
    prepare_s: float = bounded(_SECONDS, 0.1)
    reserve_s: float = bounded(_SECONDS, 1.0)
