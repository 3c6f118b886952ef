# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A stop in every state, interlocks, signs of life: nothing follows until it is reset."""

import math
import signal
import subprocess
import sys
import threading
from collections import deque

import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import Schedule, Single, constant
from rpms_ros.stimulation.driver.authority import ProcessLife, host_identity
from rpms_ros.stimulation.driver.safety_monitor import Halt, Interlocks, Refused, SensorLife
from rpms_ros.stimulation.driver.states import Command, State
from rpms_ros.stimulation.driver.stop_buttons import HeldKey, JoystickButton
from rpms_ros.stimulation.limits.limiter import Limits

SHORT = constant(0.5, 0.5, 20.0)
SECOND = 1_000_000_000
NOW = 1000 * SECOND
MILLISECOND = 1_000_000


def test_a_stop_from_before_the_device_is_opened_is_still_the_reason(virtual):
    controller = virtual().controller
    controller.stop('test', 'pressed beforehand')
    controller.configure()
    assert controller.status() == (State.DISARMED, True, 'pressed beforehand')
    controller.reset()
    assert controller.status() == (State.DISARMED, False, 'stop was reset')


def _lines_of_a_stop(controller):
    return _lines_of_a_halt(controller, Halt(Command.STOP, 'a test', 'stopped', 'test'))


def _lines_of_a_halt(controller, halt):
    controller._note(halt)
    yield
    controller._silence()
    yield
    controller._apply_halts()
    yield


@pytest.mark.parametrize('lines', [1, 2, 3])
def test_a_device_during_whose_opening_there_was_a_stop_is_closed(virtual, lines):
    driver = virtual()
    stop, opened = _lines_of_a_stop(driver.controller), driver.device.open

    def opens():
        opened()
        for _ in range(lines):
            next(stop)

    driver.device.instead['open'] = opens
    with pytest.raises(Refused, match='configure: expected no stop meanwhile, got one: a test'):
        driver.controller.configure()
    list(stop)
    assert driver.controller.status()[:2] == (State.UNCONFIGURED, True)
    assert not driver.device.opened
    driver.device.instead.clear()
    driver.controller.configure()
    assert driver.controller.status() == (State.DISARMED, True, 'a test')


def test_a_fault_while_the_device_is_opened_is_not_lost(virtual):
    driver = virtual()
    opened = driver.device.open
    driver.device.instead['open'] = lambda: (opened(), driver.controller.fail('test', 'a test'))
    with pytest.raises(Refused, match='configure: expected no stop meanwhile, got one: a test'):
        driver.controller.configure()
    assert not driver.device.opened


class _HeldUp(deque):
    """Holds up the thread that notes a halt."""

    def __init__(self):
        super().__init__()
        self.noted, self.go_on = threading.Event(), threading.Event()

    def append(self, halt):
        super().append(halt)
        self.noted.set()
        self.go_on.wait(0.2)


def test_a_stop_that_another_thread_applies_while_it_is_noted_is_heard_by_the_owner(virtual):
    driver = virtual()
    controller, arms = driver.controller, driver.device.arm
    controller.configure()
    controller._halts = _HeldUp()
    presses = threading.Thread(target=controller.stop, args=('test', 'a test'))

    def arm():
        status = arms()
        presses.start()
        controller._halts.noted.wait()
        controller.supervise()
        return status

    driver.device.instead['arm'] = arm
    with pytest.raises(Refused, match='arm: expected no stop meanwhile, got one: a test'):
        controller.arm()
    presses.join()
    driver.advance(1.0)
    assert controller.status() == (State.DISARMED, True, 'a test')
    assert controller.fault_counts() == {'test': 1}


@pytest.mark.parametrize('command', [Command.STOP, Command.FAIL])
@pytest.mark.parametrize('lines', [1, 2])
def test_a_halt_that_was_noted_before_an_order_is_heard_by_it(virtual, command, lines):
    driver = virtual()
    controller, arms = driver.controller, driver.device.arm
    controller.configure()
    halt = _lines_of_a_halt(controller, Halt(command, 'a test', 'stopped', 'test'))
    for _ in range(lines):
        next(halt)
    # another thread goes on meanwhile
    driver.device.instead['arm'] = lambda: (arms(), list(halt), controller.supervise())[0]
    with pytest.raises(StimulationError):
        controller.arm()
    list(halt)
    assert not driver.device.armed
    assert controller.reason == 'a test'
    assert controller.fault_counts() == {'test': 1}


@pytest.mark.parametrize('given_back', ['first', 'last'])
def test_a_stop_while_a_pulse_is_taken_from_the_ledger_is_no_fault(running, given_back):
    controller, permitted = running.controller, running.controller._permitted
    reservations, settle = controller._reservations, controller.ledger.settle

    def take(numbers):
        # the owner takes its pulse while the others are given back
        controller.ledger.settle = settle
        controller._booked(controller.run)
        settle(numbers)

    def permit(run):
        allowed = permitted(run)
        if allowed:
            controller._permitted = permitted
            if given_back == 'last':
                controller.ledger.settle = take
            controller.stop('test', 'a test')
            reservations.extend(controller._clock())
        return allowed

    controller._permitted = permit
    running.advance(1.0)
    assert controller.status() == (State.DISARMED, True, 'a test')
    assert controller.fault_counts() == {'test': 1}


def test_a_bound_that_is_lowered_between_the_check_and_the_trigger_leaves_no_pulse(running):
    before = len(running.fired)
    running.once_booked(lambda: running.controller.tighten(0.1))
    running.advance(1.0)
    assert len(running.fired) == before
    assert running.controller.run.cause == 'limit'


def test_a_pulse_that_a_stop_forestalls_has_no_number(running):
    running.once_booked(lambda: running.controller.stop('test', 'a test'))
    running.advance(1.0)
    running.controller.reset()
    running.controller.arm()
    running.controller.start(SHORT)
    running.advance(1.0)
    numbers = [one.sequence for one in running.fired]
    assert numbers == list(range(running.controller.commanded)) == list(range(20))


def test_stop_between_the_check_and_the_trigger_leaves_no_pulse(running):
    driver = running
    driver.once_booked(lambda: driver.controller.stop('test', 'a test'))
    before = len(driver.fired)
    driver.device.calls.clear()
    driver.advance(1.0)
    assert len(driver.fired) == before
    assert 'fire' not in driver.device.calls
    assert not driver.device.armed
    assert driver.controller.state is State.DISARMED


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


def _stop_in_a_turn(driver, moment, lines):
    """Let another thread come so far with a stop, and be held up until the turn is over."""
    stop, step, seen = _lines_of_a_stop(driver.controller), driver.controller.step, 0

    def between():
        nonlocal seen
        seen += 1
        if seen == moment:
            for _ in range(lines):
                next(stop)

    def turn():
        driver.clock.between = between
        following = step()
        driver.clock.between = None
        if seen >= moment:
            list(stop)
        return following

    driver.controller.step = turn
    driver.advance(0.3)
    return seen >= moment


@pytest.mark.parametrize('lines', [1, 2, 3])
def test_a_stop_at_any_moment_of_a_turn_is_the_reason_and_no_fault(virtual, lines):
    for moment in range(1, 41):
        driver = virtual(keep_alive_s=0.05).started(constant(0.5, 5.0, 5.0), seconds=0.05)
        assert _stop_in_a_turn(driver, moment, lines)
        assert driver.controller.status() == (State.DISARMED, True, 'a test'), moment
        assert driver.controller.fault_counts() == {'test': 1}
        assert not driver.device.armed


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
    controller.start(SHORT)
    running.advance(1.0)
    assert len(running.device.commands) == given + 10


def test_a_machine_that_has_slept_is_a_problem_until_it_is_armed_again():
    asleep = [100 * SECOND]
    interlocks = Interlocks(lambda: asleep[0])
    interlocks.require('heart', 1.0)
    interlocks.seen('heart', NOW)
    assert interlocks.problem(NOW) is None
    # the clock of the pulses has stood still: the heart seems to beat
    asleep[0] += 3 * SECOND
    name, reason = interlocks.problem(NOW)
    assert name == 'suspend'
    assert reason.endswith('got it asleep for 3 s')
    interlocks.latch(name, reason)
    interlocks.reset(NOW)
    assert interlocks.problem(NOW) is not None
    interlocks.awake()
    assert interlocks.problem(NOW) is None


def test_readings_of_two_clocks_that_are_apart_are_no_sleep():
    readings = iter([0, -30_000_000, 0, 0, 0, 0, -30_000_000, 5_000_000])
    interlocks = Interlocks(lambda: next(readings))
    assert [interlocks.problem(NOW) for _ in range(3)] == [None, None, None]


@pytest.mark.parametrize(
    ('silent', 'heartbeat_s', 'limit_ms'), [('executor', None, 500), ('heartbeat', 0.3, 300)]
)
def test_missing_sign_of_life_stops_before_the_next_pulse(virtual, silent, heartbeat_s, limit_ms):
    driver = virtual(heartbeat_s=heartbeat_s).started(seconds=1.0)
    driver.alive = False
    lost_at = driver.clock.now
    driver.advance(2.0)
    assert driver.device.commands[-1][0] <= lost_at + limit_ms * MILLISECOND
    assert driver.controller.interlocks.latched
    assert silent in driver.controller.reason
    with pytest.raises(StimulationError, match=f'reset: expected {silent} to come again'):
        driver.controller.reset()
    driver.alive = True
    driver.look()
    driver.controller.reset()
    driver.controller.arm()


def test_pulse_is_not_fired_when_nobody_supervises(virtual):
    driver = virtual(executor_timeout_s=5.0).started()
    for _ in range(200):
        driver.clock.now = max(driver.clock.now, driver.controller.step())
    busy = (
        'computer too busy: pulses stopped; supervisor: expected a sign of life within 0.5 s, got'
    )
    assert driver.controller.reason.startswith(busy)
    assert len(driver.device.commands) <= 11


def test_checked_pulse_does_not_wait_for_a_keep_alive_that_hangs(virtual):
    """The heart stops while the device is busy: no pulse after the heart's time is over."""
    times = {'heartbeat_s': 0.3, 'executor_timeout_s': 5.0}
    driver = virtual(**times, stuck_limit_s=1.0, lateness_limit_s=0.1)
    driver.started(Schedule((Single(1.0, duration_s=2.0), Single(1.0, duration_s=1.0))), 0.06)
    assert len(driver.device.commands) == 1
    keep_alive = type(driver.device).keep_alive

    def dies_meanwhile():
        driver.alive = False
        driver.clock.wait(0.9)
        return keep_alive(driver.device)

    driver.device.instead['keep_alive'] = dies_meanwhile
    driver.advance(5.0)
    assert len(driver.device.commands) == 1
    assert driver.controller.interlocks.latched
    assert 'heartbeat' in driver.controller.reason


def test_idle_driver_disarms_itself(virtual):
    driver = virtual(Limits(idle_disarm_s=5.0)).armed()
    driver.advance(4.9)
    assert driver.controller.state is State.ARMED
    driver.advance(0.2)
    assert driver.controller.state is State.DISARMED
    assert driver.controller.reason == 'idle: no pulse for 5 s while armed'
    assert not driver.device.armed


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


def test_a_stop_by_the_modelled_temperature_can_be_reset_when_the_coil_has_cooled(virtual):
    driver = virtual(specification='rapid2-240v').armed()
    driver.controller.coil.measured(driver.clock.now, 40.5)
    driver.advance(0.1)
    assert driver.controller.reason.startswith('temperature: expected at most 40 Celsius, got 40')
    with pytest.raises(Refused, match='reset: expected the cause temperature gone'):
        driver.controller.reset()
    driver.advance(60.0)
    with pytest.raises(Refused, match='expected the latched stop to be reset, got: temperature'):
        driver.controller.arm()
    driver.controller.reset()
    driver.controller.arm()


def test_a_sample_that_repeats_its_stamp_or_is_of_another_time_is_no_sign_of_life():
    life = SensorLife('force_sensor', 0.2)

    def refusal(age_ns, frame_id='force_sensor'):
        return life.refusal(NOW - age_ns, frame_id, NOW)

    refused = 'expected a force sample within 0.2 s of the time of the driver, got one of '
    assert refusal(86400 * SECOND) == f'{refused}8.64e+04 s ago'
    assert refusal(SECOND // 4) == f'{refused}0.25 s ago'
    # one of tomorrow blocks none of today
    assert refusal(-86400 * SECOND) == f'{refused}-8.64e+04 s ago'
    assert refusal(SECOND // 5) is None
    assert refusal(0, 'ankle') == "expected force in frame 'force_sensor', got 'ankle'"
    repeated = 'expected a force sample after the last one, got its stamp moved '
    assert refusal(SECOND // 5) == f'{repeated}0 ns'
    assert refusal(2) is None
    assert refusal(3) == f'{repeated}-1 ns'
    # from there on it counts again: a clock that was set back locks nothing for good
    assert refusal(2) is None


def test_the_end_of_a_process_is_seen(wait_for):
    process = subprocess.Popen([sys.executable, '-S', '-c', 'input()'], stdin=subprocess.PIPE)
    life = ProcessLife(host_identity(), process.pid)
    assert life.known
    assert not life.ended
    process.kill()
    wait_for(lambda: life.ended)
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    life.close()
    assert not life.ended
    assert ProcessLife(host_identity(), process.pid).ended


@pytest.mark.parametrize(('host', 'process'), [('elsewhere', 1), ('', 1), (host_identity(), 0)])
def test_a_process_of_another_machine_is_not_known(host, process):
    life = ProcessLife(host, process)
    assert not life.known
    assert not life.ended


def test_a_key_is_held_from_its_first_repetition_on_and_again_after_a_release():
    key = HeldKey(0.5, 0.2)
    assert not key.held(0)
    # the fourth is within the time of a first repetition, but it is none
    for now_ms, held in ((0, False), (500, True), (690, True), (900, False), (1400, True)):
        now = now_ms * MILLISECOND
        key.came(now)
        assert key.held(now) == key.held(now + 200 * MILLISECOND) == held, now_ms
        assert not key.held(now + 200 * MILLISECOND + 1)


def test_a_tap_is_not_a_hold_however_often():
    key = HeldKey(0.5, 0.2)
    for tap in range(5):
        key.came(501 * MILLISECOND * tap)
        assert not key.held(501 * MILLISECOND * tap)


def test_a_joystick_button_counts_while_the_joystick_speaks():
    button = JoystickButton(1, 0.5)
    assert button.used
    assert button.down(0) is None
    button.heard([0], 0)
    assert button.down(0) is None
    button.heard([0, 1], 0)
    assert button.down(500_000_000) is True
    assert button.down(500_000_001) is None
    button.heard([1, 0], 1)
    assert button.down(1) is False
    assert not JoystickButton(-1, 0.5).used


def test_short_silence_holds_pulses_back_before_it_is_a_problem():
    interlocks = Interlocks()
    interlocks.require('ears', 0.5, hold_s=0.04)
    assert interlocks.held_by(0) is None
    assert interlocks.problem(0) == ('ears', 'ears: expected a sign of life, got none yet')
    interlocks.seen('ears', 0)
    assert interlocks.held_by(SECOND // 25) is None
    assert interlocks.held_by(SECOND // 25 + 1) == 'ears'
    assert interlocks.problem(SECOND // 2) is None
    assert interlocks.problem(SECOND // 2 + 1) is not None
    # who was armed a moment ago has waited for the device meanwhile
    assert interlocks.problem(SECOND, since_ns=SECOND // 2) is None
    assert interlocks.problem(SECOND + 1, since_ns=SECOND // 2) is not None


def test_a_reset_without_a_latched_stop_says_nothing_of_one(running):
    before = running.controller.reason
    assert running.controller.reset() is False
    assert (running.controller.state, running.controller.reason) == (State.RUNNING, before)
    running.press_stop()
    running.release_stop()
    assert running.controller.reset() is True
    assert (running.controller.state, running.controller.reason) == (
        State.DISARMED,
        'stop was reset',
    )
