# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The check of a whole plan against the limiter, which holds the same pulses one by one."""

import re
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from rpms_ros.stimulation import Constant, Schedule
from rpms_ros.stimulation.limits.forecast import PlanCheck
from rpms_ros.stimulation.limits.limiter import PulseLimiter
from rpms_ros.stimulation.limits.limits import Limits
from rpms_ros.stimulation.schedule.schedule import Plan

SECOND = 1_000_000_000
MILLISECOND = 1_000_000

LIMITS = st.builds(
    Limits,
    maximum_intensity=st.floats(0.5, 1.0),
    maximum_intensity_step=st.floats(0.3, 1.0),
    maximum_intensity_rise=st.floats(0.1, 1.0),
    rise_window_s=st.sampled_from([0.05, 0.1, 0.5, 5.0]),
    maximum_rate_hz=st.sampled_from([10.0, 20.0, 33.3, 1000.0]),
    rate_intensities=st.just((0.3, 0.6, 1.0)),
    rate_limits_hz=st.just((50.0, 20.0, 15.0)),
    maximum_train_pulses=st.integers(1, 12),
    minimum_pause_s=st.sampled_from([0.05, 0.1, 0.3]),
    pulse_energy_j=st.sampled_from([0.0, 10.0, 100.0]),
    continuous_power_w=st.floats(10.0, 2000.0),
    energy_window_s=st.floats(0.1, 2.0),
    session_pulses=st.integers(1, 40),
    session_energy_j=st.floats(10.0, 2000.0),
)
PULSES = st.lists(
    st.tuples(st.sampled_from([1, 20, 50, 67, 100, 400]), st.sampled_from([0.0, 0.2, 0.5, 0.9])),
    max_size=30,
)


def booked(limits, pulses):
    limiter = PulseLimiter(limits, tolerance_s=0.0)
    time_ns = 0
    for gap, intensity in pulses:
        time_ns += gap * MILLISECOND
        limiter.book(time_ns, intensity)
    return limiter, time_ns


def assert_alike(one, other):
    """Two sums of the same numbers may be rounded to different last digits."""
    number = re.compile(r'\d+(?:\.\d+)?(?:e[+-]?\d+)?')
    assert number.sub('#', one) == number.sub('#', other)
    pairs = zip(number.findall(one), number.findall(other), strict=True)
    assert all(float(first) == pytest.approx(float(second), rel=2e-3) for first, second in pairs)


@settings(max_examples=150)
@given(LIMITS, PULSES, PULSES, st.sampled_from([100e-6, 5e-3]))
def test_a_plan_at_once_and_pulse_by_pulse_are_refused_for_the_same(limits, before, plan, width):
    limiter, start_ns = booked(limits, before)
    onset_ns = np.cumsum([gap * MILLISECOND for gap, _ in plan], dtype=np.int64)
    intensity = np.array([intensity for _, intensity in plan])
    whole = Plan(onset_ns, intensity, np.zeros(len(plan), dtype=np.int64), 100 * SECOND)
    check = PlanCheck(whole, width, limiter, start_ns)
    at_once = Counter()
    reasons = {}
    for broken in check.broken():
        for index in np.flatnonzero(broken.at).tolist():
            refusal = broken.refusal(index)
            at_once[index, refusal.limit] += 1
            reasons[index, refusal.limit] = refusal.reason
    one_by_one = Counter()
    for index, time_ns in enumerate((start_ns + onset_ns).tolist()):
        for refusal in limiter.refusals(time_ns, float(intensity[index]), width):
            one_by_one[index, refusal.limit] += 1
            assert_alike(reasons[index, refusal.limit], refusal.reason)
        limiter.book(time_ns, float(intensity[index]))
    assert at_once == one_by_one
    if len(plan):
        assert check.waits_s[-1] == pytest.approx(limiter.wait_s, rel=1e-9)


def test_every_rate_at_its_limit_can_go_on_for_ever():
    """Whatever the rate: 66,666,667 ns and 66,666,666 ns are both a period at 15 Hz."""
    random = np.random.default_rng(1)
    rates = [15.0, 30.0, 60.0, *random.uniform(0.5, 100.0, 97).tolist()]
    for rate in rates:
        limits = Limits(maximum_rate_hz=rate, interval_tolerance_s=0.0, minimum_pause_s=3.0)
        plan = Schedule((Constant(rate, 500.0 / rate, intensity=0.5),)).plan
        check = PlanCheck(plan, 100e-6, PulseLimiter(limits), 0)
        assert not any(broken.at.any() for broken in check.broken()), rate
        limiter = PulseLimiter(limits)
        for onset in plan.onset_ns.tolist():
            assert limiter.refusal(onset, 0.5, 100e-6) is None, rate
            limiter.book(onset, 0.5)


def test_a_rate_above_its_limit_is_refused_at_the_second_pulse():
    limits = Limits(maximum_rate_hz=15.0, interval_tolerance_s=0.0)
    # a period shorter by two nanoseconds
    plan = Schedule((Constant(1e9 / 66_666_664, 1.0, intensity=0.5),)).plan
    check = PlanCheck(plan, 100e-6, PulseLimiter(limits), 0)
    broken = next(broken for broken in check.broken() if broken.at.any())
    assert broken.at.argmax() == 1
    assert broken.refusal(1).limit == 'maximum_rate_hz'
