# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver apart from ROS while it runs: lateness, faults, interlocks, refusals."""

import dataclasses
import math
from itertools import pairwise

import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import Constant, Pause, Schedule, Single, constant
from rpms_ros.stimulation.devices import DeviceError, SimulatedDevice, SimulatedFaults
from rpms_ros.stimulation.devices.serial_line import SerialDevice
from rpms_ros.stimulation.driver.controller import StimulationController
from rpms_ros.stimulation.driver.safety_monitor import Halt, Refused
from rpms_ros.stimulation.driver.states import Command, DriverSettings, State
from rpms_ros.stimulation.limits.device_specification import load_device_specification
from rpms_ros.stimulation.limits.limits import Limits

MILLISECOND = 1_000_000
TRAIN = constant(0.5, 0.5, 20.0)


def test_train_is_delivered_on_time_and_counted(driver_in):
    driver = driver_in(State.ARMED)
    run = driver.controller.start(TRAIN)
    driver.advance(1.0)
    assert run.completed
    assert run.ended == 'completed'
    assert driver.controller.state is State.DISARMED
    onsets = [time for time, _ in driver.device.commands]
    assert onsets == [run.start_ns + pulse * 50 * MILLISECOND for pulse in range(10)]
    assert (
        driver.controller.commanded,
        driver.controller.delivered,
        driver.controller.dropped,
    ) == (10, 10, 0)
    assert driver.controller.lateness.max_s == 0.0


def test_late_pulses_are_dropped_and_counted_never_sent_in_a_burst(driver_in):
    driver = driver_in(State.ARMED)
    run = driver.controller.start(TRAIN)
    driver.advance(0.2)
    given = len(driver.device.commands)
    driver.clock.now += 170 * MILLISECOND
    driver.look()
    driver.advance(0.5)
    assert run.dropped == 3
    assert run.delivered == 10 - 3
    gaps = [after_ - before for (before, _), (after_, _) in pairwise(driver.device.commands)]
    assert min(gaps) == 50 * MILLISECOND
    assert len(driver.device.commands) > given
    assert run.ended == 'ended with 3 pulses missing'
    assert driver.controller.fault_counts() == {'late': 3}


def test_pulse_after_a_late_one_waits_for_its_interval(virtual):
    driver = virtual(Limits(maximum_rate_hz=20.0, interval_tolerance_s=1e-3)).armed()
    run = driver.controller.start(TRAIN)
    driver.advance(0.06)
    driver.advance(0.05, late_ns=8 * MILLISECOND)
    driver.advance(1.0)
    onsets = [time - run.start_ns for time, _ in driver.device.commands]
    # 8 ms late, then at the rate limit less the tolerance until the end, none dropped
    assert onsets[:3] == [0, 58 * MILLISECOND, 107 * MILLISECOND]
    assert run.completed


def test_lateness_within_the_limit_is_measured(driver_in):
    driver = driver_in(State.ARMED)
    run = driver.controller.start(TRAIN)
    driver.advance(1.0, late_ns=2 * MILLISECOND)
    assert run.completed
    assert driver.controller.lateness.max_s == pytest.approx(2e-3, abs=1e-12)
    assert driver.controller.lateness.mean_s == pytest.approx(2e-3, abs=1e-12)


def test_device_that_vanishes_while_nothing_fires_is_noticed(driver_in):
    driver = driver_in(State.DISARMED)
    driver.device.keep_alive()
    driver.controller.device.keep_alive = vanished
    driver.advance(1.0)
    assert driver.controller.state is State.FAULT
    assert 'expected the device, got nothing' in driver.controller.reason


def vanished():
    raise DeviceError('expected the device, got nothing')


def test_idle_driver_disarms_itself(virtual):
    driver = virtual(Limits(idle_disarm_s=5.0)).armed()
    driver.advance(4.9)
    assert driver.controller.state is State.ARMED
    driver.advance(0.2)
    assert driver.controller.state is State.DISARMED
    assert driver.controller.reason == 'idle: no pulse for 5 s while armed'
    assert not driver.device.armed


def test_armed_device_is_kept_alive(driver_in):
    driver = driver_in(State.ARMED)
    for _ in range(20):
        driver.advance(0.5)
        # told every 0.4 s, looked at every 50 ms
        assert driver.clock.now - driver.device._last_sign_ns <= 450 * MILLISECOND


@pytest.mark.parametrize('silent', ['executor', 'heartbeat'])
def test_missing_sign_of_life_stops_before_the_next_pulse(silent, virtual):
    driver = virtual(heartbeat_s=0.3 if silent == 'heartbeat' else None).armed()
    driver.controller.start(constant(0.5, 5.0, 20.0))
    driver.advance(1.0)
    driver.alive = False
    lost_at = driver.clock.now
    driver.advance(2.0)
    limit = 300 if silent == 'heartbeat' else 500
    assert driver.device.commands[-1][0] <= lost_at + limit * MILLISECOND
    assert driver.controller.interlocks.latched
    assert silent in driver.controller.reason
    with pytest.raises(StimulationError, match=f'reset: expected {silent} to come again'):
        driver.controller.reset()
    driver.alive = True
    driver.look()
    driver.controller.reset()
    driver.controller.arm()


def test_pulse_is_not_fired_when_nobody_supervises(virtual):
    driver = virtual(executor_timeout_s=5.0).armed()
    driver.controller.start(constant(0.5, 5.0, 20.0))
    for _ in range(200):
        driver.clock.now = max(driver.clock.now, driver.controller.step())
    busy = (
        'computer too busy: pulses stopped; supervisor: expected a sign of life within 0.5 s, got'
    )
    assert driver.controller.reason.startswith(busy)
    assert len(driver.device.commands) <= 11


def test_gate_refusal_in_a_run_ends_it_with_its_limit(virtual):
    driver = virtual(Limits(maximum_intensity_step=0.3)).armed()
    steps = tuple(Constant(20.0, 0.05, intensity=value) for value in (0.3, 0.6, 0.9))
    run = driver.controller.start(Schedule(steps))
    # the second pulse comes too late, so the step from the first to the third is too large
    driver.advance(0.06)
    driver.clock.now += 55 * MILLISECOND
    driver.look()
    driver.advance(1.0)
    assert run.ended.startswith('maximum_intensity_step: expected a step of at most 0.3 from 0.3')
    assert [value for _, value in driver.device.commands] == [0.3]
    assert driver.controller.state is State.DISARMED


def test_schedule_beyond_the_session_is_refused(virtual):
    driver = virtual(Limits(session_pulses=15)).armed()
    driver.controller.start(TRAIN)
    driver.advance(1.0)
    driver.controller.arm()
    with pytest.raises(Refused, match='expected at most 5 more pulses in this session, got 10'):
        driver.controller.start(TRAIN)
    driver.controller.cleanup()
    driver.armed()
    with pytest.raises(Refused, match='expected at most 5 more pulses in this session, got 10'):
        driver.controller.start(TRAIN)


def test_rest_of_the_coil_counts_from_schedule_to_schedule(virtual):
    driver = virtual(specification='rapid2-240v').armed()
    hard = constant(0.7, 10.0, 20.0)
    driver.controller.start(hard)
    driver.advance(10.8)
    driver.controller.arm()
    assert driver.controller.coil_temperature > 24.0
    with pytest.raises(Refused, match=r'wait: expected a wait of 13\.5 s after a train of 200'):
        driver.controller.start(hard)
    driver.advance(13.6)
    driver.controller.start(hard)


def test_undeliverable_schedule_is_refused_with_its_limit(virtual):
    driver = virtual(specification='rapid2-240v').armed()
    with pytest.raises(Refused, match=r'rate_limits_hz: .*; at 0.05 s of the schedule') as caught:
        driver.controller.start(constant(1.0, 90.0, 20.0))
    assert caught.value.limit == 'rate_limits_hz'
    with pytest.raises(Refused, match=r'idle_disarm_s: expected at most 60 s'):
        driver.controller.start(Schedule((Pause(61.0), Single())))
    assert driver.device.commands == []


def test_profile_for_simulation_is_refused_for_a_real_device():
    class Real(SimulatedDevice):
        real = True

    with pytest.raises(
        StimulationError, match='expected the device specification of a real device'
    ):
        StimulationController(Real(), load_device_specification('simulated'), DriverSettings())


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


def test_temperature_and_force_close_again_but_stay_latched(driver_in):
    driver = driver_in(State.RUNNING)
    driver.controller.temperature(41.0)
    assert driver.controller.reason == 'temperature: expected at most 40 Celsius, got 41 Celsius'
    with pytest.raises(StimulationError, match='reset: expected the cause temperature gone'):
        driver.controller.reset()
    driver.controller.temperature(30.0)
    assert driver.controller.interlocks.latched
    with pytest.raises(Refused, match=r'expected the latched stop to be reset, got: temperature'):
        driver.controller.arm()
    assert not driver.device.armed
    driver.controller.reset()
    driver.controller.arm()


@pytest.mark.parametrize('name', ['force', 'temperature'])
def test_a_measurement_that_is_no_number_stops(virtual, name):
    driver = virtual(force_limit_n=10.0)
    measure = getattr(driver.controller, name)
    driver.clock.meanwhile.append(lambda: driver.controller.force(1.0))
    driver.controller.force(1.0)
    driver.armed()
    measure(math.nan)
    assert driver.controller.status()[:2] == (State.DISARMED, True)
    assert driver.controller.reason.endswith(('got nan N', 'got nan Celsius'))
    # also before it is armed again
    with pytest.raises(StimulationError, match='reset: expected the cause'):
        driver.controller.reset()


def test_condition_that_opens_while_disarmed_only_refuses(driver_in):
    driver = driver_in(State.DISARMED)
    driver.controller.temperature(41.0)
    assert not driver.controller.interlocks.latched
    with pytest.raises(Refused, match='temperature: expected at most 40'):
        driver.controller.arm()
    driver.controller.temperature(30.0)
    driver.controller.arm()


def test_a_halt_that_is_only_noted_keeps_the_owner_from_firing(driver_in):
    driver = driver_in(State.RUNNING)
    driver.advance(0.02)
    assert driver.device.intensity == 0.5
    driver.clock.now = driver.due_ns()
    # as when the thread that stops has got no further than its first line
    driver.controller._halts.append(Halt(Command.STOP, 'a test', 'stopped', 'test'))
    assert driver.due_ns() is None
    assert not driver.controller._permitted(driver.controller.run)
    driver.controller.step()
    assert driver.device.commands == []
    assert driver.controller.status() == (State.DISARMED, True, 'a test')


def test_a_run_is_told_once_nothing_stands_against_it_and_before_its_first_pulse(virtual):
    driver = virtual().armed()
    told = []
    with pytest.raises(Refused, match='maximum_rate_hz: expected'):
        driver.controller.start(constant(0.5, 1.0, 200.0), lambda: told.append('too fast'))
    assert told == []

    def slowly():
        # as a disk that takes its time
        driver.advance(0.3)
        told.append((driver.controller.state, len(driver.device.commands)))

    run = driver.controller.start(constant(0.5, 1.0, 20.0), slowly)
    driver.advance(2.0)
    assert told == [(State.RUNNING, 0)]
    assert (run.delivered, run.dropped) == (20, 0)


def test_a_run_that_cannot_be_told_gives_no_pulse(virtual):
    driver = virtual().armed()
    with pytest.raises(ZeroDivisionError, match='division'):
        driver.controller.start(constant(0.5, 1.0, 20.0), lambda: 1 // 0)
    driver.advance(2.0)
    assert driver.device.commands == []
    assert driver.controller.state is State.DISARMED


def test_a_schedule_that_takes_too_long_to_look_at_is_refused(virtual):
    limits = Limits(session_pulses=1_000_000, maximum_rate_hz=100.0)
    driver = virtual(limits).armed()
    with pytest.raises(Refused, match='schedule_pulses: expected at most 40000 pulses in a sched'):
        driver.controller.start(constant(0.5, 401.0, 100.0))
    assert driver.controller.state is State.ARMED


@pytest.mark.parametrize(
    ('faults', 'name'),
    [
        (SimulatedFaults(silent_loss=1.0), 'lost'),
        (SimulatedFaults(extra_intensity=-0.1), 'intensity'),
        (SimulatedFaults(extra_intensity=0.1), 'intensity'),
        (SimulatedFaults(slow_s=0.15), 'slow'),
        (SimulatedFaults(vanish_after=1), 'device'),
    ],
)
def test_difference_between_commanded_and_delivered_is_a_fault(faults, name, driver_in):
    driver = driver_in(State.RUNNING)
    driver.advance(0.2)
    before = len(driver.device.commands)
    driver.faults = faults
    driver.advance(1.0)
    assert driver.controller.state is State.FAULT
    assert driver.controller.fault_counts() == {name: 1}
    assert len(driver.device.commands) - before <= 1
    assert not driver.device.armed
    assert driver.controller.run.ended == driver.controller.reason
    with pytest.raises(StimulationError, match='start: expected state ARMED, got FAULT'):
        driver.controller.start(TRAIN)


def test_device_that_cannot_be_closed_is_let_go(driver_in):
    driver = driver_in(State.DISARMED)
    driver.controller.device.close = vanished
    driver.controller.cleanup()
    assert driver.controller.state is State.UNCONFIGURED
    assert driver.controller.reason == 'device closed; expected the device, got nothing'
