# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver apart from ROS: every schedule and every pulse goes through here.

Each pulse of a run is fired after everything that can stand against it was asked.  Threads: the
owner takes steps and fires the pulses, a supervisor watches it; commands and signs of life come
from any other.  Pulses are put into the dose ledger before they are fired; how long that takes is
not known, so a third thread does it, some pulses at a time, and one that is not there yet is not
fired.
"""

import dataclasses
import math
import sys
import threading
import time
from collections.abc import Callable

import numpy as np

from rpms_ros.errors import StimulationError
from rpms_ros.printable import counted
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, nanoseconds
from rpms_ros.stimulation.devices.registry import (
    UNVERIFIED,
    Delivery,
    Device,
    DeviceError,
    DeviceStatus,
    TooLate,
)
from rpms_ros.stimulation.driver.device_owner import (
    AGAIN_NS,
    LOOK_NS,
    DeviceOwner,
    intensity_fault,
)
from rpms_ros.stimulation.driver.safety_monitor import BUSY
from rpms_ros.stimulation.driver.states import (
    POSSIBLE,
    Command,
    DriverSettings,
    Fired,
    Lateness,
    Reservations,
    Run,
    State,
    after,
)
from rpms_ros.stimulation.limits.coil_temperature import coil_after
from rpms_ros.stimulation.limits.device_specification import DeviceSpecification
from rpms_ros.stimulation.limits.forecast import MOST_PULSES, Trial
from rpms_ros.stimulation.limits.limiter import (
    TIMING_LIMITS,
    BookedPulse,
    DoseExceeded,
    LedgerError,
    PulseLimiter,
    Refused,
    too_quiet,
)
from rpms_ros.stimulation.records.dose_ledger import DoseLedger, MemoryLedger
from rpms_ros.stimulation.schedule.schedule import Plan, Schedule

_LATE = 'late'
# Pulses that were given up for a reading of the coil's temperature are counted under this name.
_READING = 'temperature_reading'
# The same for a reading of the intensity.
_INTENSITY = 'intensity_reading'
# A device that measures its coil is asked for it in a train when the last reading is this old, and
# one that tells its intensity for that.
_READING_LIMIT_NS = 4 * NANOSECONDS_PER_SECOND
# From this age on a reading of the temperature comes before one of the intensity.
_WARM_NS = 2 * NANOSECONDS_PER_SECOND
# How often pulses are put into the dose ledger; the longest silence of the thread that does it,
# which waits for a disk, in those of the supervisor.
_RESERVE_NS, _SILENCES = 100_000_000, 2.0
_LEDGER = 'ledger'
# Longer than a schedule can be.
_NEVER_S = 1e6
# How much a device's own clock may be before the driver's [s].
_EARLY_S = 1e-3
# A reading before a pulse ends so long before the trigger, which it must not delay.
_MARGIN_NS = 10_000_000


class StimulationController(DeviceOwner):
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

    Attributes
    ----------
    on_fired : callable
        Called by the owner after every trigger; what it raises is a fault.

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
            if not lowest > thermal.ambient:
                wrong = f'expected more than ambient, {thermal.ambient:g}, got {lowest:g}'
                raise StimulationError(f'temperature_limit: {wrong}')
            thermal = dataclasses.replace(thermal, cutout=lowest)
        self.ledger = MemoryLedger() if ledger is None else ledger
        history = self.ledger.history(clock())
        coil = coil_after(history, thermal, clock()) if thermal else None
        super().__init__(device, settings, specification.limits, coil, clock)
        self.specification = specification
        # two books: what may have been given, written before each trigger, and what was given as
        # far as the device tells; a pulse has to pass both
        self.limiter = PulseLimiter(self.limits)
        self.confirmed = PulseLimiter(self.limits)
        self.limiter.book_history(history)
        # among pulses of other devices the trains of this one would be others
        self.confirmed.book_history(pulse for pulse in history if pulse.on_device)
        self.interlocks.require(_LEDGER, _SILENCES * settings.supervisor_timeout_s)
        self.lateness = Lateness()
        self.on_fired: Callable[[Fired], object] = bool
        self.commanded = self.delivered = self.unverified = self.dropped = 0
        self._reservations: Reservations | None = None
        self._trigger_ns = nanoseconds(device.trigger_s)
        # how long the last preparation took
        self._preparing_ns = 0
        # pulses since the intensity was read, and whether it was read since it was set
        self._unread: list[BookedPulse] = []
        self._read = False
        # index of the pulse that the device is set for, None while it rests
        self._prepared: int | None = None
        self._wait_for_nothing()

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
        run = Run(schedule, self._first_onset_ns(), plan.intensity.tolist())
        reservations = Reservations(self.ledger, run, self.limits, self.settings.reserve_s)
        try:
            reservations.extend(run.start_ns)
            # the disk may have taken its time
            run.start_ns = max(run.start_ns, self._first_onset_ns())
            self._order(lambda: self._begin(run, reservations), self.settings.stuck_limit_s)
        except StimulationError as error:
            run.end(str(error), 'limit')
            reservations.extend(run.start_ns)
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

    def reserve(self) -> int:
        """Put the next pulses into the dose ledger; return when to do so again [ns].

        Called by a thread of its own.
        """
        self.seen(_LEDGER)
        try:
            if (reservations := self._reservations) is not None:
                reservations.extend(self._clock())
        except DoseExceeded as error:
            self.count(error.limit)
            self.cancel(str(error), 'limit')
        except LedgerError as error:
            self.fail(_LEDGER, str(error))
            # what it does not take back counts as given
            self._reservations = None
        return self._clock() + _RESERVE_NS

    def _first_onset_ns(self) -> int:
        settings, device = self.settings, self.device
        return self._clock() + nanoseconds(settings.lead_s + device.prepare_s + device.trigger_s)

    def _begin(self, run: Run, reservations: Reservations) -> None:
        """Begin a run that was checked; done by the owner."""
        since = self._settle()
        self._refuse_if_open()
        after(self.state, Command.START)
        if quiet := too_quiet(self.limits, run.due_ns - self._active_ns):
            raise Refused(*quiet)
        self.run, self._reservations = run, reservations
        # none of its pulses, nor does it rest: somebody may have been at the device
        self._prepared = -1
        # nothing can be read any more of a run that was cut short: it ended with intensity zero
        self._unread = []
        self._wait_for_nothing()
        self._enter(Command.START, f'running {run.schedule.name}', since)

    def _deliverable_plan(self, schedule: Schedule, start_ns: int) -> Plan:
        """Return the plan as the device can give it, or raise what stands against it."""
        after(self.state, Command.START)
        self._refuse_if_open()
        trials, left = self._order(self._trials, self.settings.stuck_limit_s)
        # before the plan is laid out: a schedule can ask for more pulses than there is memory
        for limit, most, what in (
            ('schedule_pulses', MOST_PULSES, 'pulses in a schedule'),
            ('session_pulses', left, 'more pulses in this session'),
        ):
            if schedule.pulse_count > most:
                raise Refused(
                    limit, f'{limit}: expected at most {most} {what}, got {schedule.pulse_count}'
                )
        intensity = self.device.quantized(schedule.plan.intensity)
        plan = dataclasses.replace(schedule.plan, intensity=intensity)
        # gives back what is left of the run before
        self.reserve()
        self.ledger.check(len(plan), self.limits.pulse_energy_j * float(np.sum(intensity**2)))
        for trial in trials:
            for time_s, (limit, reason) in trial.refusals(plan, schedule.width_s, start_ns):
                raise Refused(limit, f'{limit}: {reason}; at {time_s:.4g} s of the schedule')
        return plan

    def _trials(self) -> tuple[list[Trial], int]:
        """Return a trial of each limiter that differs, and the pulses left in the session."""
        same = vars(self.confirmed) == vars(self.limiter)
        limiters = [self.limiter] if same else [self.limiter, self.confirmed]
        left = max(self.limits.session_pulses - self.limiter.session_pulses, 0)
        return [Trial(kept, self.coil, self._active_ns) for kept in limiters], left

    # ---- the pulses of a run

    def step(self) -> int:
        """Do what is due; return when there is more to do [ns].  Called by the owner alone."""
        due_ns = None
        with self._deadlines.of(f'{BUSY}a turn of the driver', self.settings.stuck_limit_s):
            try:
                self._since = self._settle()
                self.orders.serve()
                self._since = self._settle()
                due_ns = self._advance()
                self._since = self._settle()
                self._keep_alive(due_ns)
                if self.state in (State.DISARMED, *POSSIBLE):
                    self._call('beat', self._since, self.device.beat)
            except DeviceError:
                # it was dealt with where it came up
                pass
            except Exception as error:  # noqa: BLE001 - whatever it is, nothing may go on
                self.fail('owner', f'expected a turn of the driver without error, got {error!r}')
        now = self._clock()
        return min(now + AGAIN_NS if due_ns is None else due_ns, now + LOOK_NS)

    def _wait_for_nothing(self) -> None:
        """Let the next pulse come when it is due."""
        self._hold_ns, self._held_by = 0, _LATE

    def _arm(self) -> None:
        with self._deadlines.of(_LEDGER, self.settings.open_limit_s):
            self.ledger.look()
        if self.interlocks.sleep() is not None:
            # the clock of the books stood still: what the subject knew may be of yesterday
            self._forget_known()
        super()._arm()

    def _open(self) -> None:
        super()._open()
        # before a fault the device may have given less than it was told
        self._forget_known()

    def _forget_known(self) -> None:
        for books in (self.limiter, self.confirmed):
            books.known.clear()

    def _advance(self) -> int:
        run, now = self.run, self._clock()
        if run is None or self.state is not State.RUNNING or not run.announced:
            return now + LOOK_NS
        trigger_ns = max(run.due_ns - self._trigger_ns, self._hold_ns)
        ahead_ns = nanoseconds(max(self.settings.prepare_s, self.device.prepare_s))
        if run.exhausted or trigger_ns - now > ahead_ns:
            self._rest(run)
            if not run.exhausted:
                return trigger_ns - ahead_ns
            if now >= run.due_ns:
                self._finish(run)
            return run.due_ns
        if self._prepared != run.cursor:
            # never between a preparation and its trigger: that pulse would be late
            if self._measured_ns is not None and now - self._measured_ns >= _READING_LIMIT_NS:
                self._read_temperature(run, trigger_ns - now)
            elif self._unread and now - self._unread[0].time_ns >= _READING_LIMIT_NS:
                self._read_late(run)
            else:
                self._prepare(run, trigger_ns - now)
        elif now >= trigger_ns:
            self._pulse(run)
            return max(self._hold_ns, now) if self.state is State.RUNNING else now + LOOK_NS
        else:
            return self._look_again(run, trigger_ns, now)
        return now

    @property
    def _reading_back_ns(self) -> int:
        """How long reading the intensity back takes [ns]; longer than any gap if it cannot be."""
        return nanoseconds(min(self.device.read_back_s, _NEVER_S))

    def _look_again(self, run: Run, trigger_ns: int, now: int) -> int:
        """Read the intensity right before a trigger, once; return when to go on [ns]."""
        begin_ns = trigger_ns - self._reading_back_ns
        if self._read or now > begin_ns:
            return trigger_ns
        if now >= begin_ns - _MARGIN_NS:
            self._use_status(self._read_back_status(self._since), self._since, run.intensity)
            return now
        return begin_ns - _MARGIN_NS

    def _read_back_status(self, since: object) -> DeviceStatus:
        """Read back what the device is set to."""
        status = self._call('read_back', since, self.device.read_back)
        self._answered_ns, self._read = self._clock(), True
        return status

    def _read_late(self, run: Run) -> None:
        """Read the intensity back in a train that leaves no room for it: pulses are given up."""
        needed_ns = self._reading_back_ns + self._preparing_ns + self._trigger_ns
        while not run.exhausted and run.due_ns - self._clock() < needed_ns:
            self._drop(run, _INTENSITY)
        self._verified(run, self._since)

    def _verified(self, run: Run, since: object) -> tuple[float, bool]:
        """Read back what the device is set to; return that, and whether it was right.

        What it was not told is a fault, and every pulse since the reading before counts as of
        what was read, if that is more.
        """
        status, unread, self._unread = self._read_back_status(since), self._unread, []
        found, expected = status.intensity, self._set_intensity
        wrong = intensity_fault(found, expected, self.settings.intensity_tolerance)
        if found is None or self._silenced(since, found, expected):
            return 0.0, False
        if wrong is None:
            self._use_status(status, since, None)
            return found, True
        self.fail('intensity', wrong)
        self._count_more(run, found, unread)
        return found, False

    def _silenced(self, since: object, found: float, expected: float) -> bool:
        """Return whether what was found is that of a device which was silenced meanwhile."""
        return since is not self._epoch and found <= expected

    def _count_more(self, run: Run, found: float, unread: list[BookedPulse]) -> None:
        """Put energy on all books that pulses of an intensity that was found had besides."""
        # what is no number may be as much
        found = found if found <= 1.0 else 1.0
        pulses = [
            BookedPulse(pulse.time_ns, found, self.limits.energy_j(found) - pulse.energy_j)
            for pulse in unread
            if found > pulse.intensity
        ]
        now, energy = self._clock(), sum(pulse.energy_j for pulse in pulses)
        for books in (self.limiter, self.confirmed):
            books.book_more(now, energy)
        if self.coil is not None:
            self.coil.heat(now, energy)
        run.energy_j += energy
        with self._deadlines.of(_LEDGER, self.settings.open_limit_s):
            try:
                if pulses:
                    self.ledger.count(pulses)
            except LedgerError as error:
                self.fail(_LEDGER, str(error))

    def _rest(self, run: Run) -> None:
        """Set intensity zero while no pulse is due."""
        if self._prepared is not None:
            if self._unread:
                # the last pulse was dropped: afterwards nothing can be read of those before it
                self._verified(run, self._since)
            self._call('rest', self._since, self.device.rest)
            self._set_intensity, self._prepared = 0.0, None

    def _read_temperature(self, run: Run, spare_ns: int) -> None:
        """Ask how warm the coil is; if the next pulse would be late by that, it is given up."""
        if spare_ns < self._reading_ns + self._preparing_ns:
            self._drop(run, _READING)
        # a device that does not tell any more costs no more pulses than one that does
        self._measured_ns = self._clock()
        self._ask_status(self._since)

    def _prepare(self, run: Run, spare_ns: int) -> None:
        began, since, intensity = self._clock(), self._since, run.intensity
        spare_s = max(0, spare_ns) / NANOSECONDS_PER_SECOND
        status = self._call('prepare', since, self.device.prepare, intensity, spare_s)
        self._answered_ns, self._read = self._clock(), False
        if status is None or status.temperature is None:
            self._preparing_ns = self._answered_ns - began
        self._use_status(status, since, intensity)
        self._set_intensity, self._prepared = intensity, run.cursor

    def _pulse(self, run: Run) -> None:
        """Fire the pulse that is due, if everything allows it at this very moment."""
        since = self._since
        if self._charging:
            # after the pulse before
            self._ask_status(since)
            if self._charging and since is self._epoch:
                self.fail('ready', 'expected a charged device, got one that is not ready')
                return
        if not self._permitted(run):
            return
        pulse, onset_ns = self._booked(run), self._clock() + self._trigger_ns
        latest_ns = pulse.due_ns + nanoseconds(self.settings.lateness_limit_s) - self._trigger_ns
        if since is not self._epoch or pulse.intensity > self.limits.maximum_intensity:
            # a stop or a lower bound came while the books were written
            return
        self.commanded += 1
        began = self._clock()
        told = pulse.intensity, pulse.width_s, latest_ns
        unknown = Delivery(onset_ns, pulse.intensity, frozenset(UNVERIFIED))
        fired = dataclasses.replace(pulse, delivery=unknown)
        try:
            delivery = self._call('fire', since, self.device.fire, *told)
            self._answered_ns = self._clock()
            self._account(run, dataclasses.replace(pulse, delivery=delivery), began, since)
            known = delivery and self._looked_at(run, delivery, since)
            fired = dataclasses.replace(pulse, delivery=known)
        except TooLate:
            self.commanded -= 1
            self._count_dropped(run, _LATE)
            return
        except Exception:
            # whatever was answered, the trigger was sent
            self._report_pulse(fired)
            raise
        self._report_pulse(fired)

    def _looked_at(self, run: Run, delivery: Delivery, since: object) -> Delivery:
        """Read the intensity of a pulse back, where there is room; say what is known of it."""
        if 'intensity' not in delivery.unverified:
            self._unread = []
            return delivery
        needed_ns = self._reading_back_ns
        if not run.exhausted:
            needed_ns += self._preparing_ns + self._trigger_ns
            if self._measured_ns is not None and self._clock() - self._measured_ns >= _WARM_NS:
                needed_ns += self._reading_ns
        room = run.exhausted or self._clock() + needed_ns <= run.due_ns
        if not room or since is not self._epoch:
            return delivery
        try:
            found, right = self._verified(run, since)
        except DeviceError:
            # a fault already
            return delivery
        if right:
            return delivery._replace(unverified=delivery.unverified - {'intensity'})
        return delivery._replace(intensity=max(found, delivery.intensity))

    def _permitted(self, run: Run) -> bool:
        """Return whether the pulse may be triggered now; deal with it if it may not."""
        now = self._clock()
        onset_ns = now + self._trigger_ns
        if (problem := self.interlocks.problem(now)) is not None:
            self.stop(*problem)
            return False
        if onset_ns - run.due_ns > nanoseconds(self.settings.lateness_limit_s):
            self._drop(run, self._held_by)
            return False
        both = self.limiter, self.confirmed
        refusals = [books.refusal(onset_ns, run.intensity, run.schedule.width_s) for books in both]
        refusal = refusals[0] or refusals[1]
        if refusal is not None and refusal.limit not in TIMING_LIMITS:
            self.count(refusal.limit)
            self.cancel(f'{refusal.limit}: {refusal.reason}', 'limit')
            return False
        held_by = self.interlocks.held_by(now)
        if refusal is not None:
            # the pulse before was late: this one waits for its interval, if it then is not late
            earliest = max(books.earliest_ns(run.intensity) for books in both)
            self._hold_ns = earliest - self._trigger_ns
        elif held_by or self._reservations is None or not self._reservations.holds(run.cursor):
            self._hold_ns, self._held_by = now + AGAIN_NS, held_by or _LEDGER
        else:
            return self.state is State.RUNNING and not self._halts
        return False

    def _booked(self, run: Run) -> Fired:
        """Put a pulse on all books right before its trigger, so that a fault counts."""
        pulse = Fired(
            run.due_ns, run.intensity, run.schedule.width_s, self.commanded, None, self.delivered
        )
        try:
            if self._reservations is not None:
                self._reservations.take(run.cursor)
        except LedgerError as error:
            # of a run that was stopped it was given back
            if self._since is self._epoch:
                self.fail(_LEDGER, str(error))
            raise DeviceError(str(error)) from error
        onset_ns = self._clock() + self._trigger_ns
        energy = self.limits.energy_j(run.intensity)
        self.limiter.book(onset_ns, run.intensity)
        if self.coil is not None:
            self.coil.heat(onset_ns, energy)
        run.energy_j += energy
        run.cursor += 1
        if math.isfinite(self.device.read_back_s):
            self._unread.append(BookedPulse(onset_ns, pulse.intensity, energy))
        self._active_ns = onset_ns
        self._wait_for_nothing()
        return pulse

    def _drop(self, run: Run, name: str) -> None:
        """Leave out the next pulse, counted under the name of what it has waited for."""
        self._count_dropped(run, name)
        run.cursor += 1
        self._wait_for_nothing()

    def _count_dropped(self, run: Run, name: str) -> None:
        run.dropped += 1
        self.dropped += 1
        self.count(name)

    def _finish(self, run: Run) -> None:
        if run.completed:
            self.cancel('completed', 'completed')
        else:
            missing = counted(run.count - run.delivered, 'pulse')
            self.cancel(f'ended with {missing} missing', 'incomplete')

    def _account(self, run: Run, fired: Fired, began_ns: int, since: object) -> None:
        """Compare what was delivered with what was commanded."""
        delivery = fired.delivery
        if delivery is None:
            if self.state is State.RUNNING:
                self.fail('lost', 'expected a pulse from the device, got none')
            return
        slow_s = (delivery.time_ns - began_ns) / NANOSECONDS_PER_SECOND
        if slow_s < -_EARLY_S:
            self.fail(
                'lost', f'expected a pulse after its trigger, got one {-slow_s:.3g} s before'
            )
            raise DeviceError(self.reason)
        run.delivered += 1
        self.limiter.correct(delivery.time_ns)
        self.confirmed.book(delivery.time_ns, fired.intensity)
        self.lateness.add(delivery.time_ns - fired.due_ns)
        tolerance = self.settings.intensity_tolerance
        wrong = intensity_fault(delivery.intensity, fired.intensity, tolerance)
        limit_s = self.settings.response_limit_s
        if wrong is not None and not self._silenced(since, delivery.intensity, fired.intensity):
            energy_j = self.limits.energy_j(fired.intensity)
            this = BookedPulse(delivery.time_ns, fired.intensity, energy_j)
            self.fail('intensity', wrong)
            self._count_more(run, delivery.intensity, [this])
        elif slow_s > limit_s:
            reason = f'expected the pulse within {limit_s:g} s, got it after {slow_s:.3g} s'
            self.fail('slow', reason)

    def _report_pulse(self, fired: Fired) -> None:
        """Count a pulse and tell who wants to know of it."""
        if fired.delivery is not None:
            self.delivered += 1
            self.unverified += bool(fired.delivery.unverified)
        with self._deadlines.of(f'{BUSY}on_fired', self.settings.stuck_limit_s):
            try:
                self.on_fired(fired)
            except Exception as error:  # noqa: BLE001 - nobody knows what it has left behind
                self.fail('callback', f'on_fired: expected no error, got {error!r}')


def _refuse_unfit(
    device: Device, specification: DeviceSpecification, ledger: MemoryLedger | None
) -> None:
    """Raise StimulationError if the three do not go together."""
    name, number, limits = specification.name, specification.serial_number, specification.limits
    wrong = ''
    if device.real and specification.simulated_only:
        wrong = f'the device specification of a real device, got {name!r}'
    elif device.real and not isinstance(ledger, DoseLedger):
        got = 'none' if ledger is None else 'one in memory'
        wrong = f'a dose ledger on the disk for a real device, got {got}'
    elif device.real and isinstance(ledger, DoseLedger) and ledger.device != number:
        wrong = f'the dose ledger of the device with serial_number {number!r}, got that of '
        wrong += repr(ledger.device)
    elif not device.sets_width and limits.minimum_width_s != limits.maximum_width_s:
        # a width that was asked for would be told as given
        got = f'{limits.minimum_width_s:g} s to {limits.maximum_width_s:g} s in {name!r}'
        wrong = f'one width for a device on which none can be set, got {got}'
    if wrong:
        raise StimulationError(f'expected {wrong}')


_JOIN_S = 2.0
# how long one thread of Python keeps the others waiting: the one that fires pulses is one of them
_SWITCH_S = 5e-4


class _MonitoredThread(threading.Thread):
    """Steps until closed; any other end makes pulses impossible.

    ``step`` does what is due and returns when there is more to do, monotonic clock [ns].
    """

    def __init__(
        self, name: str, controller: StimulationController, step: Callable[[], int]
    ) -> None:
        super().__init__(name=name, daemon=True)
        self._controller, self.step = controller, step
        self.wake = threading.Event()
        self._closing = False

    def run(self) -> None:
        """Step until closed."""
        try:
            while not self._closing:
                duration_s = (self.step() - time.monotonic_ns()) / NANOSECONDS_PER_SECOND
                if duration_s > 0 and self.wake.wait(duration_s):
                    self.wake.clear()
        finally:
            if not self._closing:
                reason = f'{self.name}: expected to run on, got an exception'
                self._controller.fail(self.name, reason)

    def close(self) -> None:
        """End it and wait for its end, but not for a device that hangs."""
        self._closing = True
        self.wake.set()
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
        self._threads: dict[str, _MonitoredThread] = {}

    def start(self) -> None:
        """Start those that do not run."""
        controller = self._controller
        sys.setswitchinterval(min(sys.getswitchinterval(), _SWITCH_S))
        # first signs of life: not later than the first order
        controller.supervise()
        controller.seen(_LEDGER)
        steps = controller.step, controller.supervise, controller.reserve
        for name, step in zip(('owner', 'supervisor', 'ledger'), steps, strict=True):
            if name in self._threads and self._threads[name].is_alive():
                continue
            thread = self._threads[name] = _MonitoredThread(f'{name}_thread', controller, step)
            if name == 'owner':
                controller.orders.owner, thread.wake = thread, controller.wake
            thread.start()

    def close(self) -> None:
        """End all of them."""
        for thread in self._threads.values():
            thread.close()
