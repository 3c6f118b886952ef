"""A driver in virtual time: a clock that only the test moves, a device that notes its commands."""

import dataclasses
from functools import cache

import pytest

from rpms_ros.stimulation.controller import StimulationController
from rpms_ros.stimulation.device_specification import load_device_specification
from rpms_ros.stimulation.devices import SimulatedDevice
from rpms_ros.stimulation.safety_monitor import EXECUTOR
from rpms_ros.stimulation.safety_monitor import HEARTBEAT
from rpms_ros.stimulation.settings import DriverSettings

MILLISECOND = 1_000_000
SECOND = 1_000_000_000


@cache
def cached_specification(name):
    """A specification for a subject who knows every intensity."""
    found = load_device_specification(name)
    known = dataclasses.replace(found.limits, maximum_intensity_step=1.0)
    return dataclasses.replace(found, limits=known)


class Clock:
    """Virtual monotonic time [ns]."""

    def __init__(self):
        self.now = SECOND

    def __call__(self):
        return self.now

    def wait(self, seconds):
        self.now += round(seconds * SECOND)


class NotingDevice(SimulatedDevice):
    """Notes when it fired what it was told to, and that it is armed whenever it is told."""

    def __init__(self, clock, **options):
        super().__init__(clock=clock, wait=clock.wait, **options)
        self.commands = []
        self.clock = clock

    def fire(self, intensity, width_s, latest_ns=None):
        assert self.armed
        given = super().fire(intensity, width_s, latest_ns)
        self.commands.append((given.time_ns if given else self.clock.now, intensity))
        return given


class Driver:
    """A controller in virtual time."""

    def __init__(self, limits=None, specification='simulated', **settings):
        self.clock = Clock()
        self.device = NotingDevice(self.clock)
        chosen = cached_specification(specification)
        if limits is not None:
            chosen = dataclasses.replace(chosen, limits=limits)
        watched = {'heartbeat_timeout_s': 0.0, **settings}
        self.controller = StimulationController(
            self.device, chosen, DriverSettings(**watched), self.clock
        )
        self.alive = True
        self.look()

    @property
    def faults(self):
        return self.device.faults

    @faults.setter
    def faults(self, faults):
        self.device.faults = faults

    def look(self):
        """Let executor and supervisor have their turn."""
        if self.alive:
            self.controller.seen(EXECUTOR)
            self.controller.seen(HEARTBEAT)
        self.controller.supervise()

    def armed(self):
        self.controller.configure()
        self.controller.arm()
        return self

    def advance(self, seconds, late_ns=0):
        """Let time pass; pulses fire when they are due, or later."""
        end = self.clock.now + round(seconds * SECOND)
        while self.clock.now < end:
            due = self.controller.due_ns()
            step = min(end, self.clock.now + 50 * MILLISECOND)
            if due is not None and due + late_ns <= step:
                self.clock.now = max(self.clock.now, due + late_ns)
                self.controller.fire_next()
            else:
                self.clock.now = step
            self.look()


@pytest.fixture
def virtual():
    """A driver in virtual time: the class, to be built with limits, specification and settings."""
    return Driver
