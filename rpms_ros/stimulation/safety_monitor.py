"""Whether a pulse is possible at all: device, state, interlocks, and the stop before everything.

One lock guards the state.  It is never held while the device is asked for something that may
hang, and `stop` takes back the permit and silences the device before it takes the lock, so that a
stop never waits for anything.
"""

import threading
import time
from collections import Counter
from collections.abc import Callable

from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation.devices.interface import Device
from rpms_ros.stimulation.devices.interface import DeviceError
from rpms_ros.stimulation.interlocks import Interlocks
from rpms_ros.stimulation.interlocks import Refused
from rpms_ros.stimulation.settings import DriverSettings
from rpms_ros.stimulation.states import Command
from rpms_ros.stimulation.states import State
from rpms_ros.stimulation.states import after

EXECUTOR = 'executor'
SUPERVISOR = 'supervisor'
HEARTBEAT = 'heartbeat'
FORCE = 'force'
EMERGENCY_STOP = 'emergency_stop'
POSSIBLE = (State.ARMED, State.RUNNING)
"""States in which a pulse is possible."""

_TEMPERATURE = 'temperature'
_FORCE_LIMIT = 'force_limit'


class SafetyMonitor:
    """State, interlocks and device of one stimulator.

    Parameters
    ----------
    device : Device
        What gives the pulses.
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
        self._faults: Counter[str] = Counter()
        self.state = State.UNCONFIGURED
        self.reason = 'not configured'
        self.interlocks = Interlocks(_timeouts_ns(settings))
        self._clock = clock
        self._lock = threading.RLock()
        self._device_lock = threading.Lock()
        self._permit = False
        self._stops = 0
        self._active_ns = 0
        self._alive_ns = 0

    def configure(self) -> None:
        """Open the device.

        Raises
        ------
        StimulationError
            If it is open already or does not answer.
        """
        with self._lock:
            after(self.state, Command.CONFIGURE)
        with self._device_lock:
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
            with self._device_lock:
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
        self._silence()
        raise Refused('stop', f'arm: expected no stop meanwhile, got one: {self.reason}')

    def disarm(self, reason: str = 'disarmed') -> None:
        """Make pulses impossible: intensity zero first, everything else after."""
        self._silence()
        with self._lock:
            self._end_run(reason)
            if self.state in POSSIBLE:
                self._enter(Command.DISARM, reason)

    def cleanup(self, reason: str = 'device closed') -> None:
        """Let go of the device, from whatever state."""
        self.disarm(reason)
        # a device that hangs has been disarmed; it is not waited for
        free = self._device_lock.acquire(timeout=self.settings.stuck_limit_s)
        try:
            self.device.close()
        except DeviceError as error:
            self.count('device')
            reason = f'{reason}; {error}'
        finally:
            if free:
                self._device_lock.release()
        self._enter(Command.CLEANUP, reason)

    def fail(self, name: str, reason: str) -> None:
        """Go to the safe state because something is wrong with the device."""
        self._silence()
        with self._lock:
            self.count(name)
            self._end_run(reason)
            self._enter(Command.FAIL, reason)

    def stop(self, name: str, reason: str) -> None:
        """Stop at once and latch it, in whatever state."""
        self._silence()
        with self._lock:
            self.count(name)
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

    def status(self) -> tuple[State, bool, str]:
        """Return state, whether a stop is latched, and the reason in plain words."""
        with self._lock:
            return self.state, self.interlocks.latched, self.reason

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

    def emergency(self, pressed: bool) -> None:
        """Take over the state of the emergency-stop button."""
        if pressed:
            self.interlocks.open(EMERGENCY_STOP, 'emergency stop is pressed')
            self.stop(EMERGENCY_STOP, 'emergency stop')
        else:
            self.interlocks.close(EMERGENCY_STOP)

    def force(self, newton: float) -> None:
        """Hold a force sample [N] against its limit; not a number counts as too much."""
        self.seen(FORCE)
        self.measured(_FORCE_LIMIT, newton, self.settings.force_limit_n, 'N')

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

    def _refuse_if_open(self) -> None:
        if self.interlocks.latched:
            why = self.interlocks.latched_reason
            raise Refused('stop', f'expected the latched stop to be reset, got: {why}')
        problem = self.interlocks.problem(self._clock())
        if problem is not None:
            raise Refused(*problem)

    def _silence(self) -> None:
        self._stops += 1
        self._permit = False
        try:
            self.device.silence()
        except DeviceError as error:
            # nothing is sent to it any more, keep-alives neither: it disarms by itself
            with self._lock:
                self.count('disarm')
                self._enter(Command.FAIL, str(error))

    def _end_run(self, reason: str) -> None:
        """Tell a running schedule that it is over; whoever runs one overrides this."""

    def _enter(self, command: Command, reason: str) -> None:
        with self._lock:
            self.state = after(self.state, command)
            self.reason = reason


def _timeouts_ns(settings: DriverSettings) -> dict[str, int]:
    """Return the signs of life that have to keep coming, with their longest age [ns]."""
    timeouts = {
        EXECUTOR: nanoseconds(settings.executor_timeout_s),
        SUPERVISOR: nanoseconds(settings.supervisor_timeout_s),
    }
    if settings.heartbeat_timeout_s > 0:
        timeouts[HEARTBEAT] = nanoseconds(settings.heartbeat_timeout_s)
    if settings.force_limit_n > 0:
        timeouts[FORCE] = nanoseconds(settings.force_timeout_s)
    return timeouts
