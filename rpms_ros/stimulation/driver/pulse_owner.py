# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Firing the pulses of a run, each after everything that can stand against it was asked.

Pulses of a run are put into the dose ledger before they are fired.  How long that takes is not
known, so it is done by a thread of its own, some pulses at a time; a pulse that is not there yet
is not fired.
"""

import dataclasses
import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

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
from rpms_ros.stimulation.driver.interlocks import BUSY
from rpms_ros.stimulation.driver.states import DriverSettings, Run, State
from rpms_ros.stimulation.limits.coil_temperature import CoilTemperature
from rpms_ros.stimulation.limits.limiter import TIMING_LIMITS, PulseLimiter
from rpms_ros.stimulation.limits.limits import BookedPulse, LedgerError, Limits
from rpms_ros.stimulation.records.dose_ledger import MemoryLedger


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
    answered : bool
        Whether the device answered.
    """

    due_ns: int
    intensity: float
    width_s: float
    sequence: int
    delivery: Delivery | None
    delivered_sequence: int
    answered: bool = True


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
        self._ledger = ledger
        self._run = run
        self._limits = limits
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
                left, self._open = list(self._open.values()), {}
                self._ledger.settle(left)
                return
            first, last = self._next, self._next
            # half of it at a time: few large writes instead of many small ones
            if first < run.count and run.onset_ns(first) > now_ns + self._ahead_ns // 2:
                return
            while last < run.count and run.onset_ns(last) <= now_ns + self._ahead_ns:
                last += 1
            if last == first:
                return
            energy = self._limits.energy_j
            pulses = [
                BookedPulse(run.onset_ns(index), intensity, energy(intensity))
                for index, intensity in enumerate(run.intensities[first:last], first)
            ]
            self._open.update(enumerate(self._ledger.reserve(pulses), first))
            self._next = last

    def holds(self, index: int) -> bool:
        """Return whether a pulse of the run is reserved and not taken."""
        return index in self._open

    def count(self, pulses: Sequence[BookedPulse]) -> None:
        """Count pulses that were given beside the run's; raises LedgerError as `extend` does."""
        self._ledger.count(pulses)

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
    """Running mean and maximum.

    Attributes
    ----------
    count : int
        Delivered pulses.
    sum_ns, max_ns : int
        Sum and maximum of actual minus scheduled onset [ns].
    """

    count: int = 0
    sum_ns: int = 0
    max_ns: int = 0

    def add(self, late_ns: int) -> None:
        """Take one delivered pulse into account."""
        self.count += 1
        self.sum_ns += late_ns
        self.max_ns = max(self.max_ns, late_ns)

    @property
    def mean_s(self) -> float:
        """Mean [s]; 0 before the first pulse."""
        return self.sum_ns / self.count / NANOSECONDS_PER_SECOND if self.count else 0.0

    @property
    def max_s(self) -> float:
        """Maximum [s]."""
        return self.max_ns / NANOSECONDS_PER_SECOND


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
# Longer than a schedule can be.
_NEVER_S = 1e6
# A reading before a pulse ends so long before the trigger, which it must not delay.
_MARGIN_NS = 10_000_000


class PulseOwner(DeviceOwner):
    """Fires the run that there is, and compares what was given with what was asked for.

    Attributes
    ----------
    on_fired : callable
        Called by the owner after every trigger; what it raises is a fault.
    """

    def __init__(
        self,
        device: Device,
        settings: DriverSettings,
        limits: Limits,
        coil: CoilTemperature | None,
        clock: Callable[[], int],
    ) -> None:
        super().__init__(device, settings, limits, coil, clock)
        # two books: what may have been given, written before each trigger, and what was given as
        # far as the device tells; a pulse has to pass both
        self.limiter = PulseLimiter(limits)
        self.confirmed = PulseLimiter(limits)
        self.lateness = Lateness()
        self.on_fired: Callable[[Fired], None] = _nobody
        self.commanded = 0
        self.delivered = 0
        self.unverified = 0
        self.dropped = 0
        self._reservations: Reservations | None = None
        self._trigger_ns = nanoseconds(device.trigger_s)
        # how long the last preparation took
        self._preparing_ns = 0
        # pulses since the intensity was read, and whether it was read since it was set
        self._unread: list[BookedPulse] = []
        self._read = False
        self._wait_for_nothing()

    def _wait_for_nothing(self) -> None:
        """Let the next pulse come when it is due."""
        self._hold_ns, self._held_by = 0, _LATE

    def _arm(self) -> None:
        if self.interlocks.slept:
            # the clock of the books stood still: what the subject knew may be of yesterday
            for books in (self.limiter, self.confirmed):
                books.known.clear()
        super()._arm()

    def _advance(self) -> int:
        run, now = self.run, self._clock()
        if run is None or self.state is not State.RUNNING or not run.announced:
            return now + LOOK_NS
        trigger_ns = max(run.due_ns - self._trigger_ns, self._hold_ns)
        ahead_ns = nanoseconds(max(self.settings.prepare_s, self.device.prepare_s))
        if run.exhausted or trigger_ns - now > ahead_ns:
            self._rest()
            if not run.exhausted:
                return trigger_ns - ahead_ns
            if now >= run.due_ns:
                self._finish(run)
            return run.due_ns
        if self._set_intensity != run.intensity:
            # never between a preparation and its trigger: that pulse would be late
            if self._felt_ns is not None and now - self._felt_ns >= _READING_LIMIT_NS:
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
            since = self._epoch
            self._heed(self._told(since), since, run.intensity)
            return now
        return begin_ns - _MARGIN_NS

    def _told(self, since: object) -> DeviceStatus:
        """Read back what the device is set to."""
        limit_s = self.settings.stuck_limit_s
        status = self._call('read_back', limit_s, since, self.device.read_back)
        self._answered_ns, self._read = self._clock(), True
        return status

    def _read_late(self, run: Run) -> None:
        """Read the intensity back in a train that leaves no room for it: pulses are given up."""
        needed_ns = self._reading_back_ns + self._preparing_ns + self._trigger_ns
        while not run.exhausted and run.due_ns - self._clock() < needed_ns:
            self._drop(run, _INTENSITY)
        self._verified(run, self._unread[-1].intensity, self._epoch)

    def _verified(self, run: Run, expected: float, since: object) -> tuple[float, bool]:
        """Read back what the last pulse was given with; return that, and whether it was right.

        What is not ``expected`` is a fault, and every pulse since the reading before counts as
        of what was read, if that is more.
        """
        status, unread, self._unread = self._told(since), self._unread, []
        found = status.intensity
        wrong = intensity_fault(found, expected, self.settings.intensity_tolerance)
        # one that was silenced meanwhile is set to zero
        if found is None or (since is not self._epoch and found <= expected):
            return 0.0, False
        if wrong is None:
            self._heed(status, since)
            return found, True
        self.fail('intensity', wrong)
        more = [
            BookedPulse(pulse.time_ns, found, self.limits.energy_j(found) - pulse.energy_j)
            for pulse in unread
            if found > pulse.intensity
        ]
        self._count_more(run, more)
        return found, False

    def _count_more(self, run: Run, pulses: list[BookedPulse]) -> None:
        """Put energy on all books that pulses had beside what was booked before them."""
        now, energy = self._clock(), sum(pulse.energy_j for pulse in pulses)
        for books in (self.limiter, self.confirmed):
            books.book_more(now, energy)
        if self.coil is not None:
            self.coil.heat(now, energy)
        run.energy_j += energy
        with self._deadlines.of('ledger', self.settings.open_limit_s):
            try:
                if pulses and self._reservations is not None:
                    self._reservations.count(pulses)
            except LedgerError as error:
                self.fail('ledger', str(error))

    def _rest(self) -> None:
        """Set intensity zero while no pulse is due."""
        if self._set_intensity != 0.0:
            self._call('rest', self.settings.stuck_limit_s, self._epoch, self.device.rest)
            self._set_intensity = 0.0

    def _read_temperature(self, run: Run, spare_ns: int) -> None:
        """Ask how warm the coil is; if the next pulse would be late by that, it is given up."""
        if spare_ns < self._reading_ns + self._preparing_ns:
            self._drop(run, _READING)
        # a device that does not tell any more costs no more pulses than one that does
        self._felt_ns = self._clock()
        self._ask_status(self._epoch)

    def _prepare(self, run: Run, spare_ns: int) -> None:
        began, since, intensity = self._clock(), self._epoch, run.intensity
        spare_s = max(0, spare_ns) / NANOSECONDS_PER_SECOND
        status = self._call(
            'prepare',
            self.settings.stuck_limit_s,
            since,
            self.device.prepare,
            intensity,
            spare_s,
        )
        self._answered_ns, self._read = self._clock(), False
        if status is None or status.temperature is None:
            self._preparing_ns = self._answered_ns - began
        self._heed(status, since, intensity)
        self._set_intensity = intensity

    def _pulse(self, run: Run) -> None:
        """Fire the pulse that is due, if everything allows it at this very moment."""
        since = self._epoch
        if self._charged is False:
            # after the pulse before it was charging
            self._ask_status(since)
            if self._charged is False:
                self.fail('ready', 'expected a charged device, got one that is not ready')
                return
        if not self._permitted(run):
            return
        pulse, onset_ns = self._booked(run), self._clock() + self._trigger_ns
        latest_ns = pulse.due_ns + nanoseconds(self.settings.lateness_limit_s) - self._trigger_ns
        if since is not self._epoch:
            # a stop came while the books were written
            return
        began = self._clock()
        try:
            delivery = self._call(
                'fire',
                self.settings.stuck_limit_s,
                since,
                self.device.fire,
                pulse.intensity,
                pulse.width_s,
                latest_ns,
            )
        except TooLate:
            self.commanded -= 1
            self._count_dropped(run, _LATE)
            return
        except DeviceError:
            unknown = Delivery(onset_ns, pulse.intensity, frozenset(UNVERIFIED))
            self._tell(dataclasses.replace(pulse, delivery=unknown, answered=False))
            return
        self._answered_ns = self._clock()
        fired = dataclasses.replace(pulse, delivery=delivery)
        self._account(run, fired, began)
        if delivery is not None:
            fired = dataclasses.replace(fired, delivery=self._looked_at(run, delivery, since))
        self._tell(fired)

    def _looked_at(self, run: Run, delivery: Delivery, since: object) -> Delivery:
        """Read the intensity of a pulse back, where there is room; say what is known of it."""
        needed_ns = self._reading_back_ns
        if not run.exhausted:
            needed_ns += self._preparing_ns + self._trigger_ns
            if self._felt_ns is not None and self._clock() - self._felt_ns >= _WARM_NS:
                needed_ns += self._reading_ns
        room = run.exhausted or self._clock() + needed_ns <= run.due_ns
        if 'intensity' not in delivery.unverified or not room or since is not self._epoch:
            return delivery
        try:
            found, right = self._verified(run, delivery.intensity, since)
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
        problem = self.interlocks.problem(now)
        if problem is not None:
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
        elif held_by is not None or not self._reservations_hold(run):
            self._hold_ns, self._held_by = now + AGAIN_NS, held_by or 'ledger'
        else:
            return self.state is State.RUNNING and not self._halts
        return False

    def _reservations_hold(self, run: Run) -> bool:
        return self._reservations is not None and self._reservations.holds(run.cursor)

    def _booked(self, run: Run) -> Fired:
        """Put a pulse on all books right before its trigger, so that a fault counts."""
        pulse = Fired(
            run.due_ns, run.intensity, run.schedule.width_s, self.commanded, None, self.delivered
        )
        try:
            if self._reservations is not None:
                self._reservations.take(run.cursor)
        except LedgerError as error:
            self.fail('ledger', str(error))
            raise DeviceError(str(error)) from error
        onset_ns = self._clock() + self._trigger_ns
        energy = self.limits.energy_j(run.intensity)
        self.limiter.book(onset_ns, run.intensity)
        if self.coil is not None:
            self.coil.heat(onset_ns, energy)
        run.energy_j += energy
        run.cursor += 1
        self.commanded += 1
        if math.isfinite(self.device.read_back_s):
            self._unread.append(BookedPulse(onset_ns, pulse.intensity, energy))
        self._active_ns = onset_ns
        self._set_intensity = None
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
        missing = run.count - run.delivered
        if run.completed:
            self.cancel('completed', 'completed')
        else:
            self.cancel(f'ended with {counted(missing, "pulse")} missing', 'incomplete')

    def _account(self, run: Run, fired: Fired, began_ns: int) -> None:
        """Compare what was delivered with what was commanded."""
        delivery = fired.delivery
        if delivery is None:
            if self.state is State.RUNNING:
                self.fail('lost', 'expected a pulse from the device, got none')
            return
        run.delivered += 1
        self.limiter.correct(delivery.time_ns)
        self.confirmed.book(delivery.time_ns, fired.intensity)
        self.lateness.add(delivery.time_ns - fired.due_ns)
        tolerance = self.settings.intensity_tolerance
        wrong = intensity_fault(delivery.intensity, fired.intensity, tolerance)
        slow_s = (delivery.time_ns - began_ns) / NANOSECONDS_PER_SECOND
        limit_s = self.settings.response_limit_s
        if wrong is not None:
            self.fail('intensity', wrong)
        elif slow_s > limit_s:
            reason = f'expected the pulse within {limit_s:g} s, got it after {slow_s:.3g} s'
            self.fail('slow', reason)

    def _tell(self, fired: Fired) -> None:
        """Count a pulse and tell who wants to know of it."""
        if fired.delivery is not None:
            self.delivered += 1
            self.unverified += bool(fired.delivery.unverified)
        with self._deadlines.of(f'{BUSY}on_fired', self.settings.stuck_limit_s):
            try:
                self.on_fired(fired)
            except Exception as error:  # noqa: BLE001 - nobody knows what it has left behind
                self.fail('callback', f'on_fired: expected no error, got {error!r}')


def _nobody(fired: Fired) -> None:
    """Do nothing."""
    del fired
