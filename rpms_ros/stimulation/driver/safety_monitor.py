# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a pulse is possible at all: state, interlocks, and the halt before everything.

Only the owner of the device (see `device_owner`) makes pulses possible.  Anybody, from any thread
and at any time, makes them impossible: a halt is noted, the device silenced out of band, and only
then the state follows.  A noted halt alone keeps the owner from the next trigger.
"""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple

from rpms_ros.stimulation.devices.registry import Device
from rpms_ros.stimulation.driver.interlocks import HOLD_SHARE, Interlocks, Refused
from rpms_ros.stimulation.driver.states import POSSIBLE, Command, DriverSettings, Run, State, after

EXECUTOR = 'executor'
SUPERVISOR = 'supervisor'
FORCE = 'force'
# of the node, which hears operators and buttons
HEARTBEAT = 'heartbeat'
EMERGENCY_STOP = 'emergency_stop'

_TEMPERATURE = 'temperature'
_FORCE_LIMIT = 'force_limit'


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
        Why the run ended, one of `run.CAUSES`.
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

    def __init__(
        self,
        device: Device,
        settings: DriverSettings,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.device = device
        self.settings = settings
        watched = {FORCE: settings.force_timeout_s} if settings.force_limit_n > 0 else {}
        self.interlocks = Interlocks(watched)
        limit_s = settings.supervisor_timeout_s
        self.interlocks.require(SUPERVISOR, limit_s, hold_s=limit_s)
        # a cancel and a lowered bound wait for the executor: pulses do so too
        limit_s = settings.executor_timeout_s
        self.interlocks.require(EXECUTOR, limit_s, hold_s=HOLD_SHARE * limit_s)
        self.run: Run | None = None
        self.wake = threading.Event()
        self._clock = clock
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
        """Return state, whether a stop is latched, and the reason; waits for nothing."""
        state, reason = self._standing
        return state, self.interlocks.latched, reason

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

    def reset(self) -> None:
        """Reset a latched stop; the driver stays disarmed.

        Raises
        ------
        Refused
            If its cause is still there.
        """
        self._apply_halts()
        self.interlocks.reset(self._clock())
        with self._lock:
            if self.state is not State.FAULT:
                self._standing = Standing(self.state, 'stop was reset')

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
        self.measured(_FORCE_LIMIT, newton, self.settings.force_limit_n, self.settings.force_unit)

    def temperature(self, celsius: float) -> None:
        """Hold a coil temperature [Celsius], measured or modelled, against its limit."""
        self.measured(_TEMPERATURE, celsius, self.settings.temperature_limit, 'Celsius')

    def measured(self, name: str, value: float, limit: float, unit: str) -> None:
        """Hold something measured against its limit; not a number counts as too much."""
        if value <= limit:
            self.interlocks.close(name)
            return
        reason = f'{name}: expected at most {limit:g} {unit}, got {value:g} {unit}'
        self.interlocks.open(name, reason)
        if self.state in POSSIBLE:
            self.stop(name, reason)

    def _halt(self, halt: Halt) -> None:
        """Make pulses impossible now; the order of these lines matters."""
        self._halts.append(halt)
        self._epoch = object()
        self._silence()
        self._apply_halts()
        self.wake.set()

    def _silence(self) -> None:
        """Silence the device out of band; one that cannot be silenced is left to its watchdog."""
        try:
            self.device.silence()
        except Exception as error:  # noqa: BLE001 - whatever it is, it may be armed
            reason = f'expected a device that can be silenced, got {error!r}'
            self._halts.append(Halt(Command.FAIL, reason, 'fault', 'disarm'))
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

    def _enter(self, command: Command, reason: str, since: object) -> bool:
        """Make more possible than before, if there was no halt ``since``; return whether."""
        with self._lock:
            if since is not self._epoch or self._halts:
                return False
            self._standing = Standing(after(self.state, command), reason)
            return True

    def _refuse_if_open(self) -> None:
        if self.interlocks.latched:
            why = self.interlocks.latched_reason
            raise Refused('stop', f'expected the latched stop to be reset, got: {why}')
        problem = self.interlocks.problem(self._clock())
        if problem is not None:
            raise Refused(*problem)
