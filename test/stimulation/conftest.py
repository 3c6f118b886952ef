"""A driver in virtual time: a clock that only the test moves, a device that notes its commands."""

import dataclasses
from functools import cache

import pytest

from rpms_ros.stimulation.core import StimulatorCore
from rpms_ros.stimulation.devices import SimulatedDevice
from rpms_ros.stimulation.guard import EXECUTOR
from rpms_ros.stimulation.guard import HEARTBEAT
from rpms_ros.stimulation.profile import load_profile
from rpms_ros.stimulation.settings import DriverSettings

MILLISECOND = 1_000_000
SECOND = 1_000_000_000


cached_profile = cache(load_profile)


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

    def fire(self, intensity, width_s):
        assert self.armed
        given = super().fire(intensity, width_s)
        self.commands.append((given.time_ns if given else self.clock.now, intensity))
        return given


class Driver:
    """A core in virtual time."""

    def __init__(self, limits=None, profile='simulated', **settings):
        self.clock = Clock()
        self.device = NotingDevice(self.clock)
        chosen = cached_profile(profile)
        if limits is not None:
            chosen = dataclasses.replace(chosen, limits=limits)
        watched = {'heartbeat_timeout_s': 0.0, **settings}
        self.core = StimulatorCore(self.device, chosen, DriverSettings(**watched), self.clock)
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
            self.core.seen(EXECUTOR)
            self.core.seen(HEARTBEAT)
        self.core.supervise()

    def armed(self):
        self.core.configure()
        self.core.arm()
        return self

    def advance(self, seconds, late_ns=0):
        """Let time pass; pulses fire when they are due, or later."""
        end = self.clock.now + round(seconds * SECOND)
        while self.clock.now < end:
            due = self.core.due_ns()
            step = min(end, self.clock.now + 50 * MILLISECOND)
            if due is not None and due + late_ns <= step:
                self.clock.now = max(self.clock.now, due + late_ns)
                self.core.fire_next()
            else:
                self.clock.now = step
            self.look()


@pytest.fixture
def virtual():
    """A driver in virtual time: the class, to be built with limits, profile and settings."""
    return Driver
