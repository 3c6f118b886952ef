# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A driver in virtual time: a clock that only the test moves, a device that notes its commands."""

import contextlib
import dataclasses
from functools import cache

import pytest
from faulty_device import FaultyDevice

from rpms_ros.stimulation import constant
from rpms_ros.stimulation.devices.rapid2 import SerialDevice
from rpms_ros.stimulation.driver.controller import ControllerThreads, StimulationController
from rpms_ros.stimulation.driver.safety_monitor import EMERGENCY_STOP, EXECUTOR, HEARTBEAT
from rpms_ros.stimulation.driver.states import POSSIBLE, DriverSettings, State
from rpms_ros.stimulation.limits.device_specification import load_device_specification
from rpms_ros.stimulation.records.dose_ledger import DoseLedger

SECOND = 1_000_000_000
TRAIN = constant(0.5, 5.0, 20.0)
CALLS = ('open', 'arm', 'prepare', 'fire', 'keep_alive', 'beat', 'rest', 'silence', 'close')


@cache
def cached_specification(name):
    """A specification for a subject who knows every intensity."""
    found = load_device_specification(name)
    known = dataclasses.replace(
        found.limits, maximum_intensity_step=1.0, maximum_intensity_rise=1.0
    )
    return dataclasses.replace(found, limits=known)


@pytest.fixture
def rapid():
    """The device whose public figures come with the package, for such a subject."""
    return cached_specification('rapid2-240v')


class Clock:
    """Virtual monotonic time [ns]."""

    def __init__(self):
        self.now = SECOND
        # what other threads do while one waits
        self.meanwhile = []
        # what other threads do right before somebody looks at the clock
        self.between = None

    def __call__(self):
        if self.between is not None:
            self.between()
        return self.now

    def stall(self, seconds):
        """The whole machine stands still."""
        self.now += round(seconds * SECOND)

    def wait(self, seconds):
        self.stall(seconds)
        for other in self.meanwhile:
            other()


class NotingDevice(FaultyDevice):
    """Notes what it was asked for, and when it fired what it was told to.

    ``instead`` maps the name of a call to what is done instead of it.
    """

    def __init__(self, clock, **options):
        self.commands, self.calls, self.instead = [], [], {}
        self.clock = clock
        super().__init__(clock=lambda: clock.now, wait=clock.wait, **options)

    def __getattribute__(self, name):
        found = super().__getattribute__(name)
        if name not in CALLS:
            return found
        self.calls.append(name)
        return self.instead.get(name, found)

    def hang(self, seconds):
        """Return a call that takes so long and can be interrupted by nobody."""

        def call(*arguments):
            del arguments
            end = self.clock.now + round(seconds * SECOND)
            while self.clock.now < end:
                self.clock.wait(1e-3)

        return call

    def fire(self, intensity, width_s, latest_ns=None):
        prepared = intensity == self.intensity or self.faults.foreign_intensity is not None
        assert prepared or not self.armed
        began = self.clock.now
        given = super().fire(intensity, width_s, latest_ns)
        self.commands.append((given.time_ns if given else began, intensity))
        return given


class Driver:
    """A controller in virtual time."""

    def __init__(
        self,
        limits=None,
        specification='simulated',
        ledger=None,
        steps=0,
        wire=None,
        heartbeat_s=None,
        **settings,
    ):
        self.clock = Clock()
        self.device = NotingDevice(self.clock, steps=steps, wire=wire)
        chosen = cached_specification(specification)
        if limits is not None:
            chosen = dataclasses.replace(chosen, limits=limits)
        self.controller = StimulationController(
            self.device, chosen, DriverSettings(**settings), self.clock, ledger
        )
        if heartbeat_s is not None:
            self.controller.interlocks.require(HEARTBEAT, heartbeat_s)
        self.fired = []
        self.controller.on_fired = self.fired.append
        self.clock.meanwhile.append(self.look)
        self.alive = True
        self.look()

    def look(self):
        """Let executor and supervisor have their turn."""
        if self.alive:
            self.controller.seen(EXECUTOR)
            self.controller.seen(HEARTBEAT)
        self.controller.supervise()
        self.controller.reserve()

    def due_ns(self):
        """When the next pulse or the end of the run is due [ns], None without a run."""
        run = self.controller.run
        running = self.controller.state is State.RUNNING and not self.controller._halts
        return run.due_ns if running else None

    def once_booked(self, do):
        """Let something happen when the next pulse has passed every check and is in the books."""
        booked = self.controller._booked

        def meanwhile(run):
            self.controller._booked = booked
            pulse = booked(run)
            do()
            return pulse

        self.controller._booked = meanwhile

    def press_stop(self):
        self.controller.interlocks.open(EMERGENCY_STOP, 'emergency stop is pressed')
        self.controller.stop(EMERGENCY_STOP, 'emergency stop')

    def release_stop(self):
        self.controller.interlocks.close(EMERGENCY_STOP)

    def armed(self):
        self.controller.configure()
        self.controller.arm()
        return self

    def started(self, schedule=TRAIN, seconds=0.0):
        """Arm, start a schedule and let time pass."""
        self.armed().controller.start(schedule)
        self.advance(seconds)
        return self

    @property
    def run(self):
        return self.controller.run

    def advance(self, seconds, late_ns=0):
        """Let time pass; the owner's turns come when they are due, those with a pulse later."""
        end = self.clock.now + round(seconds * SECOND)
        while True:
            following = self.controller.step()
            self.look()
            late = late_ns if following == self.due_ns() else 0
            if following + late > end:
                break
            self.clock.now = max(self.clock.now, following + late)
        self.clock.now = max(self.clock.now, end)
        self.look()


@pytest.fixture
def armed_on_the_line(tmp_path, any_lateness):
    """Arm a controller of a simulated instrument on a line, for a device specification.

    Return it, and what keeps its executor alive.
    """
    del any_lateness

    def arm(fake, specification):
        controller = StimulationController(
            SerialDevice(fake.port, timeout_s=5.0, beat_limit_s=20.0),
            dataclasses.replace(specification, serial_number='rapid2'),
            # a machine under load may hold up a thread or two
            DriverSettings(
                executor_timeout_s=5.0,
                lateness_limit_s=5.0,
                response_limit_s=5.0,
                stuck_limit_s=5.0,
                supervisor_timeout_s=5.0,
            ),
            ledger=DoseLedger(tmp_path, 'rapid2', 'test'),
        )
        threads = ControllerThreads(controller)
        threads.start()
        armed.callback(threads.close)
        armed.callback(controller.cleanup)
        controller.configure()

        def alive():
            controller.seen(EXECUTOR)
            return True

        alive()
        controller.arm()
        return controller, alive

    with contextlib.ExitStack() as armed:
        yield arm


@pytest.fixture
def virtual():
    """A driver in virtual time: the class, to be built with limits, specification and settings."""
    return Driver


@pytest.fixture
def running(virtual):
    """A driver in the middle of a train."""
    driver = virtual().started(seconds=0.52)
    assert len(driver.device.commands) == 10
    return driver


@pytest.fixture
def driver_in(virtual):
    """Return a driver that came to a state in the ordinary way."""

    def build(state):
        driver = virtual()
        if state is not State.UNCONFIGURED:
            driver.controller.configure()
        if state is State.FAULT:
            driver.controller.fail('test', 'a test')
        if state in POSSIBLE:
            driver.controller.arm()
        if state is State.RUNNING:
            driver.controller.start(constant(0.5, 0.5, 20.0))
        assert driver.controller.state is state
        return driver

    return build


@pytest.fixture
def fake(instrument):
    """An instrument on a pseudo-terminal, whose own watchdog comes last."""
    return instrument(watchdog_s=20.0)


@pytest.fixture
def patient_device():
    """Build a serial device that waits for a machine under load: instrument, guard and test."""
    with contextlib.ExitStack() as built:

        def build(port, opened=True, **options):
            device = SerialDevice(port, timeout_s=5.0, beat_limit_s=20.0, **options)
            built.callback(device.close)
            if opened:
                device.open()
            return device

        yield build


@pytest.fixture
def device(fake, patient_device):
    """The serial device on it, open."""
    return patient_device(fake.port)
