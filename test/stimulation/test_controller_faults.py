# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What devices, callbacks and ledgers do wrong: each ends in zero intensity, disarmed, latched."""

import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import Schedule, Single, constant
from rpms_ros.stimulation.devices import (
    UNVERIFIED,
    Delivery,
    DeviceError,
    SimulatedFaults,
    WireTimes,
)
from rpms_ros.stimulation.driver.states import State
from rpms_ros.stimulation.limits.limits import LedgerError
from rpms_ros.stimulation.records.clocks import Clocks
from rpms_ros.stimulation.records.dose_ledger import DoseLedger, MemoryLedger

TRAIN = constant(0.5, 5.0, 20.0)
SHORT = constant(0.5, 0.5, 20.0)
# 9600 baud, ten bits a byte: a status and a temperature take 6.3 and 12.5 ms
WIRE = WireTimes(prepare_s=8.3e-3, keep_alive_s=20e-3, trigger_s=3.1e-3, answer_s=3.1e-3)
SECOND = 1_000_000_000
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
    driver.faults = SimulatedFaults()
    controller.cleanup()
    assert controller.state is State.UNCONFIGURED
    controller.configure()
    controller.arm()


def stalls(driver, seconds, looks_then):
    """Return a call during which the whole machine stands still, the supervisor as well."""

    def call(*arguments):
        del arguments
        driver.clock.now += round(seconds * SECOND)
        for pause_ms in looks_then:
            driver.clock.now += pause_ms * MILLISECOND
            driver.controller.supervise()

    return call


class FailingLedger(MemoryLedger):
    """Fails, or takes its time, when it is told to."""

    broken = False
    slow = False
    past = ()

    def __init__(self, dose=None):
        # in the time of the test: the machine may run for longer than the window of a dose
        super().__init__(dose, lambda: SECOND)
        self.reserved = []

    def history(self, now_monotonic_ns):
        return tuple(
            pulse._replace(time_ns=now_monotonic_ns + pulse.time_ns) for pulse in self.past
        )

    def reserve(self, pulses):
        if self.broken:
            raise LedgerError('expected a disk, got none')
        self.reserved.extend(pulses)
        return super().reserve(pulses)


def vanished():
    raise DeviceError('expected the device, got nothing')


@pytest.fixture
def measuring(virtual):
    """Build a driver whose device measures its coil where it is kept alive.

    With ``prepares`` also every 2 s in a preparation, where it fits before the trigger.
    """

    def build(prepares=False, **options):
        driver = virtual(wire=WIRE, **options)
        driver.celsius, driver.readings = 25.0, []
        ask, prepare = driver.device.keep_alive, driver.device.prepare

        def measured(status):
            driver.readings.append(driver.clock.now)
            return status._replace(temperature=driver.celsius)

        def prepared(intensity, spare_s):
            status = prepare(intensity, spare_s)
            if driver.clock.now - driver.readings[-1] < 2 * SECOND or spare_s < 24e-3:
                return status
            driver.clock.wait(15.5e-3)
            return measured(status)

        driver.device.instead['keep_alive'] = lambda: measured(ask())
        if prepares:
            driver.device.instead['prepare'] = prepared
        driver.controller.configure()
        driver.advance(1.0)
        driver.controller.arm()
        return driver

    return build


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
    assert running.controller.reason == (
        'computer too busy: pulses stopped; on_fired: expected an answer within 0.2 s, got none'
    )
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


@pytest.mark.parametrize('again_ms', [None, 20, 300])
def test_a_machine_that_stood_still_is_no_device_that_hangs_but_at_the_second_look(
    again_ms, virtual
):
    driver = virtual().armed()
    looks = [0] if again_ms is None else [0, again_ms]
    driver.device.instead['beat'] = stalls(driver, 0.4, looks)
    driver.controller.step()
    if again_ms is None:
        driver.device.instead.clear()
        driver.advance(1.0)
        assert (driver.controller.state, driver.controller.fault_counts()) == (State.ARMED, {})
        return
    assert driver.controller.reason == 'beat: expected an answer within 0.2 s, got none'
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


def test_doubtful_answers_are_compared_with_what_was_commanded(running):
    fire = type(running.device).fire

    def not_a_number(*arguments):
        given = fire(running.device, *arguments)
        return Delivery(given.time_ns, float('nan'))

    running.device.instead['fire'] = not_a_number
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
    driver.faults = faults
    driver.advance(1.0)
    assert driver.controller.state is State.FAULT
    assert driver.controller.fault_counts() == {name: 1}
    assert len(driver.device.commands) - before <= 1
    assert not driver.device.armed
    assert driver.controller.run.ended == driver.controller.reason
    with pytest.raises(StimulationError, match='start: expected state ARMED, got FAULT'):
        driver.controller.start(SHORT)


def test_device_that_vanishes_while_nothing_fires_is_noticed(driver_in):
    driver = driver_in(State.DISARMED)
    driver.device.keep_alive()
    driver.controller.device.keep_alive = vanished
    driver.advance(1.0)
    assert driver.controller.state is State.FAULT
    assert 'expected the device, got nothing' in driver.controller.reason


def test_device_that_cannot_be_closed_is_let_go(driver_in):
    driver = driver_in(State.DISARMED)
    driver.controller.device.close = vanished
    driver.controller.cleanup()
    assert driver.controller.state is State.UNCONFIGURED
    assert driver.controller.reason == 'device closed; expected the device, got nothing'


def test_ledger_that_cannot_be_written_is_a_fault(virtual):
    ledger = FailingLedger()
    driver = virtual(ledger=ledger).armed()
    ledger.broken = True
    with pytest.raises(LedgerError, match='expected a disk, got none'):
        driver.controller.start(TRAIN)
    assert driver.controller.state is State.ARMED
    assert driver.device.commands == []
    ledger.broken = False
    driver.controller.start(TRAIN)
    driver.advance(0.2)
    ledger.broken = True
    driver.advance(3.0)
    assert driver.controller.state is State.FAULT
    assert driver.controller.reason == 'expected a disk, got none'
    assert not driver.device.armed
    # what was reserved before
    assert len(driver.device.commands) <= 21


def test_a_ledger_that_is_removed_in_a_train_is_a_fault_and_ends_it(virtual, tmp_path):
    clocks = Clocks(lambda: SECOND, lambda: SECOND)
    with DoseLedger(tmp_path, 'device', 'patient', clocks=clocks) as ledger:
        driver = virtual(ledger=ledger).armed()
        driver.controller.start(TRAIN)
        driver.advance(1.0)
        for path in tmp_path.glob('*.ledger'):
            path.unlink()
        driver.advance(1.0)
        assert driver.controller.state is State.FAULT
        assert 'device.ledger, got' in driver.controller.reason
        # a second was reserved ahead, half of it at a time
        assert len(driver.device.commands) <= 31


@pytest.mark.parametrize('celsius', [0.0, 11.9, float('nan')])
def test_a_sensor_that_says_too_little_is_a_fault(measuring, celsius):
    driver = measuring(specification='rapid2-240v')
    run = driver.controller.start(constant(0.3, 12.0, 20.0))
    driver.advance(1.0)
    warm = driver.controller.coil_temperature
    driver.celsius = celsius
    driver.advance(5.0)
    assert run.cause == 'fault'
    reason = driver.controller.reason
    assert reason.startswith('temperature: expected a sensor that works, at least 12')
    assert reason.endswith(f'got {celsius:g}')
    # the model goes on without it
    assert driver.controller.coil_temperature > warm


def test_a_sensor_that_does_not_follow_the_pulses_is_a_fault(measuring):
    driver = measuring(specification='rapid2-240v')
    coil = driver.controller.coil
    # 70 kJ in all, a tenth of them in 700 J/K
    for _ in range(10):
        coil.heat(driver.clock.now, 7000.0)
        coil.measured(driver.clock.now, 25.0)
    assert coil.doubt(driver.clock.now, 22.5) is None
    for _ in range(5):
        coil.heat(driver.clock.now, 7000.0)
        coil.measured(driver.clock.now, 25.0)
    driver.controller.start(constant(0.3, 12.0, 20.0))
    driver.advance(5.0)
    assert driver.controller.reason.startswith('temperature: expected a sensor that works')
    assert driver.controller.run.cause == 'fault'
