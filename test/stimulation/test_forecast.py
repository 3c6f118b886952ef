# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Forecasts: what public figures say of the paper's excitations, and of each limit."""

import dataclasses

import numpy as np
import pytest

from rpms_ros.stimulation import (
    Constant,
    Pause,
    Schedule,
    Single,
    constant,
    paper_random,
    paper_sinusoid,
)
from rpms_ros.stimulation.limits.coil_temperature import CoilTemperature, CoilThermal
from rpms_ros.stimulation.limits.device_specification import load_device_specification
from rpms_ros.stimulation.limits.forecast import Trial, forecast
from rpms_ros.stimulation.limits.limits import Limits, PulseLimiter

SHIPPED = load_device_specification('rapid2-240v')
SECOND = 1_000_000_000
# of a subject who knows every intensity: the other limits are looked at one by one
RAPID = dataclasses.replace(
    SHIPPED,
    limits=dataclasses.replace(
        SHIPPED.limits, maximum_intensity_step=1.0, maximum_intensity_rise=1.0
    ),
)


def test_the_paper_exceeds_the_device():
    random, sinusoid = forecast(paper_random(), RAPID), forecast(paper_sinusoid(), RAPID)
    assert not random.deliverable
    assert not sinusoid.deliverable
    # E[u^2] is 1/3 and 3/8: 1680 and 1890 W; the draw of one seed is within 1 % of it
    assert random.mean_power_w == pytest.approx(1680.0, rel=0.01)
    assert sinusoid.mean_power_w == pytest.approx(1890.0, rel=1e-9)
    assert random.max_rate_hz == 20.0
    assert {found.limit for found in random.violations} >= {'rate_limits_hz', 'continuous_power_w'}
    # energy over power, less the 90 s that the train lasted
    assert sinusoid.waits_s == pytest.approx((170_100 / 1050 - 90,), rel=1e-9)


@pytest.mark.parametrize(
    ('schedule', 'limit'),
    [
        (constant(0.3, 1.0, 51.0), 'maximum_rate_hz'),
        (constant(0.5, 1.0, 31.0), 'rate_limits_hz'),
        (constant(0.7, 27.0, 20.0), 'continuous_power_w'),
        (constant(0.1, 101.0, 20.0), 'maximum_train_pulses'),
        (Schedule((Pause(61.0), Single())), 'idle_disarm_s'),
        (Schedule((Constant(20.0, 20.0, intensity=0.7), Pause(5.0), Single())), 'wait'),
        (Schedule((Single(),), width_s=1e-3), 'maximum_width_s'),
        (constant(0.45, 90.0, 20.0), 'deliverable'),
    ],
)
def test_each_limit_is_named(schedule, limit):
    expected = set() if limit == 'deliverable' else {limit}
    assert {found.limit for found in forecast(schedule, RAPID).violations} == expected


def test_silence_counts_from_arming_and_up_to_the_end():
    limits = dataclasses.replace(RAPID.limits, idle_disarm_s=5.0)
    specification = dataclasses.replace(RAPID, limits=limits)
    pause = Schedule((Pause(4.0), Single(duration_s=1.0)))
    assert forecast(pause, specification).deliverable
    trial = Trial(PulseLimiter(limits), None, 7 * SECOND)
    (refused,) = trial.refusals(pause.plan, 1e-4, 10 * SECOND)
    assert refused == (0, ('idle_disarm_s', 'expected at most 5 s without a pulse, got 7 s'))
    trailing = forecast(Schedule((Single(duration_s=1.0), Pause(5.0))), specification)
    assert [(found.time_s, found.pulses) for found in trailing.violations] == [(6.0, 0)]
    assert not forecast(Schedule((Pause(5.1),)), specification).deliverable


def test_coil_reaches_the_mean_of_its_power():
    thermal = CoilThermal(20.0, 0.5, 100.0, 10.0, 40.0)
    coil = CoilTemperature(thermal)
    for pulse in range(2000):
        celsius = coil.heat(pulse * SECOND // 10, 2.0)
    # s P tau / C = 0.5 * 20 W * 10 s / 100 J/K = 1 K; a pulse is 0.01 K of ripple
    assert celsius == pytest.approx(21.0, abs=0.01)


def test_every_rate_at_its_limit_can_go_on_for_ever():
    """Whatever the rate: 66,666,667 ns and 66,666,666 ns are both a period at 15 Hz."""
    random = np.random.default_rng(1)
    rates = [15.0, 30.0, 60.0, *random.uniform(0.5, 100.0, 97).tolist()]
    for rate in rates:
        limits = Limits(maximum_rate_hz=rate, minimum_pause_s=3.0)
        plan = Schedule((Constant(rate, 500.0 / rate, intensity=0.5),)).plan
        trial = Trial(PulseLimiter(limits), None, 0)
        assert list(trial.refusals(plan, 100e-6, 0)) == [], rate


def test_a_rate_above_its_limit_is_refused_at_the_second_pulse():
    specification = dataclasses.replace(RAPID, limits=Limits(maximum_rate_hz=15.0))
    # a period shorter by two nanoseconds
    schedule = Schedule((Constant(1e9 / 66_666_664, 1.0, intensity=0.5),))
    (found,) = forecast(schedule, specification).violations
    assert (found.limit, found.pulses) == ('maximum_rate_hz', 14)
    assert found.time_s == pytest.approx(1 / 15, abs=1e-6)
