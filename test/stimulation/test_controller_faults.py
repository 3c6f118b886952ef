# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What devices, callbacks and ledgers do wrong: each ends in zero intensity, disarmed, latched."""

import numpy as np
import pytest
from faulty_device import SimulatedFaults

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import Constant, Pause, Schedule, Single, constant
from rpms_ros.stimulation.devices.registry import UNVERIFIED, Delivery, DeviceError, DeviceStatus
from rpms_ros.stimulation.driver.safety_monitor import Refused
from rpms_ros.stimulation.driver.states import State
from rpms_ros.stimulation.limits.limiter import Limits

BUSY = 'computer too busy: pulses stopped; '
SHORT = constant(0.5, 0.5, 20.0)
PAUSES = Schedule((Single(1.0, duration_s=3.0), Single(1.0, duration_s=1.0)))
MILLISECOND = 1_000_000


class Unheard(Exception):
    """Of a type that nobody expects."""


def raising(error):
    def call(*arguments):
        del arguments
        raise error

    return call


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
    assert driver.due_ns() is None
    assert controller.run is None or controller.run.cause == 'fault'
    given = len(device.commands)
    device.calls.clear()
    driver.advance(3.0)
    assert len(device.commands) == given
    assert 'keep_alive' not in device.calls
    with pytest.raises(StimulationError, match='arm: expected state DISARMED'):
        controller.arm()
    device.instead.clear()
    driver.device.faults = SimulatedFaults()
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
        running.controller.start(PAUSES)
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


@pytest.mark.parametrize(
    ('hangs', 'name', 'reason'),
    [
        (False, 'callback', "on_fired: expected no error, got Unheard('no publisher')"),
        (True, 'stuck', f'{BUSY}on_fired: expected an answer within 0.2 s, got none'),
    ],
)
def test_callback_that_raises_or_hangs_is_a_fault(running, hangs, name, reason):
    wrong = running.device.hang(1.0) if hangs else raising(Unheard('no publisher'))
    running.controller.on_fired = wrong
    running.advance(2.0)
    assert running.controller.reason == reason
    assert running.controller.fault_counts() == {name: 1}
    assert len(running.device.commands) == 11
    assert_safe(running)


@pytest.mark.parametrize('call', ['prepare', 'fire', 'keep_alive', 'rest'])
def test_hang_is_noticed_within_its_limit_and_the_train_does_not_go_on(running, call):
    driver = running
    if call in ('keep_alive', 'rest'):
        driver.controller.cancel()
        driver.controller.arm()
        driver.controller.start(PAUSES)
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


@pytest.mark.parametrize('looks_ms', [[0], [0, 20], [0, 300]])
def test_a_machine_that_stood_still_is_no_device_that_hangs_but_at_the_second_look(
    looks_ms, virtual
):
    driver = virtual().armed()

    def stalls():
        # the supervisor as well
        driver.clock.stall(0.4)
        for pause_ms in looks_ms:
            driver.clock.stall(pause_ms * 1e-3)
            driver.controller.supervise()

    driver.device.instead['beat'] = stalls
    driver.controller.step()
    if len(looks_ms) == 1:
        driver.device.instead.clear()
        driver.advance(1.0)
        assert (driver.controller.state, driver.controller.fault_counts()) == (State.ARMED, {})
        return
    assert driver.controller.reason == 'beat: expected an answer within 0.2 s, got none'
    assert driver.controller.fault_counts() == {'stuck': 1}
    assert_safe(driver)


@pytest.mark.parametrize(
    ('flag', 'value', 'name'),
    [
        ('coil_absent', True, 'coil'),
        ('replace_coil', True, 'coil'),
        ('error', True, 'error'),
        ('not_ready', True, 'ready'),
        ('disarms', True, 'armed'),
        ('foreign_intensity', 1.0, 'intensity'),
    ],
)
def test_what_the_device_says_stops_before_the_next_pulse(running, flag, value, name):
    faults = SimulatedFaults(**{flag: value})
    right_after_a_pulse(running, lambda: setattr(running.device, 'faults', faults))
    running.device.calls.clear()
    running.advance(0.5)
    assert 'fire' not in running.device.calls
    assert name in running.controller.fault_counts()
    assert_safe(running)


@pytest.mark.parametrize(
    ('coil_absent', 'said'), [(False, 'no answer'), (True, 'expected a device in order with a')]
)
def test_pulse_without_an_answer_is_told_as_fired_and_unverified(running, coil_absent, said):
    gives = type(running.device).fire

    def no_answer(*arguments):
        # after the last look
        running.device.faults = SimulatedFaults(coil_absent=coil_absent)
        gives(running.device, *arguments)
        raise DeviceError('no answer')

    running.device.instead['fire'] = no_answer
    running.advance(0.1)
    assert said in running.controller.reason
    assert len(running.device.commands) == 11 - coil_absent
    assert len(running.fired) == 11
    last = running.fired[-1]
    assert last.delivery.intensity == 0.5
    assert last.delivery.unverified == frozenset(UNVERIFIED)
    assert running.controller.limiter.session_pulses == 11
    assert running.controller.run.delivered == 10
    assert_safe(running)


def test_doubtful_answers_are_compared_with_what_was_commanded(running):
    running.device.instead['fire'] = lambda *_: Delivery(running.clock.now, float('nan'))
    running.advance(0.1)
    assert running.controller.fault_counts() == {'intensity': 1}
    assert_safe(running)


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
    driver.device.faults = faults
    driver.advance(1.0)
    assert driver.controller.state is State.FAULT
    assert driver.controller.fault_counts() == {name: 1}
    assert len(driver.device.commands) - before <= 1
    assert not driver.device.armed
    assert driver.controller.run.ended == driver.controller.reason
    with pytest.raises(StimulationError, match='start: expected state ARMED, got FAULT'):
        driver.controller.start(SHORT)


@pytest.mark.parametrize(
    'answer',
    [
        lambda given: bool(given),
        lambda given: tuple(given),
        lambda given: given._replace(time_ns=None),
        lambda given: given._replace(unverified=None),
    ],
)
def test_pulse_with_an_answer_of_another_shape_is_told_as_fired_and_unverified(running, answer):
    gives = type(running.device).fire
    running.device.instead['fire'] = lambda *arguments: answer(gives(running.device, *arguments))
    running.advance(0.1)
    assert len(running.device.commands) == len(running.fired) == 11
    assert running.fired[-1].delivery.unverified == frozenset(UNVERIFIED)
    assert_safe(running)


@pytest.mark.parametrize('early_s', [0.05, 1.0])
def test_delivery_from_before_its_trigger_is_that_of_another_pulse(running, early_s):
    gives = type(running.device).fire

    def stale(*arguments):
        given = gives(running.device, *arguments)
        return given._replace(time_ns=given.time_ns - round(early_s * 1e9))

    running.device.instead['fire'] = stale
    running.advance(0.1)
    assert running.controller.reason == (
        f'expected a pulse after its trigger, got one {early_s:g} s before'
    )
    assert running.controller.fault_counts() == {'lost': 1}
    assert len(running.device.commands) == len(running.fired) == 11
    assert running.fired[-1].delivery.unverified == frozenset(UNVERIFIED)
    assert_safe(running)


def test_a_slow_pulse_is_a_fault_also_where_a_stop_came_meanwhile(running):
    gives = type(running.device).fire

    def slow(*arguments):
        given = gives(running.device, *arguments)
        running.controller.stop('test', 'a test')
        return given._replace(time_ns=given.time_ns + 200_000_000)

    running.device.instead['fire'] = slow
    running.advance(0.1)
    assert running.controller.state is State.FAULT
    assert running.controller.fault_counts()['slow'] == 1


@pytest.mark.parametrize('flag', ['coil_present', 'armed', 'ready'])
@pytest.mark.parametrize('no', [False, 0, np.False_])
def test_a_device_says_no_in_any_type(running, flag, no):
    for call in ('prepare', 'keep_alive'):
        honest = getattr(type(running.device), call)
        running.device.instead[call] = lambda *arguments, honest=honest: honest(
            running.device, *arguments
        )._replace(**{flag: no})
    running.advance(0.1)
    assert len(running.device.commands) <= 11
    assert_safe(running)


def test_a_device_whose_arm_says_nothing_is_not_armed(driver_in):
    driver = driver_in(State.DISARMED)
    driver.device.instead['arm'] = lambda: type(driver.device).arm(driver.device) and None
    with pytest.raises(DeviceError, match='arm: expected the status of the device, got none'):
        driver.controller.arm()
    assert_safe(driver)


def test_an_intensity_that_a_device_says_it_gave_counts_as_given(virtual, rapid):
    """Six trains of one pulse of 100 % in place of 10 % were 15 J on the books, not 1512."""
    driver = virtual(rapid.limits)
    gives = type(driver.device).fire
    driver.device.instead['fire'] = lambda *arguments: gives(driver.device, *arguments)._replace(
        intensity=1.0
    )
    driver.started(constant(0.1, 1.0, 10.0), 0.5)
    assert driver.controller.state is State.FAULT
    full_j = driver.controller.limits.energy_j(1.0)
    # the ledger counts what was found besides as a pulse more
    assert driver.controller.ledger.totals()[0] == 2
    assert driver.controller.limiter.session_energy_j == pytest.approx(full_j)
    assert driver.controller.ledger.totals()[1] == pytest.approx(full_j)
    assert_safe(driver)


def test_pulses_whose_intensity_the_device_confirmed_are_not_counted_with_a_later_one(
    virtual, rapid
):
    driver = virtual(rapid.limits)
    driver.device.read_back_s = 0.2
    gives = type(driver.device).fire

    def stronger(*arguments):
        given = gives(driver.device, *arguments)
        return given._replace(intensity=1.0) if len(driver.device.commands) == 10 else given

    driver.device.instead['fire'] = stronger
    driver.started(constant(0.1, 2.0, 10.0), 1.5)
    assert driver.controller.state is State.FAULT
    energy_j = driver.controller.limits.energy_j
    given_j = (len(driver.fired) - 1) * energy_j(0.1) + energy_j(1.0)
    assert driver.controller.limiter.session_energy_j == pytest.approx(given_j)


def test_what_was_not_read_of_a_train_that_was_cut_short_is_not_asked_of_the_next(virtual):
    """It was found to be 0, as the device had been silenced: a false fault."""
    driver = virtual()
    # too slow to be read between two pulses
    driver.device.read_back_s = 0.2
    gives = type(driver.device).fire
    driver.device.instead['fire'] = lambda *arguments: gives(driver.device, *arguments)._replace(
        unverified=frozenset({'intensity'})
    )
    driver.started(seconds=1.2).controller.cancel()
    driver.advance(5.0)
    driver.controller.arm()
    driver.controller.start(SHORT)
    driver.advance(1.0)
    assert (driver.run.ended, driver.controller.fault_counts()) == ('completed', {})


def turned_up(device):
    """Somebody turns the knob of a device that does not tell so when it is kept alive."""
    device.intensity = 0.9
    device.instead['keep_alive'] = lambda: type(device).keep_alive(device) and DeviceStatus()


def test_a_pulse_of_zero_after_a_pause_is_set_like_any_other(virtual):
    """It was given at whatever the panel said since the pause had begun."""
    pause = Schedule((Single(0.1, duration_s=3.0), Single(0.0, duration_s=1.0)))
    driver = virtual().started(pause, 2.0)
    turned_up(driver.device)
    driver.advance(3.0)
    assert [intensity for _, intensity in driver.device.commands] == [0.1, 0.0]
    assert (driver.run.ended, driver.device.fired[-1].intensity) == ('completed', 0.0)


def test_a_pulse_is_set_although_the_one_that_was_dropped_had_the_same_intensity(running):
    turned_up(running.device)
    running.clock.stall(0.05)
    running.advance(0.1)
    assert running.run.dropped == 1
    assert {given.intensity for given in running.device.fired} == {0.5}
    assert running.controller.state is State.RUNNING


@pytest.mark.parametrize('turned', [False, True])
def test_a_quick_train_whose_last_pulse_is_dropped_is_read_at_its_end(virtual, turned):
    """It was read after the pause, in which the intensity is zero: a false fault."""
    driver = virtual()
    driver.device.read_back_s = 0.2
    gives = type(driver.device).fire
    driver.device.instead['fire'] = lambda *arguments: gives(driver.device, *arguments)._replace(
        unverified=frozenset({'intensity'})
    )
    trains = [Constant(20.0, 0.5, intensity) for intensity in (0.5, 0.3)]
    driver.started(Schedule((trains[0], Pause(4.5), trains[1])), 0.47)
    if turned:
        turned_up(driver.device)
    driver.advance(0.08, late_ns=40 * MILLISECOND)
    driver.advance(6.0)
    wrong = 'expected intensity 0.5 from the device, got 0.9'
    assert driver.run.ended == (wrong if turned else 'ended with 1 pulse missing')
    assert driver.controller.fault_counts() == {'late': 1} | ({'intensity': 1} if turned else {})


def test_a_fault_without_a_word_ends_the_run(running):
    running.device.instead['fire'] = raising(DeviceError())
    running.advance(5.0)
    assert (running.run.ended, running.run.cause) == ('fault', 'fault')
    # nothing is reserved any more for what is left of it
    assert running.controller.ledger.totals()[0] == 11
    assert_safe(running)


def test_device_that_vanishes_while_nothing_fires_is_noticed_and_let_go(driver_in):
    driver = driver_in(State.DISARMED)
    driver.device.keep_alive()
    gone = raising(DeviceError('expected the device, got nothing'))
    driver.device.instead.update(keep_alive=gone, close=gone)
    driver.advance(1.0)
    assert driver.controller.state is State.FAULT
    assert 'expected the device, got nothing' in driver.controller.reason
    # also one that cannot be closed
    driver.controller.cleanup()
    assert driver.controller.state is State.UNCONFIGURED
    assert driver.controller.reason == 'device closed; expected the device, got nothing'


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


@pytest.mark.parametrize('flag', ['coil_absent', 'replace_coil', 'error'])
def test_device_that_is_not_in_order_is_not_armed(virtual, flag):
    driver = virtual()
    driver.device.faults = SimulatedFaults(**{flag: True})
    with pytest.raises(DeviceError, match='expected a'):
        driver.armed()
    assert_safe(driver)


def test_a_configuration_that_is_refused_forgets_nothing(running):
    known = [
        list(books.known) for books in (running.controller.limiter, running.controller.confirmed)
    ]
    with pytest.raises(StimulationError, match='configure: expected state UNCONFIGURED'):
        running.controller.configure()
    assert known[0]
    # nor do the two books differ after pulses that were all given
    assert vars(running.controller.limiter) == vars(running.controller.confirmed)
    assert [
        list(books.known) for books in (running.controller.limiter, running.controller.confirmed)
    ] == known


def test_after_a_fault_no_intensity_counts_as_known(virtual):
    """The device gave less than it was told to, as it says in the end."""
    limits = Limits(maximum_intensity_rise=0.1)
    rising = Schedule(tuple(Single(share, duration_s=1.0) for share in (0.1, 0.2, 0.3)))
    driver = virtual(limits).started(rising, 2.5)
    driver.controller.cancel()
    driver.controller.arm()

    def turned_down(*arguments):
        driver.device.intensity = 0.0
        return type(driver.device).fire(driver.device, *arguments)

    driver.device.instead['fire'] = turned_down
    driver.controller.start(Schedule((Single(0.4, duration_s=1.0),)))
    driver.advance(0.5)
    assert (driver.controller.state, driver.fired[-1].intensity) == (State.FAULT, 0.4)
    driver.device.instead.clear()
    driver.controller.cleanup()
    driver.armed()
    with pytest.raises(Refused, match=r'expected at most 0\.1 more than 0, the strongest'):
        driver.controller.start(Schedule((Single(0.4, duration_s=1.0),)))
    driver.controller.start(Schedule((Single(0.1, duration_s=1.0),)))
