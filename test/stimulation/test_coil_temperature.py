# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The coil's temperature in trains: each reading in time, and the model between them."""

from itertools import pairwise

import pytest
from faulty_device import WireTimes

from rpms_ros.stimulation import constant
from rpms_ros.stimulation.limits.coil_temperature import CoilTemperature, CoilThermal

# 9600 baud, ten bits a byte: a status and a temperature take 6.3 and 12.5 ms
WIRE = WireTimes(prepare_s=8.3e-3, keep_alive_s=20e-3, trigger_s=3.1e-3, answer_s=3.1e-3)
SECOND = 1_000_000_000


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


@pytest.mark.parametrize('rate', [34.0, 45.0, 50.0])
@pytest.mark.parametrize('prepares', [False, True])
def test_a_train_without_room_gives_up_a_pulse_for_each_reading(measuring, rate, prepares):
    driver = measuring(prepares)
    run = driver.controller.start(constant(0.5, 30.0, rate))
    began = driver.clock.now
    driver.advance(30.5)
    assert run.ended.startswith('ended with')
    readings = [when for when in driver.readings if when > began]
    gaps = [later - sooner for sooner, later in pairwise(readings)]
    assert max(gaps[:-1]) <= 4.1 * SECOND
    # one pulse for a reading, and none late by it
    assert 6 <= run.dropped <= 7
    assert driver.controller.fault_counts() == {'temperature_reading': run.dropped}
    assert driver.controller.lateness.max_s <= 1e-3


@pytest.mark.parametrize(
    ('rate', 'prepares'), [(5.0, False), (20.0, False), (20.0, True), (30.0, True)]
)
def test_where_there_is_room_a_reading_costs_no_pulse(measuring, rate, prepares):
    driver = measuring(prepares)
    run = driver.controller.start(constant(0.5, 20.0, rate))
    began = driver.clock.now
    driver.advance(20.5)
    assert run.ended == 'completed'
    assert driver.controller.lateness.max_s <= 1e-3
    assert len([when for when in driver.readings if began < when < run.end_ns]) >= 4


def test_a_device_that_does_not_tell_any_more_costs_no_more_pulses(measuring):
    driver = measuring()
    driver.celsius = None
    run = driver.controller.start(constant(0.5, 20.0, 45.0))
    driver.advance(20.5)
    assert 4 <= run.dropped <= 5


def test_quick_train_on_the_line_is_stopped_by_the_instruments_heat(
    instrument, armed_on_the_line, wait_for, rapid
):
    fake = instrument(watchdog_s=20.0, wire=True)
    controller, alive = armed_on_the_line(fake, rapid)
    run = controller.start(constant(0.3, 12.0, 45.0))
    wait_for(lambda: alive() and len(fake.triggers) > 20)
    fake.temperatures = '450', '440'
    wait_for(lambda: alive() and bool(run.ended))
    assert run.cause == 'stopped'
    assert controller.reason == 'temperature: expected at most 40 Celsius, got 45 Celsius'


def test_coil_reaches_the_mean_of_its_power():
    coil = CoilTemperature(CoilThermal(20.0, 0.5, 100.0, 10.0, 40.0))
    for pulse in range(2000):
        celsius = coil.heat(pulse * SECOND // 10, 2.0)
    # s P tau / C = 0.5 * 20 W * 10 s / 100 J/K = 1 K; a pulse is 0.01 K of ripple
    assert celsius == pytest.approx(21.0, abs=0.01)


def test_model_goes_on_from_a_measured_temperature(measuring):
    driver = measuring(specification='rapid2-240v')
    run = driver.controller.start(constant(0.3, 3.0, 45.0))
    driver.advance(3.0)
    # a tenth of 22.7 J a pulse warms 700 J/K; it cools by 0.02 K meanwhile
    warmed = 25.0 + run.delivered * 2.27 / 700.0
    assert driver.controller.coil_temperature == pytest.approx(warmed, abs=0.03)


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
    for pulses in range(1, 16):
        coil.heat(driver.clock.now, 7000.0)
        coil.measured(driver.clock.now, 25.0)
        assert pulses > 10 or coil.doubt(driver.clock.now, 22.5) is None
    driver.controller.start(constant(0.3, 12.0, 20.0))
    driver.advance(5.0)
    assert driver.controller.reason.startswith('temperature: expected a sensor that works')
    assert driver.controller.run.cause == 'fault'
