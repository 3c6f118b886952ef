# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The threads in real time: pulses when they are due, hangs that others notice, ends that stop."""

import threading
from functools import partial

import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import constant
from rpms_ros.stimulation.devices.simulated import SimulatedDevice
from rpms_ros.stimulation.driver.controller import ControllerThreads, StimulationController
from rpms_ros.stimulation.driver.device_owner import NoAnswer
from rpms_ros.stimulation.driver.safety_monitor import EXECUTOR
from rpms_ros.stimulation.driver.states import DriverSettings, State
from rpms_ros.stimulation.limits.device_specification import load_device_specification

CALLS = ('open', 'prepare', 'fire', 'rest', 'beat', 'silence')


class HangingDevice(SimulatedDevice):
    """Hangs in one of its calls until it is let go; nothing interrupts it."""

    def __init__(self):
        self.hangs_in = ''
        self.let_go = threading.Event()
        self.hanging = threading.Event()
        self.closed = 0
        super().__init__()

    def __getattribute__(self, name):
        found = super().__getattribute__(name)
        return partial(self.held, found) if name in CALLS else found

    def held(self, call, *arguments):
        if call.__name__ == self.hangs_in:
            self.hanging.set()
            assert self.let_go.wait(60.0)
        return call(*arguments)

    def close(self):
        self.closed += 1
        super().close()


@pytest.fixture
def driver(any_lateness):
    """A driver with its threads; a machine under load may be slow."""
    del any_lateness
    settings = DriverSettings(
        executor_timeout_s=10.0,
        supervisor_timeout_s=10.0,
        lateness_limit_s=5.0,
        response_limit_s=5.0,
        stuck_limit_s=2.0,
        open_limit_s=2.0,
    )
    controller = StimulationController(
        HangingDevice(), load_device_specification('simulated'), settings
    )
    fired = []
    controller.on_fired = fired.append
    threads = ControllerThreads(controller)
    threads.start()
    yield controller, fired, threads
    controller.device.let_go.set()
    threads.close()
    assert not any(thread.is_alive() for thread in threads._threads.values())


@pytest.fixture
def running(driver):
    """The same, armed."""
    controller, *_ = driver
    controller.configure()
    controller.seen(EXECUTOR)
    controller.arm()
    return driver


def test_pulses_come_when_they_are_due_never_before(running, wait_for):
    controller, fired, _ = running
    run = controller.start(constant(0.5, 0.5, 50.0))
    wait_for(lambda: bool(run.ended))
    assert run.ended == 'completed'
    assert len(fired) == 25
    assert all(pulse.delivery.time_ns >= pulse.due_ns for pulse in fired)
    assert [pulse.sequence for pulse in fired] == list(range(25))
    assert controller.state is State.DISARMED


@pytest.mark.parametrize('call', ['fire', 'rest'])
def test_hang_is_latched_and_cleaned_up_while_it_lasts(running, wait_for, call):
    controller, fired, _ = running
    device = controller.device
    controller.start(constant(0.5, 10.0, 5.0))
    wait_for(lambda: bool(fired))
    device.hangs_in = call
    wait_for(lambda: controller.state is State.FAULT)
    assert controller.reason == f'{call}: expected an answer within 2 s, got none'
    assert not device.armed
    # a clean-up leads out of it although nobody has answered yet
    controller.cleanup()
    assert controller.state is State.UNCONFIGURED
    assert controller.reason == 'device closed; the device hangs'
    # while it hangs no order is taken, and one that was given up is not done afterwards either
    with pytest.raises(NoAnswer, match=r'expected the driver to answer within 4\.3 s') as caught:
        controller.configure()
    assert not caught.value.begun
    given, device.hangs_in = len(fired), ''
    device.let_go.set()
    wait_for(lambda: device.closed == 1)
    assert controller.state is State.UNCONFIGURED
    controller.configure()
    controller.seen(EXECUTOR)
    controller.arm()
    assert controller.state is State.ARMED
    # a trigger that hung is told when it comes back
    assert len(fired) <= given + 1


def test_status_does_not_wait_for_a_device_that_hangs_when_silenced(running, wait_for):
    controller, _, _ = running
    controller.device.hangs_in = 'silence'
    stopping = threading.Thread(target=controller.stop, args=('test', 'a test'), daemon=True)
    stopping.start()
    wait_for(controller.device.hanging.is_set)
    # neither waits for the thread that stops; the supervisor has followed the halt
    wait_for(lambda: controller.status()[:2] == (State.DISARMED, True))
    assert stopping.is_alive()
    controller.device.hangs_in = ''
    controller.device.let_go.set()
    wait_for(lambda: not stopping.is_alive())


def test_configuring_that_hangs_leaves_state_and_device_closed(driver, wait_for):
    controller, *_ = driver
    controller.device.hangs_in = 'open'
    with pytest.raises(StimulationError, match='expected the driver to answer within'):
        controller.configure()
    assert controller.state is State.UNCONFIGURED
    controller.device.hangs_in = ''
    controller.device.let_go.set()
    wait_for(lambda: controller.device.closed == 1)
    assert not controller.device.opened
    controller.configure()
    assert controller.state is State.DISARMED


@pytest.mark.filterwarnings('ignore::pytest.PytestUnhandledThreadExceptionWarning')
@pytest.mark.parametrize('name', ['owner', 'supervisor', 'ledger'])
def test_end_of_a_thread_is_a_fault_and_it_can_be_started_again(running, wait_for, name):
    controller, fired, threads = running
    controller.start(constant(0.5, 10.0, 50.0))
    wait_for(lambda: bool(fired))
    thread = threads._threads[name]
    thread.step = None
    wait_for(lambda: controller.state is State.FAULT)
    assert controller.reason == f'{thread.name}: expected to run on, got an exception'
    wait_for(lambda: not thread.is_alive())
    assert not controller.device.armed
    controller.cleanup()
    threads.start()
    assert all(other.is_alive() for other in threads._threads.values())
    controller.configure()
