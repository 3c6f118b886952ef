# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a driver starts and what it refuses, in every state, before anything fires."""

import dataclasses
from contextlib import closing
from functools import partial

import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import Pause, Schedule, Single, constant
from rpms_ros.stimulation.devices.rapid2 import SerialDevice
from rpms_ros.stimulation.devices.simulated import SimulatedDevice
from rpms_ros.stimulation.driver.controller import StimulationController
from rpms_ros.stimulation.driver.safety_monitor import Refused
from rpms_ros.stimulation.driver.states import Command, DriverSettings, State
from rpms_ros.stimulation.limits.device_specification import load_device_specification
from rpms_ros.stimulation.limits.limiter import DoseLimits, Interlocked, Limits
from rpms_ros.stimulation.records.dose_ledger import DoseLedger, MemoryLedger

DO = {
    Command.CONFIGURE: lambda controller: controller.configure(),
    Command.ARM: lambda controller: controller.arm(),
    Command.START: lambda controller: controller.start(SHORT),
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
TRAIN = constant(0.5, 5.0, 20.0)
SHORT = constant(0.5, 0.5, 20.0)
SECOND = 1_000_000_000


def expected():
    states, *rows = [line.split() for line in EXPECTED.strip().splitlines()]
    return {
        (State[state], Command[row[0]]): None if cell == '-' else State[cell]
        for row in rows
        for state, cell in zip(states, row[1:], strict=True)
    }


@pytest.mark.parametrize('state', State)
@pytest.mark.parametrize('command', Command)
def test_every_transition_legal_or_not(state, command, driver_in):
    driver = driver_in(state)
    target = expected()[state, command] or state
    # without a run there is nothing to cancel
    if expected()[state, command] is None and command is not Command.FINISH:
        with pytest.raises(StimulationError, match=f'{command.value}: expected .*{state.name}'):
            DO[command](driver.controller)
    else:
        DO[command](driver.controller)
    assert driver.controller.state is target
    assert driver.device.armed == (target in (State.ARMED, State.RUNNING))
    assert driver.device.opened == (target is not State.UNCONFIGURED)


@pytest.mark.parametrize('state', State)
@pytest.mark.parametrize('command', Command)
def test_stop_in_the_middle_of_every_transition(state, command, driver_in):
    driver = driver_in(state)
    device = driver.device
    opens, arms, closes = device.open, device.arm, device.close

    def press():
        driver.controller.stop('test', 'stop in the middle')

    device.instead.update(
        open=lambda: (opens(), press()),
        arm=lambda: (arms(), press()),
        close=lambda: (press(), closes()),
    )
    during = command in (Command.CONFIGURE, Command.ARM, Command.CLEANUP)
    legal = expected()[state, command] is not None
    try:
        DO[command](driver.controller)
    except StimulationError:
        assert not legal or command in (Command.ARM, Command.CONFIGURE)
    if not during or not legal:
        driver.controller.stop('test', 'stop right after')
    assert driver.controller.interlocks.latched
    assert driver.controller.state not in (State.ARMED, State.RUNNING)
    assert not device.armed
    driver.advance(1.0)
    assert not device.fired
    with pytest.raises(StimulationError):
        driver.controller.start(SHORT)
    with pytest.raises(StimulationError):
        driver.controller.arm()


def test_a_goal_that_a_stop_overtakes_is_told_of_the_stop(virtual, monkeypatch):
    driver = virtual().armed()
    pressed = partial(driver.controller.stop, 'test', 'pressed')
    monkeypatch.setattr(driver.controller, 'reserve', pressed)
    with pytest.raises(Interlocked, match='expected the latched stop to be reset, got: pressed'):
        driver.controller.start(TRAIN)
    assert not driver.device.commands


def test_a_run_is_told_once_nothing_stands_against_it_and_before_its_first_pulse(virtual):
    driver = virtual().armed()
    told = []
    with pytest.raises(Refused, match='maximum_rate_hz: expected'):
        driver.controller.start(constant(0.5, 1.0, 200.0), lambda: told.append('too fast'))
    assert told == []
    # one that cannot be told gives no pulse
    with pytest.raises(ZeroDivisionError, match='division'):
        driver.controller.start(TRAIN, lambda: 1 // 0)
    driver.advance(2.0)
    assert (driver.device.commands, driver.controller.state) == ([], State.DISARMED)
    driver.controller.arm()

    def slowly():
        # as a disk that takes its time
        driver.advance(0.3)
        told.append((driver.controller.state, len(driver.device.commands)))

    run = driver.controller.start(constant(0.5, 1.0, 20.0), slowly)
    driver.advance(2.0)
    assert told == [(State.RUNNING, 0)]
    assert (run.delivered, run.dropped) == (20, 0)


def test_a_real_device_needs_a_ledger_of_its_serial_number(tmp_path):
    class Real(SimulatedDevice):
        real = True

    with pytest.raises(StimulationError, match='the device specification of a real device'):
        StimulationController(Real(), load_device_specification('simulated'), DriverSettings())
    specification = load_device_specification('rapid2-240v')
    for ledger, got in ((None, 'none'), (MemoryLedger(), 'one in memory')):
        with pytest.raises(StimulationError, match=f'on the disk for a real device, got {got}'):
            StimulationController(Real(), specification, DriverSettings(), ledger=ledger)
    with (
        closing(DoseLedger(tmp_path, '/dev/ttyUSB0', 'P01')) as ledger,
        pytest.raises(StimulationError, match="serial_number '', got that of '/dev/ttyUSB0'"),
    ):
        StimulationController(Real(), specification, DriverSettings(), ledger=ledger)


def test_a_device_of_one_width_gives_no_pulse_of_another(virtual):
    class OneWidth(SimulatedDevice):
        sets_width = False

    with pytest.raises(
        StimulationError,
        match=r'expected one width for a device on which none can be set, got 1e-05 s to 0\.001',
    ):
        StimulationController(OneWidth(), load_device_specification('simulated'), DriverSettings())
    found = load_device_specification('rapid2-240v')
    StimulationController(OneWidth(), found, DriverSettings())
    assert not SerialDevice('/dev/null').sets_width
    driver = virtual(specification='rapid2-240v').armed()
    wide = dataclasses.replace(constant(0.1, 1.0, 20.0), width_s=500e-6)
    with pytest.raises(Refused, match=r'expected a width in .* s, got 0\.0005 s'):
        driver.controller.start(wide)
    assert driver.controller.start(constant(0.1, 1.0, 20.0)).count == 20


@pytest.mark.parametrize(
    ('limits', 'schedule', 'limit', 'reason'),
    [
        ({'session_pulses': 10**6, 'maximum_rate_hz': 100.0}, constant(0.5, 401.0, 100.0),
         'schedule_pulses', 'expected at most 40000 pulses in a schedule, got 40100'),
        ({'rate_intensities': (1.0,), 'rate_limits_hz': (15.0,)}, TRAIN,
         'rate_limits_hz', 'expected at most 15 Hz .*; at 0.05 s of the schedule'),
    ],
)  # fmt: skip
def test_undeliverable_schedule_is_refused_with_its_limit(
    virtual, limits, schedule, limit, reason
):
    driver = virtual(Limits(**limits)).armed()
    with pytest.raises(Refused, match=f'{limit}: {reason}') as caught:
        driver.controller.start(schedule)
    assert caught.value.limit == limit
    assert (driver.controller.state, driver.device.commands) == (State.ARMED, [])


def test_schedule_beyond_the_session_is_refused(virtual):
    driver = virtual(Limits(session_pulses=15)).started(SHORT, 1.0)
    driver.controller.arm()
    for _ in range(2):
        with pytest.raises(Refused, match='at most 5 more pulses in this session, got 10'):
            driver.controller.start(SHORT)
        driver.controller.cleanup()
        driver.armed()


def test_idleness_counts_from_arming_for_the_forecast_too(virtual):
    driver = virtual(Limits(idle_disarm_s=5.0)).armed()
    driver.advance(3.0)
    with pytest.raises(Refused, match='idle_disarm_s: expected at most 5 s without a pulse'):
        driver.controller.start(Schedule((Pause(4.0), Single(1.0, duration_s=0.5))))
    run = driver.controller.start(Schedule((Pause(1.9), Single(1.0, duration_s=0.5))))
    driver.advance(3.0)
    assert run.completed
    driver.controller.arm()
    with pytest.raises(Refused, match=r'idle_disarm_s: .* got 6 s'):
        driver.controller.start(Schedule((Single(1.0, duration_s=1.0), Pause(5.0))))


def test_schedule_over_the_dose_is_refused_before_its_first_pulse(virtual):
    ledger = MemoryLedger(DoseLimits(pulses=99, energy_j=1e6, window_h=24.0), lambda: SECOND)
    driver = virtual(ledger=ledger).armed()
    with pytest.raises(Refused, match='expected at most 99 pulses in 24 h, got 100') as caught:
        driver.controller.start(TRAIN)
    assert caught.value.limit == 'dose_pulses'
    driver.controller.start(constant(0.5, 4.95, 20.0))
    driver.advance(6.0)
    assert len(driver.device.commands) == 99
    assert ledger.totals().pulses == 99


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
