# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver apart from ROS: every transition, a stop in each of them, faults, interlocks."""

import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import constant
from rpms_ros.stimulation.devices import SimulatedDevice
from rpms_ros.stimulation.driver.safety_monitor import Refused
from rpms_ros.stimulation.driver.states import TRANSITIONS, Command, State
from rpms_ros.stimulation.limits.limits import Limits

SECOND = 1_000_000_000
TRAIN = constant(0.5, 0.5, 20.0)


DO = {
    Command.CONFIGURE: lambda controller: controller.configure(),
    Command.ARM: lambda controller: controller.arm(),
    Command.START: lambda controller: controller.start(TRAIN),
    Command.FINISH: lambda controller: controller.cancel(),
    Command.DISARM: lambda controller: controller.disarm(),
    Command.CLEANUP: lambda controller: controller.cleanup(),
    Command.FAIL: lambda controller: controller.fail('test', 'a test'),
    Command.STOP: lambda controller: controller.stop('test', 'a test'),
}
# What it has to come to: written out here, so that a slip in the driver's own table is found.
# The columns are the states before, `-` is refused.
EXPECTED = """
           UNCONFIGURED DISARMED     ARMED        RUNNING      FAULT
CONFIGURE  DISARMED     -            -            -            -
ARM        -            ARMED        -            -            -
START      -            -            RUNNING      -            -
FINISH     -            -            -            DISARMED     -
DISARM     UNCONFIGURED DISARMED     DISARMED     DISARMED     FAULT
CLEANUP    UNCONFIGURED UNCONFIGURED UNCONFIGURED UNCONFIGURED UNCONFIGURED
FAIL       UNCONFIGURED FAULT        FAULT        FAULT        FAULT
STOP       UNCONFIGURED DISARMED     DISARMED     DISARMED     FAULT
"""


def expected():
    states, *rows = [line.split() for line in EXPECTED.strip().splitlines()]
    return {
        (State[state], Command[row[0]]): None if cell == '-' else State[cell]
        for row in rows
        for state, cell in zip(states, row[1:], strict=True)
    }


def test_the_table_of_transitions_is_the_one_that_is_meant():
    meant = expected()
    assert set(meant) == {(state, command) for state in State for command in Command}
    assert {pair: state for pair, state in meant.items() if state is not None} == TRANSITIONS


@pytest.mark.parametrize('state', State)
@pytest.mark.parametrize('command', Command)
def test_every_transition_legal_or_not(state, command, driver_in):
    driver = driver_in(state)
    target = expected()[state, command]
    if target is None and command is Command.FINISH:
        # nothing to cancel
        DO[command](driver.controller)
        target = state
    elif target is None:
        with pytest.raises(StimulationError, match=f'{command.value}: expected .*{state.name}'):
            DO[command](driver.controller)
        target = state
    else:
        DO[command](driver.controller)
    assert driver.controller.state is target
    assert driver.device.armed == (target in (State.ARMED, State.RUNNING))
    assert driver.device.opened == (target is not State.UNCONFIGURED)


def test_a_sleep_of_the_machine_stops(running, monkeypatch):
    controller, given = running.controller, len(running.device.commands)
    awake = controller.interlocks._slept
    monkeypatch.setattr(controller.interlocks, '_slept', lambda: awake() + 60 * 10**9)
    running.advance(1.0)
    assert len(running.device.commands) == given
    assert (controller.state, controller.interlocks.latched) == (State.DISARMED, True)
    assert 'suspend: expected the machine to stay awake' in controller.reason
    # who resets it is there again
    controller.reset()
    controller.arm()
    controller.start(TRAIN)
    running.advance(1.0)
    assert len(running.device.commands) == given + 10


def test_what_the_subject_knew_before_a_sleep_of_the_machine_is_not_known_after_it(
    virtual, monkeypatch
):
    driver = virtual(Limits(maximum_intensity_rise=0.1)).armed()
    controller = driver.controller
    for highest in (0.1, 0.2, 0.2):
        controller.start(constant(highest, 0.5, 20.0))
        driver.advance(1.0)
        controller.arm()
    controller.disarm()
    given = len(driver.device.commands)
    awake = controller.interlocks._slept
    monkeypatch.setattr(controller.interlocks, '_slept', lambda: awake() + 28800 * SECOND)
    controller.arm()
    with pytest.raises(Refused, match=r'^maximum_intensity_rise: .* got 0\.2'):
        controller.start(constant(0.2, 0.5, 20.0))
    assert len(driver.device.commands) == given
    controller.start(constant(0.1, 0.5, 20.0))
    driver.advance(1.0)
    assert len(driver.device.commands) == given + 10


class StoppedMidway(SimulatedDevice):
    """A device during whose every call somebody presses the emergency stop."""

    controller = None

    def _press(self):
        if self.controller is not None:
            self.controller.stop('test', 'stop in the middle')

    def open(self):
        super().open()
        self._press()

    def arm(self):
        super().arm()
        self._press()

    def fire(self, intensity, width_s, latest_ns=None):
        self._press()
        return super().fire(intensity, width_s, latest_ns)

    def close(self):
        self._press()
        super().close()


@pytest.mark.parametrize('state', State)
@pytest.mark.parametrize('command', Command)
def test_stop_in_the_middle_of_every_transition(state, command, driver_in):
    driver = driver_in(state)
    device = StoppedMidway(clock=driver.clock, wait=driver.clock.wait)
    device.opened, device.armed = driver.device.opened, driver.device.armed
    device._last_sign_ns = driver.clock.now
    driver.controller.device = driver.device = device
    device.controller = driver.controller
    during = command in (Command.CONFIGURE, Command.ARM, Command.CLEANUP)
    legal = expected()[state, command] is not None
    try:
        DO[command](driver.controller)
    except StimulationError:
        assert not legal or command is Command.ARM
    if not during or not legal:
        driver.controller.stop('test', 'stop right after')
    assert driver.controller.interlocks.latched
    assert driver.controller.state not in (State.ARMED, State.RUNNING)
    assert not device.armed
    driver.advance(1.0)
    assert not device.fired
    with pytest.raises(StimulationError):
        driver.controller.start(TRAIN)
    with pytest.raises(StimulationError):
        driver.controller.arm()


def test_a_stop_from_before_the_device_is_opened_is_still_the_reason(driver_in):
    controller = driver_in(State.UNCONFIGURED).controller
    controller.stop('test', 'pressed beforehand')
    controller.configure()
    assert controller.status() == (State.DISARMED, True, 'pressed beforehand')
    controller.reset()
    assert controller.status() == (State.DISARMED, False, 'stop was reset')


def test_stop_while_the_device_is_firing(driver_in):
    driver = driver_in(State.ARMED)
    device = StoppedMidway(clock=driver.clock)
    device.opened = device.armed = True
    driver.controller.device = device
    driver.controller.start(TRAIN)
    device.controller = driver.controller
    driver.advance(1.0)
    assert not device.fired
    assert driver.controller.interlocks.latched
    assert driver.controller.state is State.DISARMED
