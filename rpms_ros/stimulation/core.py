"""The driver apart from ROS: every command, every pulse and every stop goes through here.

Threads: the commands and signs of life come from an executor, `fire_next` from the thread that
keeps the time, `supervise` from a third one.  One lock guards the state.  It is never held while
the device is asked for something that may hang, and `stop` raises its flag and silences the device
before it takes the lock, so that a stop never waits for anything.
"""

import math
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import replace

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.stimulation.devices.interface import Delivery
from rpms_ros.stimulation.devices.interface import Device
from rpms_ros.stimulation.devices.interface import DeviceError
from rpms_ros.stimulation.gate import TIMING_LIMITS
from rpms_ros.stimulation.gate import PulseGate
from rpms_ros.stimulation.gate import refusals
from rpms_ros.stimulation.interlocks import Interlocks
from rpms_ros.stimulation.lateness import Lateness
from rpms_ros.stimulation.limits import Limits
from rpms_ros.stimulation.run import Run
from rpms_ros.stimulation.schedule import Schedule
from rpms_ros.stimulation.settings import DriverSettings
from rpms_ros.stimulation.states import Command
from rpms_ros.stimulation.states import State
from rpms_ros.stimulation.states import after

EXECUTOR = 'executor'
SUPERVISOR = 'supervisor'
HEARTBEAT = 'heartbeat'
FORCE = 'force'
_TEMPERATURE = 'temperature'
_FORCE_LIMIT = 'force_limit'


class Refused(StimulationError):
    """A driver does not do what it was asked to; ``limit`` names what stands against it."""

    def __init__(self, limit: str, reason: str) -> None:
        super().__init__(reason)
        self.limit = limit


@dataclass(frozen=True)
class Fired:
    """One pulse that was sent to the device.

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
        What the device says it did.
    delivered_sequence : int
        Counts the delivered pulses.
    """

    due_ns: int
    intensity: float
    width_s: float
    sequence: int
    delivery: Delivery | None
    delivered_sequence: int


class StimulatorCore:
    """State, limits, interlocks and device of one stimulator.

    Parameters
    ----------
    device : Device
        What gives the pulses.
    limits : Limits
        What no pulse may go beyond.
    settings : DriverSettings
        How it watches over itself.
    clock : callable
        Monotonic time [ns].
    """

    def __init__(
        self,
        device: Device,
        limits: Limits,
        settings: DriverSettings,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.device = device
        self.limits = limits
        self.settings = settings
        self.gate = PulseGate(limits)
        self.lateness = Lateness()
        self.faults: Counter[str] = Counter()
        self.state = State.UNCONFIGURED
        self.reason = 'not configured'
        self.run: Run | None = None
        self.commanded = 0
        self.delivered = 0
        self.dropped = 0
        self.temperature: float | None = None
        self.interlocks = Interlocks(_timeouts_ns(settings))
        self._clock = clock
        self._lock = threading.RLock()
        self._device_lock = threading.Lock()
        self._permit = False
        self._stops = 0
        self._active_ns = 0
        self._alive_ns = 0
        self._firing_since_ns: int | None = None

    # commands

    def configure(self) -> None:
        """Open the device.

        Raises
        ------
        StimulationError
            If it is open already or does not answer.
        """
        with self._lock:
            after(self.state, Command.CONFIGURE)
        self.device.open()
        self._enter(Command.CONFIGURE, 'device open, disarmed')

    def arm(self) -> None:
        """Make pulses possible.

        Raises
        ------
        Refused
            If a stop is latched or an interlock is open.
        StimulationError
            If the state does not allow it or the device does not answer.
        """
        with self._lock:
            after(self.state, Command.ARM)
            self._refuse_if_open()
            stops = self._stops
        try:
            self.device.arm()
        except DeviceError as error:
            self.fail('device', str(error))
            raise
        with self._lock:
            if stops == self._stops and self.state is State.DISARMED:
                self._active_ns = self._alive_ns = self._clock()
                self._enter(Command.ARM, 'armed')
                self._permit = True
                return
        self.device.disarm()
        raise Refused('stop', f'arm: expected no stop meanwhile, got one: {self.reason}')

    def check_start(self, schedule: Schedule) -> None:
        """Raise what `start` would raise."""
        with self._lock:
            after(self.state, Command.START)
            self._refuse_if_open()
        self._refuse_undeliverable(schedule)

    def start(self, schedule: Schedule) -> Run:
        """Begin a schedule; its first pulse is due after the lead time.

        Raises
        ------
        Refused
            If a limit or an interlock stands against it; nothing fires then.
        StimulationError
            If the state does not allow it, another schedule running among others.
        """
        self.check_start(schedule)
        with self._lock:
            after(self.state, Command.START)
            self._refuse_if_open()
            start = self._clock() + _ns(self.settings.lead_s)
            self.run = Run(schedule, start)
            self._enter(Command.START, f'running {schedule.name}')
            return self.run

    def cancel(self, reason: str = 'cancelled') -> None:
        """End the running schedule and stay armed; without one nothing happens."""
        with self._lock:
            if self.state is State.RUNNING:
                self._end_run(reason)
                self._enter(Command.FINISH, reason)

    def disarm(self, reason: str = 'disarmed') -> None:
        """Make pulses impossible: intensity zero first, everything else after."""
        self._silence()
        with self._lock:
            self._end_run(reason)
            if self.state in (State.ARMED, State.RUNNING):
                self._enter(Command.DISARM, reason)

    def cleanup(self, reason: str = 'device closed') -> None:
        """Let go of the device, from whatever state."""
        self.disarm(reason)
        try:
            self.device.close()
        except DeviceError as error:
            self.faults['device'] += 1
            reason = f'{reason}; {error}'
        self._enter(Command.CLEANUP, reason)

    def fail(self, name: str, reason: str) -> None:
        """Go to the safe state because something is wrong with the device."""
        self._silence()
        with self._lock:
            self.faults[name] += 1
            self._end_run(reason)
            self._enter(Command.FAIL, reason)

    def stop(self, name: str, reason: str) -> None:
        """Stop at once and latch it, in whatever state."""
        self._silence()
        with self._lock:
            self.faults[name] += 1
            self.interlocks.latch(name, reason)
            self._end_run(reason)
            self.state = after(self.state, Command.STOP)
            if self.state is not State.FAULT:
                self.reason = reason

    def reset(self) -> None:
        """Let go of a latched stop.

        Raises
        ------
        StimulationError
            If its cause is still there.
        """
        with self._lock:
            self.interlocks.reset(self._clock())
            if self.state is not State.FAULT:
                self.reason = 'stop was reset'

    # signs of life and conditions

    def seen(self, name: str) -> None:
        """Note a sign of life."""
        self.interlocks.seen(name, self._clock())

    def emergency(self, pressed: bool) -> None:
        """Take over the state of the emergency-stop button."""
        if pressed:
            self.interlocks.open('emergency_stop', 'emergency stop is pressed')
            self.stop('emergency_stop', 'emergency stop')
        else:
            self.interlocks.close('emergency_stop')

    def force(self, newton: float) -> None:
        """Hold a force sample [N] against its limit; not a number counts as too much."""
        self.seen(FORCE)
        self._condition(_FORCE_LIMIT, newton, self.settings.force_limit_n, 'N')

    def measured_temperature(self, celsius: float) -> None:
        """Hold a coil temperature [Celsius] against its limit."""
        self.temperature = celsius
        self._condition(_TEMPERATURE, celsius, self.settings.temperature_limit, 'Celsius')

    @property
    def coil_temperature(self) -> float:
        """Measured temperature of the coil [Celsius]; not a number if nothing measures it."""
        return math.nan if self.temperature is None else self.temperature

    # the threads

    def due_ns(self) -> int | None:
        """Return when there is something to do [ns], None if nothing is running."""
        with self._lock:
            return self.run.due_ns if self.run and self.state is State.RUNNING else None

    def fire_next(self) -> Fired | None:
        """Fire the next pulse if it is due and everything allows it, or end the schedule."""
        with self._lock:
            pulse = self._permitted()
            if pulse is None:
                return None
            since = self._firing_since_ns = self._clock()
        try:
            with self._device_lock:
                delivery = self.device.fire(pulse.intensity, pulse.width_s)
        except DeviceError as error:
            self.fail('device', str(error))
            return pulse
        finally:
            self._firing_since_ns = None
        with self._lock:
            return self._account(pulse, delivery, since)

    def supervise(self) -> None:
        """Watch over everything else; called steadily by a thread of its own."""
        now = self._clock()
        self.interlocks.seen(SUPERVISOR, now)
        with self._lock:
            if self.state not in (State.ARMED, State.RUNNING):
                return
            problem = self.interlocks.problem(now)
            since = self._firing_since_ns
            idle_s = (now - self._active_ns) / NANOSECONDS_PER_SECOND
        if problem is not None:
            self.stop(*problem)
        elif since is not None and now - since > _ns(self.settings.stuck_limit_s):
            limit = self.settings.stuck_limit_s
            self.fail('stuck', f'expected an answer of the device within {limit:g} s, got none')
        elif idle_s > self.limits.idle_disarm_s:
            self.faults['idle'] += 1
            self.disarm(f'idle: no pulse for {self.limits.idle_disarm_s:g} s while armed')
        else:
            self._keep_alive(now)

    def status(self) -> tuple[State, bool, str]:
        """Return state, whether a stop is latched, and the reason in plain words."""
        with self._lock:
            return self.state, self.interlocks.latched, self.reason

    def _keep_alive(self, now: int) -> None:
        if now - self._alive_ns < _ns(self.settings.keep_alive_s):
            return
        if not self._device_lock.acquire(blocking=False):
            return
        try:
            self.device.keep_alive()
            celsius = self.device.temperature()
        except DeviceError as error:
            self.fail('device', str(error))
            return
        finally:
            self._device_lock.release()
        self._alive_ns = now
        if celsius is not None:
            self.measured_temperature(celsius)

    def _permitted(self) -> Fired | None:
        """Return the next pulse, booked, if it may be fired now; deal with it if it may not."""
        run, now = self.run, self._clock()
        if run is None or self.state is not State.RUNNING or now < run.due_ns:
            return None
        problem = self.interlocks.problem(now)
        if problem is not None:
            self.stop(*problem)
            return None
        if run.exhausted:
            self._finish(run)
            return None
        if now - run.due_ns > _ns(self.settings.lateness_limit_s):
            self._drop(run, 'late')
            return None
        refusal = self.gate.refusal(now, run.intensity, run.schedule.width_s)
        if refusal is None and self._permit:
            return self._booked(run, now)
        if refusal is not None and refusal.limit in TIMING_LIMITS:
            self._drop(run, refusal.limit)
        elif refusal is not None:
            self.faults[refusal.limit] += 1
            self.cancel(f'{refusal.limit}: {refusal.reason}')
        return None

    def _booked(self, run: Run, now: int) -> Fired:
        self.gate.book(now, run.intensity)
        run.energy_j += self.limits.energy_j(run.intensity)
        self._active_ns = now
        pulse = Fired(
            run.due_ns, run.intensity, run.schedule.width_s, self.commanded, None, self.delivered
        )
        self.commanded += 1
        run.cursor += 1
        return pulse

    def _drop(self, run: Run, name: str) -> None:
        run.cursor += 1
        run.dropped += 1
        self.dropped += 1
        self.faults[name] += 1

    def _finish(self, run: Run) -> None:
        missing = run.cursor - run.delivered
        self.cancel('completed' if run.completed else f'ended with {missing} pulses missing')

    def _account(self, pulse: Fired, delivery: Delivery | None, since: int) -> Fired:
        """Compare what was delivered with what was commanded."""
        if delivery is None:
            if self.state is State.RUNNING:
                self.fail('lost', 'expected a pulse from the device, got none')
            return pulse
        self.delivered += 1
        if self.run is not None:
            self.run.delivered += 1
        self.lateness.add(delivery.time_ns - pulse.due_ns)
        off = abs(delivery.intensity - pulse.intensity)
        slow_s = (delivery.time_ns - since) / NANOSECONDS_PER_SECOND
        if not off <= self.settings.intensity_tolerance:
            self.fail(
                'intensity',
                f'expected intensity {pulse.intensity:.3g} from the device, '
                f'got {delivery.intensity:.3g}',
            )
        elif slow_s > self.settings.response_limit_s:
            limit = self.settings.response_limit_s
            self.fail(
                'slow', f'expected the pulse within {limit:g} s, got it after {slow_s:.3g} s'
            )
        return replace(pulse, delivery=delivery)

    def _condition(self, name: str, value: float, limit: float, unit: str) -> None:
        if value <= limit:
            self.interlocks.close(name)
            return
        reason = f'{name}: expected at most {limit:g} {unit}, got {value:g} {unit}'
        self.interlocks.open(name, reason)
        if self.state in (State.ARMED, State.RUNNING):
            self.stop(name, reason)

    def _refuse_if_open(self) -> None:
        if self.interlocks.latched:
            why = self.interlocks.latched_reason
            raise Refused('stop', f'expected the latched stop to be reset, got: {why}')
        problem = self.interlocks.problem(self._clock())
        if problem is not None:
            raise Refused(*problem)

    def _refuse_undeliverable(self, schedule: Schedule) -> None:
        left = self.limits.session_pulses - self.gate.session_pulses
        if schedule.pulse_count > left:
            raise Refused(
                'session_pulses',
                f'session_pulses: expected at most {left} more pulses in this session, '
                f'got {schedule.pulse_count}',
            )
        start = self._clock() + _ns(self.settings.lead_s)
        for refusal in refusals(self.gate.trial(), schedule, start):
            raise Refused(refusal.limit, f'{refusal.limit}: {refusal.reason}')

    def _silence(self) -> None:
        self._stops += 1
        self._permit = False
        self.device.disarm()

    def _end_run(self, reason: str) -> None:
        if self.run is not None and not self.run.ended:
            self.run.ended = reason

    def _enter(self, command: Command, reason: str) -> None:
        with self._lock:
            self.state = after(self.state, command)
            self.reason = reason


def _ns(seconds: float) -> int:
    return round(seconds * NANOSECONDS_PER_SECOND)


def _timeouts_ns(settings: DriverSettings) -> dict[str, int]:
    """Return the signs of life that have to keep coming, with their longest age [ns]."""
    timeouts = {
        EXECUTOR: _ns(settings.executor_timeout_s),
        SUPERVISOR: _ns(settings.supervisor_timeout_s),
    }
    if settings.heartbeat_timeout_s > 0:
        timeouts[HEARTBEAT] = _ns(settings.heartbeat_timeout_s)
    if settings.force_limit_n > 0:
        timeouts[FORCE] = _ns(settings.force_timeout_s)
    return timeouts
