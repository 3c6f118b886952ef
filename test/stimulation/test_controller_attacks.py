# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What devices, callbacks and people do wrong: each ends in zero intensity, disarmed, latched."""

import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import Constant
from rpms_ros.stimulation import Pause
from rpms_ros.stimulation import Schedule
from rpms_ros.stimulation import Single
from rpms_ros.stimulation import constant
from rpms_ros.stimulation.devices import UNVERIFIED
from rpms_ros.stimulation.devices import Delivery
from rpms_ros.stimulation.devices import DeviceError
from rpms_ros.stimulation.devices import SimulatedFaults
from rpms_ros.stimulation.devices import WireTimes
from rpms_ros.stimulation.interlocks import Refused
from rpms_ros.stimulation.limits import Limits
from rpms_ros.stimulation.states import State

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
TRAIN = constant(0.5, 5.0, 20.0)
# 9600 baud, ten bits a byte: setting and its answer 8 bytes, status 6, trigger 3, its answer 3
WIRE = WireTimes(prepare_s=8.3e-3, keep_alive_s=6.3e-3, trigger_s=3.1e-3, answer_s=3.1e-3)


class Unheard(Exception):
    """Of a type that nobody expects."""


def raising(error):
    def call(*arguments):
        del arguments
        raise error

    return call


@pytest.fixture
def running(virtual):
    """A driver in the middle of a train."""
    driver = virtual().armed()
    driver.controller.start(TRAIN)
    driver.advance(0.52)
    assert len(driver.device.commands) == 10
    return driver


def right_after_a_pulse(driver, do):
    """Let something happen after the next pulse, before the one after it is prepared."""

    def on_fired(pulse):
        driver.fired.append(pulse)
        driver.controller.on_fired = driver.fired.append
        do()

    driver.controller.on_fired = on_fired
    driver.advance(0.05)
    assert driver.controller.on_fired == driver.fired.append


def assert_safe(driver, state=State.FAULT):
    """Nothing fires, nothing is kept alive, and only a clean-up leads out."""
    controller, device = driver.controller, driver.device
    assert controller.state is state
    assert (device.intensity, device.armed) == (0.0, False)
    assert controller.due_ns() is None
    assert controller.run is None or controller.run.cause == 'fault'
    given = len(device.commands)
    device.calls.clear()
    driver.advance(3.0)
    assert len(device.commands) == given
    assert 'keep_alive' not in device.calls
    with pytest.raises(StimulationError, match='arm: expected state DISARMED'):
        controller.arm()
    device.instead.clear()
    driver.faults = SimulatedFaults()
    controller.cleanup()
    assert controller.state is State.UNCONFIGURED
    controller.configure()
    controller.arm()


@pytest.mark.parametrize('call', ['prepare', 'fire', 'keep_alive', 'rest', 'beat'])
@pytest.mark.parametrize('error', [DeviceError('gone'), Unheard('gone'), OSError(5, 'gone')])
def test_whatever_a_call_raises_while_running_is_a_fault(running, call, error):
    if call in ('keep_alive', 'rest'):
        running.controller.cancel()
        running.controller.arm()
        pauses = Schedule((Single(duration_s=3.0), Single(duration_s=1.0)))
        running.controller.start(pauses)
    before = len(running.device.commands)

    def begin():
        running.device.instead[call] = raising(error)

    if call == 'prepare':
        right_after_a_pulse(running, begin)
        before += 1
    begin()
    running.advance(1.5)
    assert 'gone' in running.controller.reason
    # a trigger that raised may have given a pulse; a single pulse came before the pause
    assert len(running.device.commands) - before <= (1 if call in ('keep_alive', 'rest') else 0)
    assert_safe(running)


@pytest.mark.parametrize('call', ['open', 'arm'])
@pytest.mark.parametrize('error', [DeviceError('gone'), Unheard('gone')])
def test_whatever_a_call_raises_beforehand_is_told_and_leaves_nothing_open(virtual, call, error):
    driver = virtual()
    driver.device.instead[call] = raising(error)
    with pytest.raises(DeviceError, match='gone'):
        driver.armed()
    if call == 'open':
        # the device may have been opened half
        assert 'close' in driver.device.calls
        assert driver.controller.state is State.UNCONFIGURED
        assert 'gone' in driver.controller.reason
        driver.device.instead.clear()
        driver.armed()
    else:
        assert_safe(driver)


@pytest.mark.parametrize('error', [DeviceError('gone'), Unheard('gone'), OSError(5, 'gone')])
def test_device_that_cannot_be_silenced_is_a_fault_and_left_to_its_watchdog(running, error):
    running.device.instead['silence'] = raising(error)
    running.controller.stop('test', 'a test')
    assert running.controller.interlocks.latched
    assert running.controller.state is State.FAULT
    assert 'expected a device that can be silenced, got' in running.controller.reason
    given = len(running.device.commands)
    running.device.calls.clear()
    running.advance(3.0)
    assert len(running.device.commands) == given
    assert not {'keep_alive', 'prepare', 'rest', 'fire'} & set(running.device.calls)


def test_callback_that_raises_is_a_fault(running):
    running.controller.on_fired = raising(Unheard('no publisher'))
    running.advance(0.5)
    assert 'on_fired: expected no error, got Unheard' in running.controller.reason
    assert running.controller.fault_counts() == {'callback': 1}
    assert len(running.device.commands) == 11
    assert_safe(running)


def test_callback_that_hangs_is_noticed(running):
    running.controller.on_fired = running.device.hang(1.0)
    running.advance(2.0)
    assert running.controller.reason == 'on_fired: expected an answer within 0.2 s, got none'
    assert_safe(running)


@pytest.mark.parametrize('call', ['prepare', 'fire', 'keep_alive', 'rest'])
def test_hang_is_noticed_within_its_limit_and_the_train_does_not_go_on(running, call):
    driver = running
    if call in ('keep_alive', 'rest'):
        driver.controller.cancel()
        driver.controller.arm()
        driver.controller.start(Schedule((Single(duration_s=3.0), Single(duration_s=1.0))))
        driver.advance(0.03)
    silenced = []
    began = []
    hang = driver.device.hang(3.0)

    def hanging(*arguments):
        began.append(driver.clock.now)
        hang(*arguments)

    def silence():
        silenced.append(driver.clock.now)
        type(driver.device).silence(driver.device)

    driver.device.instead.update({call: hanging, 'silence': silence})
    driver.advance(1.0)
    # supervised every millisecond here
    assert silenced[0] - began[0] <= 202 * MILLISECOND
    assert driver.controller.reason == f'{call}: expected an answer within 0.2 s, got none'
    assert driver.controller.fault_counts() == {'stuck': 1}
    given = len(driver.device.commands)
    driver.advance(5.0)
    assert len(driver.device.commands) == given
    # once more when it has come back: it may have been in the middle of arming or setting
    assert len(silenced) >= 2
    assert_safe(driver)


def stalls(driver, seconds, looks_then):
    """Return a call during which the whole machine stands still, the supervisor as well."""

    def call(*arguments):
        del arguments
        driver.clock.now += round(seconds * SECOND)
        for pause_ms in looks_then:
            driver.clock.now += pause_ms * MILLISECOND
            driver.controller.supervise()

    return call


def test_a_machine_that_stood_still_is_no_device_that_hangs(virtual):
    driver = virtual().armed()
    driver.device.instead['beat'] = stalls(driver, 0.4, looks_then=[0])
    driver.controller.step()
    driver.device.instead.clear()
    driver.advance(1.0)
    assert driver.controller.state is State.ARMED
    assert driver.controller.fault_counts() == {}


@pytest.mark.parametrize('again_ms', [20, 300])
def test_a_device_that_hangs_after_it_is_a_fault_at_the_second_look(again_ms, virtual):
    driver = virtual().armed()
    driver.device.instead['beat'] = stalls(driver, 0.4, looks_then=[0, again_ms])
    driver.controller.step()
    assert driver.controller.reason == 'beat: expected an answer within 0.2 s, got none'
    assert driver.controller.fault_counts() == {'stuck': 1}
    assert_safe(driver)


def test_hang_in_arming_is_noticed_and_never_armed(virtual):
    driver = virtual()
    driver.controller.configure()
    hang = driver.device.hang(3.0)

    def arms_late():
        hang()
        return type(driver.device).arm(driver.device)

    driver.device.instead['arm'] = arms_late
    with pytest.raises(StimulationError, match='expected no stop meanwhile'):
        driver.controller.arm()
    assert driver.controller.fault_counts() == {'stuck': 1}
    assert_safe(driver)


@pytest.mark.parametrize(
    ('flag', 'name'),
    [
        ('coil_absent', 'coil'),
        ('replace_coil', 'coil'),
        ('error', 'error'),
        ('not_ready', 'ready'),
        ('disarms', 'armed'),
    ],
)
def test_what_the_device_says_stops_before_the_next_pulse(running, flag, name):
    faults = SimulatedFaults(**{flag: True})
    right_after_a_pulse(running, lambda: setattr(running, 'faults', faults))
    running.device.calls.clear()
    running.advance(0.5)
    assert 'fire' not in running.device.calls
    assert name in running.controller.fault_counts()
    assert_safe(running)


def test_what_the_device_says_at_the_trigger_stops_too(running):
    """The flag comes up after the last look: the answer to the trigger tells."""
    driver = running
    driver.advance(0.01)
    fire = type(driver.device).fire

    def late_flag(*arguments):
        driver.faults = SimulatedFaults(coil_absent=True)
        return fire(driver.device, *arguments)

    driver.device.instead['fire'] = late_flag
    driver.advance(0.5)
    assert 'expected a device in order with a coil' in driver.controller.reason
    # it was triggered, and nobody knows what came of it
    last = driver.fired[-1]
    assert not last.answered
    assert last.delivery.unverified == frozenset(UNVERIFIED)
    assert_safe(driver)


def test_foreign_intensity_stops_before_the_next_pulse(running):
    faults = SimulatedFaults(foreign_intensity=1.0)
    right_after_a_pulse(running, lambda: setattr(running, 'faults', faults))
    running.advance(0.5)
    assert len(running.device.commands) == 11
    assert running.controller.reason == 'expected intensity 0.5 from the device, got 1'
    assert_safe(running)


@pytest.mark.parametrize('flag', ['coil_absent', 'replace_coil', 'error'])
def test_device_that_is_not_in_order_is_not_armed(virtual, flag):
    driver = virtual()
    driver.faults = SimulatedFaults(**{flag: True})
    with pytest.raises(DeviceError, match='expected a'):
        driver.armed()
    assert_safe(driver)


def test_what_the_device_could_not_confirm_is_carried_on(virtual):
    driver = virtual().armed()
    fire = type(driver.device).fire

    def unsure(*arguments):
        return fire(driver.device, *arguments)._replace(unverified=frozenset(('delivery',)))

    driver.device.instead['fire'] = unsure
    driver.controller.start(constant(0.5, 0.2, 20.0))
    driver.advance(1.0)
    assert {pulse.delivery.unverified for pulse in driver.fired} == {frozenset(('delivery',))}
    assert (driver.controller.delivered, driver.controller.unverified) == (4, 4)


def test_pulse_without_an_answer_is_told_as_fired_and_unverified(running):
    gives = type(running.device).fire

    def no_answer(*arguments):
        gives(running.device, *arguments)
        raise DeviceError('no answer')

    running.device.instead['fire'] = no_answer
    running.advance(0.1)
    assert len(running.device.commands) == len(running.fired) == 11
    last = running.fired[-1]
    assert (last.answered, last.delivery.intensity) == (False, 0.5)
    assert last.delivery.unverified == frozenset(UNVERIFIED)
    assert running.controller.limiter.session_pulses == 11
    assert running.controller.run.delivered == 10
    assert_safe(running)


def test_checked_pulse_does_not_wait_for_a_keep_alive_that_hangs(virtual):
    """The heart stops while the device is busy: no pulse after the heart's time is over."""
    times = {'heartbeat_s': 0.3, 'executor_timeout_s': 5.0}
    driver = virtual(**times, stuck_limit_s=1.0, lateness_limit_s=0.1).armed()
    driver.controller.start(Schedule((Single(duration_s=2.0), Single(duration_s=1.0))))
    driver.advance(0.06)
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


def test_pulse_is_late_or_dropped_when_the_line_was_busy(virtual):
    driver = virtual(wire=WIRE).armed()
    run = driver.controller.start(TRAIN)
    prepare = type(driver.device).prepare
    slow = iter([0.0] * 10 + [0.06] + [0.0] * 1000)

    def sometimes_slow(*arguments):
        driver.clock.wait(next(slow))
        return prepare(driver.device, *arguments)

    driver.device.instead['prepare'] = sometimes_slow
    driver.advance(6.0)
    assert run.dropped == 1
    assert run.delivered == 99
    assert driver.controller.lateness.max_s <= 0.01


@pytest.mark.parametrize('stall_ms', [9, 11])
def test_stall_between_the_check_and_the_trigger_leaves_no_late_pulse(running, stall_ms):
    """The machine stands still when the pulse has passed every check."""
    driver = running
    booked = driver.controller._booked

    def stalls(run):
        pulse = booked(run)
        driver.clock.now += stall_ms * MILLISECOND
        return pulse

    driver.controller._booked = stalls
    driver.advance(0.05)
    driver.controller._booked = booked
    driver.advance(4.6)
    late = stall_ms > 10
    assert driver.controller.dropped == late
    assert driver.controller.run.delivered == 100 - late
    # it was sent, or certainly not: the sequence goes on
    assert [pulse.sequence for pulse in driver.fired] == list(range(100 - late))
    assert driver.controller.lateness.max_s <= 0.01


def test_stop_between_the_check_and_the_trigger_leaves_no_pulse(running):
    driver = running
    booked = driver.controller._booked

    def stopped(run):
        pulse = booked(run)
        driver.controller.stop('test', 'a test')
        return pulse

    driver.controller._booked = stopped
    before = len(driver.fired)
    driver.device.calls.clear()
    driver.advance(1.0)
    assert len(driver.fired) == before
    assert 'fire' not in driver.device.calls
    assert not driver.device.armed
    assert driver.controller.state is State.DISARMED


def test_a_pulse_has_to_pass_with_and_without_one_that_was_never_given(virtual):
    """Asked for, not given: the step counts from the one before it as well."""
    limits = Limits(maximum_intensity_step=0.4, minimum_pause_s=0.5)
    driver = virtual(limits).armed()
    steps = tuple(Constant(20.0, 0.05, intensity=value) for value in (0.3, 0.6, 0.9))
    driver.controller.start(Schedule(steps))
    driver.advance(0.06)
    driver.clock.now = driver.controller.due_ns()
    booked = driver.controller._booked

    def stalls(run):
        driver.controller._booked = booked
        pulse = booked(run)
        driver.clock.now += 11 * MILLISECOND
        return pulse

    driver.controller._booked = stalls
    driver.advance(0.5)
    assert [value for _, value in driver.device.commands] == [0.3]
    assert driver.controller.run.ended.startswith('maximum_intensity_step: expected a step')


def test_no_pulse_is_late_at_the_wire_times_of_9600_baud(virtual):
    driver = virtual(wire=WIRE, steps=100).armed()
    run = driver.controller.start(constant(0.3, 20.0, 50.0))
    driver.advance(21.0)
    assert run.completed
    # the trigger is sent ahead by the time that it takes
    assert driver.controller.lateness.max_s == 0.0


def test_after_the_end_and_after_a_cancel_the_device_is_disarmed_at_zero(virtual):
    for cancelled in (False, True):
        driver = virtual().armed()
        driver.controller.start(constant(0.5, 1.0, 20.0))
        driver.advance(0.5 if cancelled else 1.1)
        if cancelled:
            driver.controller.cancel()
        assert driver.controller.state is State.DISARMED
        assert driver.controller.run.cause == ('cancelled' if cancelled else 'completed')
        assert (driver.device.intensity, driver.device.armed) == (0.0, False)


def test_intensity_is_zero_after_the_last_pulse_and_in_long_pauses(virtual):
    driver = virtual().armed()
    pauses = Schedule((Single(duration_s=2.0, intensity=0.8), Single(duration_s=2.0), Pause(3.0)))
    driver.controller.start(pauses)
    for moment in (0.03, 1.0, 0.9, 0.11, 3.0):
        driver.advance(moment)
        pulses = len(driver.device.commands)
        # set a tenth of a second ahead of a pulse, and no sooner
        assert (driver.device.intensity > 0) == (moment in (0.03, 0.11) and pulses < 2), moment
        assert driver.device.armed
    assert pulses == 2


@pytest.mark.parametrize(('asked', 'given'), [(0.455, 0.45), (0.555, 0.55), (0.29, 0.29)])
def test_limiter_books_messages_and_device_speak_of_one_number(virtual, asked, given):
    limits = Limits(maximum_intensity=asked, pulse_energy_j=100.0)
    driver = virtual(limits, steps=100).armed()
    driver.controller.start(constant(asked, 0.2, 20.0))
    driver.advance(0.5)
    assert {value for _, value in driver.device.commands} == {given}
    assert {pulse.intensity for pulse in driver.fired} == {given}
    assert {pulse.delivery.intensity for pulse in driver.fired} == {given}
    assert driver.controller.limiter.last_intensity == given
    # four pulses
    assert driver.controller.limiter.session_energy_j == pytest.approx(400 * given**2, rel=1e-12)


def test_silence_of_whoever_listens_holds_pulses_back_before_it_stops(virtual):
    driver = virtual().armed()
    driver.controller.interlocks.require('ears', 0.5, hold_s=0.04)
    driver.controller.seen('ears')
    driver.controller.start(TRAIN)
    heard = driver.clock.now
    for _ in range(100):
        driver.controller.seen('ears')
        heard = driver.clock.now
        driver.advance(0.01)
    assert driver.controller.dropped == 0
    driver.advance(0.4)
    # due while it was heard, within the hold, or given up as late
    assert driver.device.commands[-1][0] <= heard + 40 * MILLISECOND
    assert driver.controller.fault_counts()['ears'] >= 6
    driver.controller.seen('ears')
    driver.advance(0.1)
    assert driver.controller.state is State.RUNNING
    assert driver.device.commands[-1][0] > heard + 400 * MILLISECOND


def test_executor_that_hangs_is_judged_at_the_pulse(virtual):
    driver = virtual(executor_timeout_s=0.06, supervisor_timeout_s=5.0).armed()
    driver.controller.start(TRAIN)
    driver.advance(0.5)
    seen = driver.clock.now
    # nobody supervises, only pulses are due
    driver.clock.meanwhile.clear()
    for _ in range(100):
        driver.clock.now = max(driver.clock.now, driver.controller.step())
    assert driver.device.commands[-1][0] <= seen + 60 * MILLISECOND
    assert driver.controller.interlocks.latched
    assert 'executor' in driver.controller.reason


def test_idleness_counts_from_arming_for_the_forecast_too(virtual):
    driver = virtual(Limits(idle_disarm_s=5.0)).armed()
    driver.advance(3.0)
    with pytest.raises(Refused, match='idle_disarm_s: expected at most 5 s without a pulse'):
        driver.controller.start(Schedule((Pause(4.0), Single(duration_s=0.5))))
    run = driver.controller.start(Schedule((Pause(1.9), Single(duration_s=0.5))))
    driver.advance(3.0)
    assert run.completed
    driver.controller.arm()
    with pytest.raises(Refused, match=r'idle_disarm_s: .* got 6 s'):
        driver.controller.start(Schedule((Single(duration_s=1.0), Pause(5.0))))


def test_every_rate_exactly_at_its_limit_is_delivered(virtual):
    # 66,666,667 ns against periods of 66,666,666 and 66,666,667 ns
    for rate in (15.0, 30.0, 66.6, 23.7):
        driver = virtual(Limits(maximum_rate_hz=rate, interval_tolerance_s=0.0)).armed()
        run = driver.controller.start(constant(0.5, 5.0, rate))
        driver.advance(6.0)
        assert run.completed, (rate, run.ended)


def test_bound_on_the_intensity_can_be_lowered_while_running(running):
    controller = running.controller
    controller.tighten(0.6)
    running.advance(0.5)
    assert controller.state is State.RUNNING
    with pytest.raises(StimulationError, match=r'expected a share in \[0, 0.6\], got 0.7'):
        controller.tighten(0.7)
    given = len(running.device.commands)
    controller.tighten(0.4)
    running.advance(0.5)
    assert len(running.device.commands) == given
    assert controller.run.cause == 'limit'
    assert controller.run.ended == (
        'maximum_intensity: expected an intensity in [0, 0.4], got 0.5'
    )
    assert controller.limits.maximum_intensity == 0.4
    controller.tighten(1.0)
    with pytest.raises(StimulationError, match=r'expected a share in \[0, 1\], got 1.1'):
        controller.tighten(1.1)


def test_doubtful_answers_are_compared_with_what_was_commanded(running):
    fire = type(running.device).fire

    def not_a_number(*arguments):
        given = fire(running.device, *arguments)
        return Delivery(given.time_ns, float('nan'))

    running.device.instead['fire'] = not_a_number
    running.advance(0.1)
    assert running.controller.fault_counts() == {'intensity': 1}
    assert_safe(running)


def test_schedule_in_steps_keeps_one_number_for_a_ramp(virtual):
    driver = virtual(steps=100).armed()
    steps = tuple(Constant(20.0, 0.1, intensity=value) for value in (0.333, 0.666, 0.999))
    driver.controller.start(Schedule(steps))
    driver.advance(1.0)
    assert [value for _, value in driver.device.commands] == [0.33, 0.33, 0.66, 0.66, 0.99, 0.99]
