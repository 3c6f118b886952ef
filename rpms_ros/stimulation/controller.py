"""The driver apart from ROS: every schedule and every pulse goes through here.

Threads: commands and signs of life come from an executor, `fire_next` from the thread that keeps
the time, `supervise` from a third one.
"""

import math
import time
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from dataclasses import replace

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation.device_specification import DeviceSpecification
from rpms_ros.stimulation.devices.interface import Delivery
from rpms_ros.stimulation.devices.interface import Device
from rpms_ros.stimulation.devices.interface import DeviceError
from rpms_ros.stimulation.forecast import Forecast
from rpms_ros.stimulation.forecast import forecast_plan
from rpms_ros.stimulation.interlocks import Refused
from rpms_ros.stimulation.lateness import Lateness
from rpms_ros.stimulation.limiter import TIMING_LIMITS
from rpms_ros.stimulation.limiter import PulseLimiter
from rpms_ros.stimulation.run import Run
from rpms_ros.stimulation.safety_monitor import POSSIBLE
from rpms_ros.stimulation.safety_monitor import SUPERVISOR
from rpms_ros.stimulation.safety_monitor import SafetyMonitor
from rpms_ros.stimulation.schedule import Schedule
from rpms_ros.stimulation.settings import DriverSettings
from rpms_ros.stimulation.states import Command
from rpms_ros.stimulation.states import State
from rpms_ros.stimulation.states import after
from rpms_ros.stimulation.thermal import CoilTemperature


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


class StimulationController(SafetyMonitor):
    """Runs schedules on a device, one at a time, within limits.

    Parameters
    ----------
    device : Device
        What gives the pulses.
    specification : DeviceSpecification
        What the device can do.
    settings : DriverSettings
        How it watches over itself.
    clock : callable
        Monotonic time [ns].
    """

    def __init__(
        self,
        device: Device,
        specification: DeviceSpecification,
        settings: DriverSettings,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        if specification.thermal is not None:
            lowest = min(settings.temperature_limit, specification.thermal.cutout)
            settings = replace(settings, temperature_limit=lowest)
        super().__init__(device, settings, clock)
        if device.real and specification.simulated_only:
            raise StimulationError(
                f'expected the device specification of a real device, got {specification.name!r}, '
                'which is for a simulated one only'
            )
        self.specification = specification
        self.limits = specification.limits
        self.limiter = PulseLimiter(specification.limits)
        self.coil = (
            CoilTemperature(specification.thermal, clock()) if specification.thermal else None
        )
        self.lateness = Lateness()
        self.run: Run | None = None
        self.commanded = 0
        self.delivered = 0
        self.dropped = 0
        self._firing_since_ns: int | None = None
        self._hold_ns = 0
        self._checked: tuple[Schedule, int] | None = None

    def check_start(self, schedule: Schedule) -> None:
        """Raise what `start` would raise."""
        with self._lock:
            after(self.state, Command.START)
            self._refuse_if_open()
        # asked twice in a row, by a goal and by its start; the limiter has the last word anyway
        if self._checked != (schedule, self.limiter.session_pulses):
            self._refuse_undeliverable(schedule)
            self._checked = (schedule, self.limiter.session_pulses)

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
            start = self._clock() + nanoseconds(self.settings.lead_s)
            self.run = Run(schedule, start)
            self._enter(Command.START, f'running {schedule.name}')
            return self.run

    def cancel(self, reason: str = 'cancelled') -> None:
        """End the running schedule and stay armed; without one nothing happens."""
        with self._lock:
            if self.state is State.RUNNING:
                self._end_run(reason)
                self._enter(Command.FINISH, reason)

    def due_ns(self) -> int | None:
        """Return when there is something to do [ns], None if nothing is running."""
        with self._lock:
            # without a permit somebody is about to stop: leave the lock to them
            if self.run is None or self.state is not State.RUNNING or not self._permit:
                return None
            return max(self.run.due_ns, self._hold_ns)

    def fire_next(self) -> Fired | None:
        """Fire the next pulse if it is due and everything allows it, or end the schedule."""
        with self._lock:
            pulse, run = self._permitted(), self.run
            if pulse is None or run is None:
                return None
            since = self._firing_since_ns = self._clock()
        try:
            with self._device_lock:
                self.device.prepare(pulse.intensity)
                delivery = self.device.fire(pulse.intensity, pulse.width_s)
        except DeviceError as error:
            self.fail('device', str(error))
            return pulse
        finally:
            self._firing_since_ns = None
        with self._lock:
            fired = self._account(run, pulse, delivery, since)
        self._prepare_next()
        return fired

    def _prepare_next(self) -> None:
        with self._lock:
            run = self.run
            if run is None or run.exhausted or self.state is not State.RUNNING:
                return
        try:
            with self._device_lock:
                self.device.prepare(run.intensity)
        except DeviceError as error:
            self.fail('device', str(error))

    def supervise(self) -> None:
        """Watch over everything else; called steadily by a thread of its own."""
        now = self._clock()
        self.seen(SUPERVISOR)
        with self._lock:
            possible = self.state in POSSIBLE
            problem = self.interlocks.problem(now) if possible else None
            since = self._firing_since_ns
            idle_s = (now - self._active_ns) / NANOSECONDS_PER_SECOND
        if problem is not None:
            self.stop(*problem)
        elif since is not None and now - since > nanoseconds(self.settings.stuck_limit_s):
            limit = self.settings.stuck_limit_s
            self._firing_since_ns = None
            self.fail('stuck', f'expected an answer of the device within {limit:g} s, got none')
        elif possible and idle_s > self.limits.idle_disarm_s:
            self.count('idle')
            self.disarm(f'idle: no pulse for {self.limits.idle_disarm_s:g} s while armed')
        elif self.state in (State.DISARMED, *POSSIBLE):
            self._look_after_device(now)

    @property
    def coil_temperature(self) -> float:
        """Temperature of the coil [Celsius], measured or modelled; NaN if neither is known."""
        with self._lock:
            return math.nan if self.coil is None else self.coil.at(self._clock())

    def _look_after_device(self, now: int) -> None:
        """Keep an armed device alive, and look at its temperature."""
        if now - self._alive_ns < nanoseconds(self.settings.keep_alive_s):
            return
        if not self._device_lock.acquire(blocking=False):
            return
        try:
            celsius = self.device.keep_alive().temperature
        except DeviceError as error:
            self.fail('device', str(error))
            return
        finally:
            self._device_lock.release()
        self._alive_ns = now
        with self._lock:
            if celsius is not None and self.coil is not None:
                self.coil.measured(now, celsius)
            elif self.coil is not None:
                celsius = self.coil.at(now)
        if celsius is not None:
            self.temperature(celsius)

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
        if now - run.due_ns > nanoseconds(self.settings.lateness_limit_s):
            self._drop(run, 'late')
            return None
        refusal = self.limiter.refusal(now, run.intensity, run.schedule.width_s)
        if refusal is None and self._permit:
            return self._booked(run, now)
        if refusal is not None and refusal.limit in TIMING_LIMITS:
            # the pulse before was late: this one waits for its interval, if it then is not late
            self._hold_ns = self.limiter.earliest_ns(run.intensity)
        elif refusal is not None:
            self.count(refusal.limit)
            self.cancel(f'{refusal.limit}: {refusal.reason}')
        return None

    def _booked(self, run: Run, now: int) -> Fired:
        energy = self.limits.energy_j(run.intensity)
        self.limiter.book(now, run.intensity)
        if self.coil is not None:
            self.coil.heat(now, energy)
        run.energy_j += energy
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
        self.count(name)

    def _finish(self, run: Run) -> None:
        missing = run.cursor - run.delivered
        self.cancel('completed' if run.completed else f'ended with {missing} pulses missing')

    def _account(self, run: Run, pulse: Fired, delivery: Delivery | None, since: int) -> Fired:
        """Compare what was delivered with what was commanded."""
        if delivery is None:
            if self.state is State.RUNNING:
                self.fail('lost', 'expected a pulse from the device, got none')
            return pulse
        self.delivered += 1
        self.limiter.correct(delivery.time_ns)
        run.delivered += 1
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

    def _refuse_undeliverable(self, schedule: Schedule) -> None:
        left = self.limits.session_pulses - self.limiter.session_pulses
        if schedule.pulse_count > left:
            raise Refused(
                'session_pulses',
                f'session_pulses: expected at most {left} more pulses in this session, '
                f'got {schedule.pulse_count}',
            )
        start = self._clock() + nanoseconds(self.settings.lead_s)
        ahead = forecast_plan(
            schedule.plan, schedule.width_s, self.limiter.trial(), copy(self.coil), start
        )
        for violation in ahead.violations:
            raise Refused(
                violation.limit,
                f'{violation.limit}: {violation.reason}; at {violation.time_s:.4g} s of the '
                f'schedule, mean power {ahead.mean_power_w:.4g} W{self._advice(ahead)}',
            )

    def _advice(self, ahead: Forecast) -> str:
        """Return what could go on for ever at the same rate, in words."""
        if not ahead.max_rate_hz > 0.0:
            return ''
        highest = self.limits.highest_intensity(ahead.max_rate_hz)
        return f'; at {ahead.max_rate_hz:.4g} Hz intensities up to {highest:.3f} can be delivered'

    def _end_run(self, reason: str) -> None:
        if self.run is not None and not self.run.ended:
            self.run.ended = reason
