# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The owner of a device: the one thread that talks to it, watched by another.

What others want comes as orders.  Each turn of the owner and each of its calls has a deadline,
which the supervisor watches: a device that hangs is silenced out of band and latched as a fault,
and what its call returns later is ignored.
"""

import math
from collections.abc import Callable
from typing import NamedTuple
from typing import ParamSpec
from typing import TypeVar

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation.deadlines import Deadlines
from rpms_ros.stimulation.device_faults import fault_of
from rpms_ros.stimulation.devices.interface import Device
from rpms_ros.stimulation.devices.interface import DeviceError
from rpms_ros.stimulation.devices.interface import DeviceStatus
from rpms_ros.stimulation.devices.interface import TooLate
from rpms_ros.stimulation.interlocks import BUSY
from rpms_ros.stimulation.interlocks import Refused
from rpms_ros.stimulation.limits import Limits
from rpms_ros.stimulation.orders import NoAnswer
from rpms_ros.stimulation.orders import Orders
from rpms_ros.stimulation.safety_monitor import POSSIBLE
from rpms_ros.stimulation.safety_monitor import SUPERVISOR
from rpms_ros.stimulation.safety_monitor import Halt
from rpms_ros.stimulation.safety_monitor import SafetyMonitor
from rpms_ros.stimulation.settings import DriverSettings
from rpms_ros.stimulation.states import Command
from rpms_ros.stimulation.states import State
from rpms_ros.stimulation.states import after
from rpms_ros.stimulation.thermal import CoilTemperature

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

Arguments = ParamSpec('Arguments')
Result = TypeVar('Result')


class Equipment(NamedTuple):
    """What a driver drives.

    Attributes
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

    device: Device
    settings: DriverSettings
    limits: Limits
    coil: CoilTemperature | None
    clock: Callable[[], int]


class DeviceOwner(SafetyMonitor):
    """Opens, arms, keeps alive and closes a device.

    Parameters
    ----------
    equipment : Equipment
        The device, and what belongs to it.
    """

    def __init__(self, equipment: Equipment) -> None:
        super().__init__(equipment.device, equipment.settings, equipment.clock)
        self.limits = equipment.limits
        self.coil = equipment.coil
        self.orders = Orders(self.wake)
        self._deadlines = Deadlines(equipment.clock, _HELD_UP_NS)
        # when the device was armed, and when it was armed or fired last
        self._armed_ns = 0
        self._active_ns = 0
        # when the device answered last, and how long it takes to be kept alive
        self._answered_ns = 0
        self._keeping_ns = 30_000_000
        # when a temperature was measured last, None before the first, and how long that takes
        self._felt_ns: int | None = None
        self._reading_ns = _READING_NS
        # what the device was told and what it said
        self._set_intensity: float | None = None
        self._charged: bool | None = None

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
        try:
            self.orders.ask(
                lambda: self._close(reason), self.settings.stuck_limit_s + _SLACK_S, keep=True
            )
        except NoAnswer:
            self._halt(Halt(Command.CLEANUP, f'{reason}; the device hangs', 'disarmed'))

    def step(self) -> int:
        """Do what is due; return when there is more to do [ns].  Called by the owner alone."""
        due_ns = None
        limit_s = self.settings.stuck_limit_s
        with self._deadlines.of(f'{BUSY}a turn of the driver', limit_s):
            try:
                self._apply_halts()
                self.orders.serve()
                due_ns = self._advance()
                self._keep_alive(due_ns)
                if self.state in (State.DISARMED, *POSSIBLE):
                    self._call('beat', limit_s, self._epoch, self.device.beat)
            except DeviceError:
                # it was dealt with where it came up
                pass
            except Exception as error:  # noqa: BLE001 - whatever it is, nothing may go on
                self.fail('owner', f'expected a turn of the driver without error, got {error!r}')
        now = self._clock()
        return min(now + AGAIN_NS if due_ns is None else due_ns, now + LOOK_NS)

    def supervise(self) -> None:
        """Watch over everything else; called steadily by a thread of its own."""
        now = self._clock()
        self.seen(SUPERVISOR)
        self._apply_halts()
        missed = self._deadlines.missed(now)
        if missed is not None:
            self.fail(
                'stuck',
                f'{missed.name}: expected an answer within {missed.limit_s:g} s, got none',
            )
        # also while no pulse is possible: a coil that has cooled may be used again
        if self.coil is not None:
            self.temperature(self.coil.at(now))
        if self.state not in POSSIBLE:
            return
        problem = self.interlocks.problem(now, self._armed_ns)
        idle_s = (now - self._active_ns) / NANOSECONDS_PER_SECOND
        if problem is not None:
            self.stop(*problem)
        elif idle_s > self.limits.idle_disarm_s:
            self.count('idle')
            self.disarm(f'idle: no pulse for {self.limits.idle_disarm_s:g} s while armed')

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
        after(self.state, Command.CONFIGURE)
        began, limit_s = self._clock(), self.settings.open_limit_s
        try:
            self._call('open', limit_s, self._epoch, self.device.open)
            self._answered_ns = self._clock()
            if self._answered_ns - began > nanoseconds(limit_s):
                # who asked for it does not wait any more
                raise DeviceError(
                    f'open: expected an answer within {limit_s:g} s, got a later one'
                )
        except DeviceError as error:
            self._close(str(error))
            raise
        # a stop that came before or meanwhile stays latched, and is the reason
        reason = self.interlocks.latched_reason or 'device open, disarmed'
        self._enter(Command.CONFIGURE, reason, self._epoch)

    def _arm(self) -> None:
        after(self.state, Command.ARM)
        self.interlocks.awake()
        self._refuse_if_open()
        since, limit_s = self._epoch, self.device.arm_s + self.settings.stuck_limit_s
        status = self._call('arm', limit_s, since, self.device.arm)
        self._heed(status, since, 0.0)
        self._armed_ns = self._active_ns = self._answered_ns = self._clock()
        self._set_intensity = 0.0
        if not self._enter(Command.ARM, 'armed', since):
            self._silence()
            raise Refused('stop', f'arm: expected no stop meanwhile, got one: {self.reason}')

    def _close(self, reason: str) -> None:
        """Close the device; one that does not close is given up."""
        with self._deadlines.of('close', self.settings.open_limit_s):
            try:
                self.device.close()
            except Exception as error:  # noqa: BLE001 - nothing more can be done about it
                self.count('device')
                reason = f'{reason}; {error}'
        self._halt(Halt(Command.CLEANUP, reason, 'disarmed'))

    def _advance(self) -> int:
        """Do what a run asks for; return when there is more to do [ns]."""
        return self._clock() + LOOK_NS

    def _call(
        self,
        name: str,
        limit_s: float,
        since: object,
        do: Callable[Arguments, Result],
        *arguments: Arguments.args,
        **options: Arguments.kwargs,
    ) -> Result:
        """Call a device, or other code that may fail or hang, with a deadline.

        Parameters
        ----------
        name : str
            What it is called for.
        limit_s : float
            How long it may take [s].
        since : object
            The epoch in which this was decided: a halt since then has to be heard by a device
            that has just been asked for something else.

        Raises
        ------
        DeviceError
            Whatever went wrong: a fault already, unless there was a halt.  `TooLate` is none.
        """
        with self._deadlines.of(name, limit_s):
            try:
                return do(*arguments, **options)
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
        self._ask_status(self._epoch)
        self._keeping_ns = self._clock() - now

    def _ask_status(self, since: object) -> None:
        began, limit_s = self._clock(), self.settings.stuck_limit_s
        status = self._call('keep_alive', limit_s, since, self.device.keep_alive)
        self._answered_ns = self._clock()
        if since is self._epoch and status.temperature is not None:
            self._reading_ns = max(_READING_NS, self._answered_ns - began)
        if self.state in POSSIBLE:
            self._heed(status, since, self._set_intensity)
        elif since is self._epoch:
            self._feel(status)

    def _feel(self, status: DeviceStatus) -> None:
        """Take over a temperature that was measured."""
        if status.temperature is not None:
            self._felt_ns = self._clock()
            if self.coil is not None:
                wrong = self.coil.doubt(self._felt_ns, status.temperature)
                if wrong is not None:
                    # the model goes on without it
                    self.fail('temperature', f'temperature: {wrong}')
                    raise DeviceError(wrong)
                self.coil.measured(self._felt_ns, status.temperature)
            self.temperature(status.temperature)

    def _heed(
        self, status: DeviceStatus | None, since: object, expected: float | None = None
    ) -> None:
        """Take the status of a device into account.

        Parameters
        ----------
        status : DeviceStatus or None
            What it says.
        since : object
            The epoch in which it was asked: one that was silenced since says that it is disarmed.
        expected : float, optional
            The intensity that was set (share).

        Raises
        ------
        DeviceError
            If it must not fire; it is a fault already.
        """
        if status is None or since is not self._epoch:
            return
        self._charged = status.ready
        self._feel(status)
        fault = fault_of(status, expected, self.settings.intensity_tolerance)
        if fault is not None:
            self.fail(*fault)
            raise DeviceError(fault[1])
