# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a pulse is possible at all: state, interlocks, and the halt before everything.

Only the owner of the device (see `device_owner`) makes pulses possible.  Anybody, from any thread
and at any time, makes them impossible: a halt is noted, the device silenced out of band, and only
then the state follows.  A noted halt alone keeps the owner from the next trigger.

Interlocks are of two kinds.  A *sign of life* (heartbeat, executor, supervisor, force samples) has
to keep coming and is held against its age at every single pulse, not by a timer that could itself
be late.  A *condition* (emergency stop, force, temperature) is open or closed.  Whatever opens
while a pulse is possible is latched: closing it again is not enough, somebody has to reset it.
"""

import threading
from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple

from rpms_ros.pulses import NANOSECONDS_PER_SECOND, nanoseconds
from rpms_ros.stimulation.devices.registry import Device
from rpms_ros.stimulation.driver.states import POSSIBLE, Command, DriverSettings, Run, State, after
from rpms_ros.stimulation.limits.limiter import Interlocked, Refused
from rpms_ros.stimulation.records.clocks import slept_ns

SUSPEND = 'suspend'
# the clocks are not read at one instant
_NAP_NS = 20_000_000

BUSY = 'computer too busy: pulses stopped; '
"""Begins the reason where a thread of the driver itself has missed its time."""

HOLD_SHARE = 0.4
"""Share of the longest silence of a hearer of stops after which pulses are held back."""


class Interlocks:
    """Signs of life and conditions.  Every method but `reset` only notes or looks something up.

    Parameters
    ----------
    slept : callable
        For how long the machine has slept since its start [ns].
    """

    def __init__(self, slept: Callable[[], int] = slept_ns) -> None:
        self._slept = slept
        self.awake()
        self._timeouts_ns: dict[str, int] = {}
        self._holds_ns: dict[str, int] = {}
        self._lock = threading.Lock()
        self._seen_ns: dict[str, int] = {}
        self._conditions: dict[str, str] = {}
        self._latched: dict[str, str] = {}

    def require(self, name: str, timeout_s: float, hold_s: float | None = None) -> None:
        """Ask for a sign of life.

        Parameters
        ----------
        name : str
            Of whom.
        timeout_s : float
            Longest silence [s]; then it is a problem.
        hold_s : float, optional
            Of a thread of the driver: silence [s] from which pulses are held back.
        """
        with self._lock:
            self._timeouts_ns[name] = nanoseconds(timeout_s)
            if hold_s is not None:
                self._holds_ns[name] = nanoseconds(hold_s)

    @property
    def latched(self) -> bool:
        """Whether a stop is latched."""
        return bool(self._latched)

    @property
    def latched_reason(self) -> str:
        """The first cause of the latched stop in plain words; empty without one."""
        with self._lock:
            return next(iter(self._latched.values()), '')

    def awake(self) -> None:
        """Note that the machine is awake: what it has slept so far does not count."""
        # the largest: of one that is read while the thread waits, the others are too large
        self._slept_ns = max(self._slept() for _ in range(5))

    def seen(self, name: str, now_ns: int) -> None:
        """Note a sign of life."""
        with self._lock:
            self._seen_ns[name] = now_ns

    def open(self, name: str, reason: str) -> None:
        """Note that a condition does not hold."""
        with self._lock:
            self._conditions[name] = reason

    def close(self, name: str) -> None:
        """Note that a condition holds again."""
        with self._lock:
            self._conditions.pop(name, None)

    def held_by(self, now_ns: int) -> str | None:
        """Return the sign of life whose silence delays pulses, None if there is none."""
        with self._lock:
            for name, hold in self._holds_ns.items():
                if now_ns - self._seen_ns.get(name, now_ns) > hold:
                    return name
            return None

    def problem(self, now_ns: int, since_ns: int | None = None) -> tuple[str, str] | None:
        """Return name and reason of the first open interlock, None if all are closed.

        Parameters
        ----------
        now_ns : int
            Now [ns].
        since_ns : int, optional
            A silence counts from then at the earliest [ns].
        """
        with self._lock:
            for name, reason in self._conditions.items():
                return name, reason
            for name, timeout in self._timeouts_ns.items():
                seen = self._seen_ns.get(name)
                if seen is None:
                    return name, f'{name}: expected a sign of life, got none yet'
                if since_ns is not None:
                    seen = max(seen, since_ns)
                if now_ns - seen > timeout:
                    age = (now_ns - seen) / 1e9
                    whose = BUSY if name in self._holds_ns else ''
                    return name, (
                        f'{whose}{name}: expected a sign of life within {timeout / 1e9:g} s, '
                        f'got none for {age:.3g} s'
                    )
            return self.sleep()

    def sleep(self) -> tuple[str, str] | None:
        """Return that the machine has slept since `awake`: no age has grown meanwhile."""
        asleep_ns = self._slept() - self._slept_ns
        if asleep_ns <= _NAP_NS:
            return None
        return SUSPEND, (
            f'{SUSPEND}: expected the machine to stay awake while pulses are possible, got it '
            f'asleep for {asleep_ns / NANOSECONDS_PER_SECOND:.3g} s'
        )

    def latch(self, name: str, reason: str) -> None:
        """Latch a stop; the first cause is kept in front."""
        with self._lock:
            self._latched.setdefault(name, reason)

    def reset(self, now_ns: int) -> None:
        """Reset a latched stop.

        Raises
        ------
        Refused
            If a cause is still there.
        """
        with self._lock:
            for name, reason in self._conditions.items():
                raise Refused(name, f'reset: expected the cause {name} gone, got {reason}')
            for name in self._latched:
                seen = self._seen_ns.get(name)
                timeout = self._timeouts_ns.get(name)
                if timeout is not None and (seen is None or now_ns - seen > timeout):
                    raise Refused(name, f'reset: expected {name} to come again, got nothing')
            self._latched.clear()


class SensorLife:
    """Judges the samples of one sensor.

    Parameters
    ----------
    frame_id : str
        Frame that the samples have to be of.
    timeout_s : float
        How far a stamp may be from the driver's time [s]: a recording that is played is of
        another day, and a sensor that falls behind shows what was.
    """

    def __init__(self, frame_id: str, timeout_s: float) -> None:
        self._frame_id = frame_id
        self._timeout_ns = nanoseconds(timeout_s)
        self._last_ns: int | None = None

    def refusal(self, stamp_ns: int, frame_id: str, now_ns: int) -> str | None:
        """Return why a sample does not count as a sign of life, None if it does.

        Parameters
        ----------
        stamp_ns : int
            Stamp of the sample [ns].
        frame_id : str
            Its frame.
        now_ns : int
            Time by the clock that the driver stamps its pulses with [ns].
        """
        if frame_id != self._frame_id:
            return f'expected force in frame {self._frame_id!r}, got {frame_id!r}'
        age_ns = now_ns - stamp_ns
        if abs(age_ns) > self._timeout_ns:
            limit_s = self._timeout_ns / NANOSECONDS_PER_SECOND
            return (
                f'expected a force sample within {limit_s:g} s of the time of the driver, '
                f'got one of {age_ns / NANOSECONDS_PER_SECOND:.3g} s ago'
            )
        last, self._last_ns = self._last_ns, stamp_ns
        if last is not None and stamp_ns <= last:
            moved_ns = stamp_ns - last
            return f'expected a force sample after the last one, got its stamp moved {moved_ns} ns'
        return None


EXECUTOR = 'executor'
SUPERVISOR = 'supervisor'
FORCE = 'force'
# of the node, which hears operators and buttons
HEARTBEAT = 'heartbeat'
EMERGENCY_STOP = 'emergency_stop'


class Standing(NamedTuple):
    """State and reason as one value, so that a reader never sees half of a change."""

    state: State
    reason: str


class Halt(NamedTuple):
    """Something that makes pulses impossible.

    Attributes
    ----------
    command : Command
        FINISH, DISARM, STOP, FAIL or CLEANUP.
    reason : str
        Why, in plain words.
    cause : str
        Why the run ended, as `Run.cause`.
    name : str
        Under which it is counted and latched; empty to count nothing.
    """

    command: Command
    reason: str
    cause: str
    name: str = ''


class SafetyMonitor:
    """State and interlocks of one stimulator.

    Parameters
    ----------
    device : Device
        What gives the pulses; here it is silenced, and nothing else.
    settings : DriverSettings
        How the driver watches over itself.
    clock : callable
        Monotonic time [ns].
    """

    def __init__(self, device: Device, settings: DriverSettings, clock: Callable[[], int]) -> None:
        self.device, self.settings, self._clock = device, settings, clock
        self.interlocks = Interlocks()
        if settings.force_limit_n > 0:
            self.interlocks.require(FORCE, settings.force_timeout_s)
        limit_s = settings.supervisor_timeout_s
        self.interlocks.require(SUPERVISOR, limit_s, hold_s=limit_s)
        # a cancel and a lowered bound wait for the executor: pulses do so too
        limit_s = settings.executor_timeout_s
        self.interlocks.require(EXECUTOR, limit_s, hold_s=HOLD_SHARE * limit_s)
        self.run: Run | None = None
        self.wake = threading.Event()
        self._standing = Standing(State.UNCONFIGURED, 'not configured')
        self._faults: Counter[str] = Counter()
        # held for some assignments only, never while something is waited for
        self._lock = threading.RLock()
        self._halts: deque[Halt] = deque()
        # another object after each halt: who compares it sees that there was one meanwhile
        self._epoch = object()

    @property
    def state(self) -> State:
        """Where the driver is."""
        return self._standing.state

    @property
    def reason(self) -> str:
        """Why it is there, in plain words."""
        return self._standing.reason

    def status(self) -> tuple[State, bool, str]:
        """Return state, whether a stop is latched, and the reason; waits for no device."""
        with self._lock:
            return self.state, self.interlocks.latched, self.reason

    def stop(self, name: str, reason: str) -> None:
        """Stop at once and latch it, in whatever state."""
        self._halt(Halt(Command.STOP, reason, 'stopped', name))

    def fail(self, name: str, reason: str) -> None:
        """Go to the safe state because something is wrong; only a clean-up leaves it."""
        self._halt(Halt(Command.FAIL, reason, 'fault', name))

    def disarm(self, reason: str = 'disarmed') -> None:
        """Make pulses impossible."""
        self._halt(Halt(Command.DISARM, reason, 'disarmed'))

    def cancel(self, reason: str = 'cancelled', cause: str = 'cancelled') -> None:
        """End the running schedule and disarm; without one nothing happens."""
        if self.state is State.RUNNING:
            self._halt(Halt(Command.FINISH, reason, cause))

    def reset(self) -> bool:
        """Reset a latched stop; the driver stays disarmed.  Return whether one was latched.

        Raises
        ------
        Refused
            If its cause is still there.
        """
        self._apply_halts()
        with self._lock:
            latched = self.interlocks.latched
            self.interlocks.reset(self._clock())
            if latched and self.state is not State.FAULT:
                self._standing = Standing(self.state, 'stop was reset')
            return latched

    def count(self, name: str) -> None:
        """Count something that went wrong."""
        with self._lock:
            self._faults[name] += 1

    def fault_counts(self) -> dict[str, int]:
        """Return what went wrong since the start, and how often."""
        with self._lock:
            return dict(self._faults)

    def seen(self, name: str) -> None:
        """Note a sign of life."""
        self.interlocks.seen(name, self._clock())

    def force(self, newton: float) -> None:
        """Hold a force sample [N] against its limit; not a number counts as too much."""
        self.seen(FORCE)
        self.measured('force_limit', newton, self.settings.force_limit_n, self.settings.force_unit)

    def temperature(self, celsius: float) -> None:
        """Hold a coil temperature [Celsius], measured or modelled, against its limit."""
        self.measured('temperature', celsius, self.settings.temperature_limit, 'Celsius')

    def measured(self, name: str, value: float, limit: float, unit: str) -> None:
        """Hold something measured against its limit; not a number counts as too much."""
        if value <= limit:
            self.interlocks.close(name)
            return
        self.open(name, f'{name}: expected at most {limit:g} {unit}, got {value:g} {unit}')

    def open(self, name: str, reason: str) -> None:
        """Note that a condition does not hold; stop if a pulse is possible."""
        self.interlocks.open(name, reason)
        if self.state in POSSIBLE:
            self.stop(name, reason)

    def _halt(self, halt: Halt) -> None:
        """Make pulses impossible now; the order of these lines matters."""
        self._note(halt)
        self._silence()
        self._apply_halts()
        self.wake.set()

    def _silence(self) -> None:
        """Silence the device out of band; one that cannot be silenced is left to its watchdog."""
        try:
            self.device.silence()
        except Exception as error:  # noqa: BLE001 - whatever it is, it may be armed
            reason = f'expected a device that can be silenced, got {error!r}'
            self._note(Halt(Command.FAIL, reason, 'fault', 'disarm'))

    def _note(self, halt: Halt) -> None:
        # whoever applies it, nobody decides by an epoch before it
        with self._lock:
            self._halts.append(halt)
            self._epoch = object()

    def _apply_halts(self) -> None:
        """Bring state, latch and run in line with the halts that were noted."""
        with self._lock:
            while self._halts:
                # noted until it is applied: who looks in between sees one or the other
                self._apply(self._halts[0])
                self._halts.popleft()

    def _apply(self, halt: Halt) -> None:
        if halt.name:
            self._faults[halt.name] += 1
        if halt.command is Command.STOP:
            self.interlocks.latch(halt.name, halt.reason)
        if self.run is not None:
            self.run.end(halt.reason, halt.cause)
        state, reason = self._standing
        if halt.command is Command.FINISH and state is not State.RUNNING:
            return
        moved = after(state, halt.command)
        # the first cause of a fault is kept, and why it is disarmed already
        kept = halt.command is Command.DISARM and state not in POSSIBLE
        kept = kept or state is moved is State.FAULT
        self._standing = Standing(moved, reason if kept else halt.reason)

    def _enter(self, command: Command, reason: str, since: object) -> None:
        """Make more possible than before; silence the device if there was a halt ``since``.

        Raises
        ------
        Interlocked
            If there was one.
        """
        with self._lock:
            if since is self._epoch and not self._halts:
                self._standing = Standing(after(self.state, command), reason)
                return
            self._apply_halts()
        self._silence()
        wrong = f'{command.value}: expected no stop meanwhile, got one: {self.reason}'
        raise Interlocked('stop', wrong)

    def _refuse_if_open(self) -> None:
        if self.interlocks.latched:
            why = self.interlocks.latched_reason
            raise Interlocked('stop', f'expected the latched stop to be reset, got: {why}')
        problem = self.interlocks.problem(self._clock())
        if problem is not None:
            # how warm it may be is a limit of the coil
            raise (Refused if problem[0] == 'temperature' else Interlocked)(*problem)
