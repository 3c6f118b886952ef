# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The owner of a device: the one thread that talks to it, watched by another.

What others want comes as orders.  Each turn of the owner and each of its calls has a deadline,
which the supervisor watches: a device that hangs is silenced out of band and latched as a fault,
and what its call returns later is ignored.

Orders to the owner of a device: put in by any thread, done by one, answered in time or not.

Deadlines of the thread that owns the device, held by the thread that supervises it.

Faults that a device reports.
"""

import math
import queue
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeVar

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation.devices.registry import Device, DeviceError, DeviceStatus, TooLate
from rpms_ros.stimulation.driver.safety_monitor import SUPERVISOR, Halt, SafetyMonitor
from rpms_ros.stimulation.driver.states import POSSIBLE, Command, DriverSettings, State, after
from rpms_ros.stimulation.limits.coil_temperature import CoilTemperature
from rpms_ros.stimulation.limits.limiter import Limits

Result = TypeVar('Result')


class NoAnswer(StimulationError):
    """The owner of the device did not answer in time.

    Attributes
    ----------
    begun : bool
        Whether it had begun with the order, and hangs in it.
    """

    def __init__(self, limit_s: float, begun: bool) -> None:
        super().__init__(f'expected the driver to answer within {limit_s:g} s, got no answer')
        self.begun = begun


class Orders:
    """A queue of orders.

    Parameters
    ----------
    wake : threading.Event
        Set when there is something to do.

    Attributes
    ----------
    owner : threading.Thread or None
        Who does them; without a living one, whoever asks does.
    """

    def __init__(self, wake: threading.Event) -> None:
        self.owner: threading.Thread | None = None
        self._wake = wake
        self._queue: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = queue.SimpleQueue()

    def ask(self, do: Callable[[], Result], limit_s: float, keep: bool = False) -> Result:
        """Have something done by the owner, and return or raise what it returns or raises.

        Parameters
        ----------
        do : callable
            What is to be done.
        limit_s : float
            How long to wait for the answer [s].
        keep : bool
            Whether it is to be done even after that.

        Raises
        ------
        NoAnswer
            If there was none in time.
        """
        owner = self.owner
        if owner is None or owner is threading.current_thread() or not owner.is_alive():
            return do()
        answer: Future[Result] = Future()
        self._queue.put((do, answer))
        self._wake.set()
        try:
            return answer.result(limit_s)
        except TimeoutError:
            begun = answer.running() if keep else not answer.cancel()
            if answer.done() and not answer.cancelled():
                return answer.result()
            raise NoAnswer(limit_s, begun) from None

    def serve(self) -> None:
        """Do what was ordered; called by the owner."""
        while not self._queue.empty():
            do, answer = self._queue.get_nowait()
            if not answer.set_running_or_notify_cancel():
                continue
            try:
                answer.set_result(do())
            except Exception as error:  # noqa: BLE001 - it is raised where it was asked for
                answer.set_exception(error)


class Deadline(NamedTuple):
    """When the owner has to have finished something.

    Attributes
    ----------
    name : str
        What it does.
    limit_s : float
        How long that may take [s].
    until_ns : int
        When it must be over [ns].
    """

    name: str
    limit_s: float
    until_ns: int


class Deadlines:
    """The deadline of what the owner does now; of nested ones the inner one counts.

    Parameters
    ----------
    clock : callable
        Monotonic time [ns].
    held_up_ns : int
        A supervisor whose own turn comes this late was held up, and the owner may have been with
        it [ns].
    """

    def __init__(self, clock: Callable[[], int], held_up_ns: int) -> None:
        self._clock, self._held_up_ns = clock, held_up_ns
        self._now: Deadline | None = None
        # when the supervisor looked last, and the deadline that it has looked past once
        self._looked_ns = clock()
        self._excused: Deadline | None = None

    @contextmanager
    def of(self, name: str, limit_s: float) -> Iterator[None]:
        """Have the supervisor watch that something ends in time."""
        outer = self._now
        self._now = Deadline(name, limit_s, self._clock() + nanoseconds(limit_s))
        try:
            yield
        finally:
            if outer is not None:
                outer = outer._replace(until_ns=self._clock() + nanoseconds(outer.limit_s))
            self._now = outer

    def missed(self, now_ns: int) -> Deadline | None:
        """Return a deadline that was missed, once; called by the supervisor at each of its turns.

        If that turn itself came late, the deadline is looked at once more in the next one: a
        machine that stood still held both threads up, and the owner may be back at once.
        """
        held_up = now_ns - self._looked_ns > self._held_up_ns
        self._looked_ns = now_ns
        missed = self._now
        if missed is None or now_ns <= missed.until_ns:
            return None
        if held_up and missed is not self._excused:
            self._excused = missed
            return None
        self._now = None
        return missed


def intensity_fault(given: float | None, expected: float | None, tolerance: float) -> str | None:
    """Return what is wrong with an intensity that was read back, None if no fault is known.

    Parameters
    ----------
    given : float or None
        What the device says (share).
    expected : float or None
        What it was set to (share).
    tolerance : float
        Largest difference that is rounding (share).
    """
    # written so that NaN is wrong
    if given is None or expected is None or abs(given - expected) <= tolerance:
        return None
    return f'expected intensity {expected:.3g} from the device, got {given:.3g}'


def _denied(flag: object) -> bool:
    """Return whether a device says no, be it by a bit or a number of NumPy; None is no answer."""
    return flag is not None and not flag


def fault_of(status: DeviceStatus, told: float | None, tolerance: float) -> tuple[str, str] | None:
    """Return name and reason of why an armed device must not fire, None if nothing is wrong.

    Whether it is charged is asked right before a pulse: after the one before it takes its time.
    """
    wrong = intensity_fault(status.intensity, told, tolerance)
    if _denied(status.coil_present):
        return 'coil', 'expected a coil, got none'
    if status.replace_coil:
        return 'coil', 'expected a usable coil, got one to be replaced'
    if status.error:
        return 'error', 'expected a device without an error, got one'
    if _denied(status.armed):
        return 'armed', 'expected an armed device, got a disarmed one'
    return None if wrong is None else ('intensity', wrong)


# How often the owner and the supervisor look around when nothing is due: a device wants a sign
# of life from the owner every 50 ms.
LOOK_NS = 20_000_000
# When something that could not be done is tried again.
AGAIN_NS = 1_000_000
# A status with a temperature takes 20 ms at 9600 baud; one that comes sooner may be an exception.
_READING_NS = 30_000_000
# A turn of the supervisor that comes this late was held up.
_HELD_UP_NS = 5 * LOOK_NS
# How much longer than its calls may take a turn of the owner is waited for.
_SLACK_S = 0.3


class DeviceOwner(SafetyMonitor):
    """Opens, arms, keeps alive and closes a device.

    Parameters
    ----------
    device : Device
        What gives the pulses.
    settings : DriverSettings
        How the driver watches over itself.
    limits : Limits
        Of the device.
    coil : CoilTemperature or None
        Model of the coil.
    clock : callable
        Monotonic time [ns].
    """

    def __init__(
        self,
        device: Device,
        settings: DriverSettings,
        limits: Limits,
        coil: CoilTemperature | None,
        clock: Callable[[], int],
    ) -> None:
        super().__init__(device, settings, clock)
        self.limits, self.coil = limits, coil
        self.orders = Orders(self.wake)
        self._deadlines = Deadlines(clock, _HELD_UP_NS)
        # when the device was armed, when it was armed or fired last, and when it answered last
        self._armed_ns = self._active_ns = self._answered_ns = 0
        # how long it takes to be kept alive
        self._keeping_ns = 30_000_000
        # when a temperature was measured last, None before the first, and how long that takes
        self._measured_ns: int | None = None
        self._reading_ns = _READING_NS
        # what the device was told and what it said
        self._set_intensity = 0.0
        self._charging = False
        self._since = self._settle()

    def configure(self) -> None:
        """Open the device.

        Raises
        ------
        StimulationError
            If it is open already or does not answer; it is closed again then.
        """
        self._order(self._open, self.settings.open_limit_s)

    def arm(self) -> None:
        """Make pulses possible.

        Raises
        ------
        Refused
            If a stop is latched or an interlock is open.
        StimulationError
            If the state does not allow it or the device does not answer.
        """
        self._order(self._arm, self.device.arm_s)

    def cleanup(self, reason: str = 'device closed') -> None:
        """Close the device, in any state; one that hangs is closed when its call returns.

        Until then it is not opened again.
        """
        self.disarm(reason)
        limit_s = self.settings.stuck_limit_s + _SLACK_S
        try:
            self.orders.ask(lambda: self._close(reason), limit_s, keep=True)
        except NoAnswer:
            self._halt(Halt(Command.CLEANUP, f'{reason}; the device hangs', 'disarmed'))

    def supervise(self) -> int:
        """Watch over everything else; return when to do so again [ns].

        Called by a thread of its own.
        """
        now = self._clock()
        self.seen(SUPERVISOR)
        self._apply_halts()
        if (missed := self._deadlines.missed(now)) is not None:
            late = f'expected an answer within {missed.limit_s:g} s, got none'
            self.fail('stuck', f'{missed.name}: {late}')
        # also while no pulse is possible: a coil that has cooled may be used again
        if self.coil is not None:
            self.temperature(self.coil.at(now))
        if self.state not in POSSIBLE:
            return now + LOOK_NS
        if (problem := self.interlocks.problem(now, self._armed_ns)) is not None:
            self.stop(*problem)
        elif now - self._active_ns > nanoseconds(self.limits.idle_disarm_s):
            self.count('idle')
            self.disarm(f'idle: no pulse for {self.limits.idle_disarm_s:g} s while armed')
        return now + LOOK_NS

    @property
    def coil_temperature(self) -> float:
        """Temperature of the coil [Celsius], measured or modelled; NaN if neither is known."""
        return math.nan if self.coil is None else self.coil.at(self._clock())

    def _order(self, do: Callable[[], Result], limit_s: float) -> Result:
        """Have the owner do something; if it does not return from it, that is a fault."""
        try:
            return self.orders.ask(do, limit_s + self.settings.stuck_limit_s + _SLACK_S)
        except NoAnswer as error:
            if error.begun:
                self.fail('stuck', str(error))
            raise

    def _open(self) -> None:
        since = self._settle()
        after(self.state, Command.CONFIGURE)
        began, limit_s = self._clock(), self.settings.open_limit_s
        try:
            self._call('open', since, self.device.open, limit_s=limit_s)
            self._answered_ns = self._clock()
            if self._answered_ns - began > nanoseconds(limit_s):
                # who asked for it does not wait any more
                late = f'expected an answer within {limit_s:g} s, got a later one'
                raise DeviceError(f'open: {late}')
            # a stop that came before stays latched, and is the reason
            reason = self.interlocks.latched_reason or 'device open, disarmed'
            self._enter(Command.CONFIGURE, reason, since)
        except StimulationError as error:
            self._close(str(error))
            raise

    def _arm(self) -> None:
        since = self._settle()
        after(self.state, Command.ARM)
        self.interlocks.awake()
        self._refuse_if_open()
        limit_s = self.device.arm_s + self.settings.stuck_limit_s
        status = self._call('arm', since, self.device.arm, limit_s=limit_s)
        if status is None and since is self._epoch:
            self.fail('device', 'arm: expected the status of the device, got none')
            raise DeviceError(self.reason)
        self._use_status(status, since, 0.0)
        self._armed_ns = self._active_ns = self._answered_ns = self._clock()
        self._set_intensity = 0.0
        self._enter(Command.ARM, 'armed', since)

    def _close(self, reason: str) -> None:
        """Close the device; one that does not close is given up."""
        with self._deadlines.of('close', self.settings.open_limit_s):
            try:
                self.device.close()
            except Exception as error:  # noqa: BLE001 - nothing more can be done about it
                self.count('device')
                reason = f'{reason}; {error}'
        self._halt(Halt(Command.CLEANUP, reason, 'disarmed'))

    def _call(
        self,
        name: str,
        since: object,
        do: Callable[..., Result],
        *arguments: object,
        limit_s: float | None = None,
    ) -> Result:
        """Call a device, or other code that may fail or hang, with a deadline.

        Parameters
        ----------
        name : str
            What it is called for.
        since : object
            The epoch in which this was decided: a halt since then has to be heard by a device
            that has just been asked for something else.
        do : callable
            What is called, with ``arguments``.
        limit_s : float, optional
            How long it may take [s]; ``stuck_limit_s`` if it is missing.

        Raises
        ------
        DeviceError
            Whatever went wrong: a fault already, unless there was a halt.  `TooLate` is none.
        """
        with self._deadlines.of(name, limit_s or self.settings.stuck_limit_s):
            try:
                return do(*arguments)
            except TooLate:
                raise
            except Exception as error:
                reason = str(error)
                if not isinstance(error, StimulationError):
                    reason = f'{name}: expected no error, got {error!r}'
                # one that was silenced in the middle of something may well complain
                if since is self._epoch:
                    self.fail('device', reason)
                raise DeviceError(reason) from error
            finally:
                if since is not self._epoch:
                    self._silence()
                    self._apply_halts()

    def _settle(self) -> object:
        """Return the epoch from before the state: what is decided by that is decided in it."""
        since = self._epoch
        self._apply_halts()
        return since

    def _keep_alive(self, due_ns: int) -> None:
        """Keep the device alive if nothing else has, at a moment when no pulse is due."""
        now = self._clock()
        silent_ns = now - self._answered_ns
        keep_ns = nanoseconds(self.settings.keep_alive_s)
        if self.state not in (State.DISARMED, *POSSIBLE) or silent_ns < keep_ns:
            return
        # in a train that leaves no room for it a pulse is given up, but not at once
        no_room = self.state is State.RUNNING and due_ns - now < self._keeping_ns
        if no_room and silent_ns < 2 * keep_ns:
            return
        self._ask_status(self._since)
        self._keeping_ns = self._clock() - now

    def _ask_status(self, since: object) -> None:
        began = self._clock()
        status = self._call('keep_alive', since, self.device.keep_alive)
        self._answered_ns = self._clock()
        if since is self._epoch and status.temperature is not None:
            self._reading_ns = max(_READING_NS, self._answered_ns - began)
        if self.state in POSSIBLE:
            self._use_status(status, since, self._set_intensity)
        elif since is self._epoch:
            self._apply_temperature(status)

    def _apply_temperature(self, status: DeviceStatus) -> None:
        """Take over a temperature that was measured."""
        if status.temperature is None:
            return
        self._measured_ns = self._clock()
        if self.coil is not None:
            if (wrong := self.coil.doubt(self._measured_ns, status.temperature)) is not None:
                # the model goes on without it
                self.fail('temperature', f'temperature: {wrong}')
                raise DeviceError(wrong)
            self.coil.measured(self._measured_ns, status.temperature)
        self.temperature(status.temperature)

    def _use_status(self, status: DeviceStatus | None, since: object, told: float | None) -> None:
        """Take the status of a device into account.

        Parameters
        ----------
        status : DeviceStatus or None
            What it says.
        since : object
            The epoch in which it was asked: one that was silenced since says that it is disarmed.
        told : float or None
            The intensity that was set (share), if it is to be compared.

        Raises
        ------
        DeviceError
            If it must not fire; it is a fault already.
        """
        if status is None or since is not self._epoch:
            return
        self._charging = _denied(status.ready)
        self._apply_temperature(status)
        if (fault := fault_of(status, told, self.settings.intensity_tolerance)) is not None:
            self.fail(*fault)
            raise DeviceError(fault[1])
