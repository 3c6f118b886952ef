# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver apart from ROS: every schedule and every pulse goes through here.

Threads: the owner takes steps and fires the pulses, a supervisor watches it, a third one keeps the
dose ledger ahead of it; commands and signs of life come from any other.
"""

import dataclasses
import sys
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, nanoseconds
from rpms_ros.stimulation.devices.registry import Device
from rpms_ros.stimulation.driver.device_owner import LOOK_NS
from rpms_ros.stimulation.driver.interlocks import Refused
from rpms_ros.stimulation.driver.pulse_owner import PulseOwner, Reservations
from rpms_ros.stimulation.driver.states import POSSIBLE, Command, DriverSettings, Run, State, after
from rpms_ros.stimulation.limits.coil_temperature import coil_after
from rpms_ros.stimulation.limits.device_specification import DeviceSpecification
from rpms_ros.stimulation.limits.forecast import Forecast, Trial, forecast_plan
from rpms_ros.stimulation.limits.limiter import too_quiet
from rpms_ros.stimulation.limits.limits import DoseExceeded, LedgerError, Limits
from rpms_ros.stimulation.records.dose_ledger import DoseLedger, MemoryLedger
from rpms_ros.stimulation.schedule.schedule import Plan, Schedule


def quantized_plan(schedule: Schedule, left: int, device: Device) -> Plan:
    """Return the pulses of a schedule with intensities that the device can be set to.

    Raises
    ------
    Refused
        If they are more than are left in this session.
    """
    # before the plan is laid out: a schedule can ask for more pulses than there is memory
    if schedule.pulse_count > left:
        raise Refused(
            'session_pulses',
            f'session_pulses: expected at most {left} more pulses in this session, '
            f'got {schedule.pulse_count}',
        )
    plan = schedule.plan
    return dataclasses.replace(plan, intensity=device.quantized(plan.intensity))


def refuse_over_dose(plan: Plan, limits: Limits, ledger: MemoryLedger) -> None:
    """Raise Refused if a plan is more than the patient may get."""
    energy_j = limits.pulse_energy_j * float(np.sum(plan.intensity**2))
    try:
        ledger.check(len(plan), energy_j)
    except DoseExceeded as error:
        raise Refused(error.limit, str(error)) from error


def refuse_undeliverable(ahead: Forecast, limits: Limits) -> None:
    """Raise Refused if a plan breaks a limit of the device, with what could be delivered."""
    for violation in ahead.violations:
        raise Refused(
            violation.limit,
            f'{violation.limit}: {violation.reason}; at {violation.time_s:.4g} s of the '
            f'schedule, mean power {ahead.mean_power_w:.4g} W{_advice(ahead, limits)}',
        )


def _advice(ahead: Forecast, limits: Limits) -> str:
    """Return in words which intensity can be kept up for any time at the same rate."""
    if not ahead.max_rate_hz > 0.0:
        return ''
    highest = limits.highest_intensity(ahead.max_rate_hz)
    return f'; at {ahead.max_rate_hz:.4g} Hz intensities up to {highest:.3f} can be delivered'


class StimulationController(PulseOwner):
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
    ledger : MemoryLedger, optional
        Of the dose; a `DoseLedger` on the disk for a device that can hurt somebody.

    Raises
    ------
    StimulationError
        If device, specification and ledger do not go together.
    """

    def __init__(
        self,
        device: Device,
        specification: DeviceSpecification,
        settings: DriverSettings,
        clock: Callable[[], int] = time.monotonic_ns,
        ledger: MemoryLedger | None = None,
    ) -> None:
        _refuse_unfit(device, specification, ledger)
        thermal = specification.thermal
        if thermal is not None:
            lowest = min(settings.temperature_limit, thermal.cutout)
            settings = dataclasses.replace(settings, temperature_limit=lowest)
        self.ledger = MemoryLedger() if ledger is None else ledger
        history = self.ledger.history(clock())
        coil = coil_after(history, thermal, clock()) if thermal else None
        super().__init__(device, settings, specification.limits, coil, clock)
        self.specification = specification
        for books in (self.limiter, self.confirmed):
            books.book_history(history)

    def tighten(self, maximum_intensity: float) -> None:
        """Set a bound on the intensity (share) below the device specification's, at once.

        Raises
        ------
        StimulationError
            If it is above the specification's, or would be raised while a pulse is possible.
        """
        self.require_bound(maximum_intensity)
        self.limits = dataclasses.replace(self.limits, maximum_intensity=maximum_intensity)
        self.limiter.limits = self.confirmed.limits = self.limits

    def require_bound(self, maximum_intensity: float) -> None:
        """Raise what `tighten` would raise."""
        highest = self.specification.limits.maximum_intensity
        if self.state in POSSIBLE:
            highest = self.limits.maximum_intensity
        if not 0.0 <= maximum_intensity <= highest:
            raise StimulationError(
                f'maximum_intensity: expected a share in [0, {highest:g}], '
                f'got {maximum_intensity:g}'
            )

    def start(self, schedule: Schedule, accepted: Callable[[], object] = bool) -> Run:
        """Begin a schedule; its first pulse is due after the lead time.

        Parameters
        ----------
        schedule : Schedule
            What is run.
        accepted : callable
            Called once nothing stands against it any more, before the first pulse; what it
            raises prevents that pulse.

        Raises
        ------
        Refused
            If a limit or an interlock stands against it; nothing fires then.
        StimulationError
            If the state does not allow it, another schedule running among others.
        """
        plan = self._deliverable_plan(schedule, self._first_onset_ns())
        # gives back what is left of the run before
        self.reserve()
        run = Run(schedule, self._first_onset_ns(), plan.intensity.tolist())
        settings = self.settings
        reservations = Reservations(self.ledger, run, self.limits, settings.reserve_s)
        try:
            reservations.extend(run.start_ns)
            # the disk may have taken its time
            run.start_ns = max(run.start_ns, self._first_onset_ns())
            self._order(lambda: self._begin(run, reservations), settings.stuck_limit_s)
        except StimulationError as error:
            run.end(str(error), 'limit')
            reservations.extend(run.start_ns)
            if isinstance(error, DoseExceeded):
                raise Refused(error.limit, str(error)) from error
            raise
        try:
            accepted()
        except Exception as error:
            self.cancel(str(error))
            raise
        run.start_ns = max(run.start_ns, self._first_onset_ns())
        run.announced = True
        self.wake.set()
        return run

    def due_ns(self) -> int | None:
        """Return when the next pulse or the end of the run is due [ns], None without a run."""
        run = self.run
        if run is None or self.state is not State.RUNNING or self._halts:
            return None
        return run.due_ns

    def reserve(self) -> None:
        """Put the next pulses into the dose ledger; called steadily by a thread of its own."""
        reservations, run = self._reservations, self.run
        if reservations is None or run is None:
            return
        # a run that ends from here on may have pulses left that the next call gives back
        over = bool(run.ended)
        try:
            reservations.extend(self._clock())
        except DoseExceeded as error:
            self.count(error.limit)
            self.cancel(str(error), 'limit')
        except LedgerError as error:
            self.fail('ledger', str(error))
            # what it does not take back counts as given
            over = True
        if over and self._reservations is reservations:
            self._reservations = None

    def _first_onset_ns(self) -> int:
        return self._clock() + nanoseconds(
            self.settings.lead_s + self.device.prepare_s + self.device.trigger_s
        )

    def _begin(self, run: Run, reservations: Reservations) -> None:
        """Begin a run that was checked; done by the owner."""
        after(self.state, Command.START)
        self._refuse_if_open()
        since = self._epoch
        silence_s = (run.due_ns - self._active_ns) / NANOSECONDS_PER_SECOND
        if silence_s > self.limits.idle_disarm_s:
            raise Refused(*too_quiet(self.limits, silence_s))
        self.run, self._reservations = run, reservations
        self._set_intensity = None
        self._wait_for_nothing()
        if not self._enter(Command.START, f'running {run.schedule.name}', since):
            run.end(self.reason, 'stopped')
            raise Refused('stop', f'start: expected no stop meanwhile, got one: {self.reason}')

    def _deliverable_plan(self, schedule: Schedule, start_ns: int) -> Plan:
        """Return the plan as the device can give it, or raise what stands against it."""
        after(self.state, Command.START)
        self._refuse_if_open()
        trials, left = self._order(self._trials, self.settings.stuck_limit_s)
        plan = quantized_plan(schedule, left, self.device)
        refuse_over_dose(plan, self.limits, self.ledger)
        for trial in trials:
            ahead = forecast_plan(plan, schedule.width_s, trial, start_ns)
            refuse_undeliverable(ahead, trial.limits)
        return plan

    def _trials(self) -> tuple[list[Trial], int]:
        """Return a trial of each limiter that differs, and the pulses left in the session."""
        limiters = [self.limiter]
        if self.confirmed.last_ns != self.limiter.last_ns:
            limiters.append(self.confirmed)
        left = self.limits.session_pulses - self.limiter.session_pulses
        return [Trial(kept, self.coil, self._active_ns) for kept in limiters], left


def _refuse_unfit(
    device: Device, specification: DeviceSpecification, ledger: MemoryLedger | None
) -> None:
    """Raise StimulationError if the three do not go together."""
    if device.real and specification.simulated_only:
        raise StimulationError(
            f'expected the device specification of a real device, got {specification.name!r}, '
            'which is for a simulated one only'
        )
    if device.real:
        if not isinstance(ledger, DoseLedger):
            got = 'none' if ledger is None else 'one in memory'
            raise StimulationError(
                f'expected a dose ledger on the disk for a real device, got {got}'
            )
        if ledger.device != specification.serial_number:
            raise StimulationError(
                'expected the dose ledger of the device with serial_number '
                f'{specification.serial_number!r}, got that of {ledger.device!r}'
            )
    narrowest = specification.limits.minimum_width_s
    widest = specification.limits.maximum_width_s
    if not device.sets_width and narrowest != widest:
        # a width that was asked for would be told as given
        raise StimulationError(
            'expected one width for a device on which none can be set, got '
            f'{narrowest:g} s to {widest:g} s in device specification {specification.name!r}'
        )


_JOIN_S = 2.0
_RESERVE_S = 0.1
# how long one thread of Python keeps the others waiting: the one that fires pulses is one of them
_SWITCH_S = 5e-4


class _MonitoredThread(threading.Thread):
    """Steps until closed; any other end makes pulses impossible.

    ``step`` does what is due and returns how long nothing will be [s].
    """

    def __init__(
        self,
        controller: StimulationController,
        name: str,
        wake: threading.Event,
        step: Callable[[], float],
    ) -> None:
        super().__init__(name=name, daemon=True)
        self._controller = controller
        self._wake = wake
        self.step = step
        self._closing = False

    def run(self) -> None:
        """Step until closed."""
        try:
            while not self._closing:
                duration_s = self.step()
                if duration_s > 0 and self._wake.wait(duration_s):
                    self._wake.clear()
        finally:
            if not self._closing:
                reason = f'{self.name}: expected to run on, got an exception'
                self._controller.fail(self.name, reason)

    def close(self) -> None:
        """End it and wait for its end, but not for a device that hangs."""
        self._closing = True
        self._wake.set()
        if self.is_alive() and threading.current_thread() is not self:
            self.join(_JOIN_S)


class ControllerThreads:
    """The three threads of a controller: owner of the device, supervisor, and the ledger's.

    Parameters
    ----------
    controller : StimulationController
        Whose.
    """

    def __init__(self, controller: StimulationController) -> None:
        self._controller = controller
        self._threads: list[_MonitoredThread] = []

    def start(self) -> None:
        """Start those that do not run."""
        controller = self._controller
        sys.setswitchinterval(min(sys.getswitchinterval(), _SWITCH_S))
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        running = {thread.name for thread in self._threads}
        # the first look of the supervisor is a sign of life: not later than the first order
        controller.supervise()
        for name, wake, step in (
            ('owner_thread', controller.wake, self._fire),
            ('supervisor_thread', threading.Event(), self._supervise),
            ('ledger_thread', threading.Event(), self._reserve),
        ):
            if name in running:
                continue
            thread = _MonitoredThread(controller, name, wake, step)
            if step == self._fire:
                controller.orders.owner = thread
            thread.start()
            self._threads.append(thread)

    def close(self) -> None:
        """End all of them."""
        for thread in self._threads:
            thread.close()

    def __iter__(self) -> Iterator[threading.Thread]:
        return iter(self._threads)

    def _fire(self) -> float:
        due_ns = self._controller.step()
        return (due_ns - time.monotonic_ns()) / NANOSECONDS_PER_SECOND

    def _supervise(self) -> float:
        self._controller.supervise()
        return LOOK_NS / NANOSECONDS_PER_SECOND

    def _reserve(self) -> float:
        self._controller.reserve()
        return _RESERVE_S
