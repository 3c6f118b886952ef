# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Interlocks and heartbeats by themselves."""

import pytest

from rpms_ros.stimulation.driver.safety_monitor import Interlocks, Refused

SECOND = 1_000_000_000
NOW = 1000 * SECOND


def test_sign_of_life_ages():
    interlocks = Interlocks()
    interlocks.require('heart', 1.0)
    assert interlocks.problem(0) == ('heart', 'heart: expected a sign of life, got none yet')
    interlocks.seen('heart', 0)
    assert interlocks.problem(SECOND) is None
    name, reason = interlocks.problem(SECOND + 1)
    assert name == 'heart'
    assert reason == 'heart: expected a sign of life within 1 s, got none for 1 s'


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


def test_latch_lets_go_only_with_its_causes_gone():
    interlocks = Interlocks()
    interlocks.require('heart', 1.0)
    interlocks.latch('heart', 'no heartbeat')
    interlocks.latch('door', 'the door was open')
    assert interlocks.latched_reason == 'no heartbeat'
    with pytest.raises(Refused, match='expected heart to come again, got nothing') as caught:
        interlocks.reset(0)
    assert caught.value.limit == 'heart'
    interlocks.seen('heart', 0)
    interlocks.open('door', 'the door is open')
    with pytest.raises(Refused, match='expected the cause door gone, got the door is open'):
        interlocks.reset(0)
    interlocks.close('door')
    assert interlocks.latched
    interlocks.reset(0)
    assert not interlocks.latched
    assert interlocks.latched_reason == ''
