# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses on time, each held against everything at its own time, and what is left."""

from functools import partial
from itertools import pairwise

import pytest
from faulty_device import WireTimes

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import Constant, Pause, Schedule, Single, constant
from rpms_ros.stimulation.driver.states import State
from rpms_ros.stimulation.limits.limiter import Limits

# 9600 baud, ten bits a byte: setting and its answer 8 bytes, status 6, trigger 3, its answer 3
WIRE = WireTimes(prepare_s=8.3e-3, keep_alive_s=6.3e-3, trigger_s=3.1e-3, answer_s=3.1e-3)
SHORT = constant(0.5, 0.5, 20.0)
MILLISECOND = 1_000_000


@pytest.mark.parametrize('late_ms', [0, 2])
def test_train_is_delivered_on_time_and_counted(driver_in, late_ms):
    driver = driver_in(State.ARMED)
    run = driver.controller.start(SHORT)
    driver.advance(1.0, late_ns=late_ms * MILLISECOND)
    assert run.completed
    assert run.ended == 'completed'
    assert driver.controller.state is State.DISARMED
    onsets = [(time - run.start_ns) / MILLISECOND for time, _ in driver.device.commands]
    assert onsets == [pulse * 50 + late_ms for pulse in range(10)]
    given = driver.controller
    assert (given.commanded, given.delivered, given.dropped) == (10, 10, 0)
    assert given.lateness.max_s == pytest.approx(late_ms * 1e-3, abs=1e-12)
    assert given.lateness.mean_s == pytest.approx(late_ms * 1e-3, abs=1e-12)


def test_late_pulses_are_dropped_and_counted_never_sent_in_a_burst(driver_in):
    driver = driver_in(State.ARMED)
    run = driver.controller.start(SHORT)
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
    limits = Limits(maximum_rate_hz=20.0, interval_tolerance_s=1e-3)
    driver = virtual(limits).started(SHORT, 0.06)
    driver.advance(0.05, late_ns=8 * MILLISECOND)
    driver.advance(1.0)
    onsets = [time - driver.run.start_ns for time, _ in driver.device.commands]
    # 8 ms late, then at the rate limit less the tolerance until the end, none dropped
    assert onsets[:3] == [0, 58 * MILLISECOND, 107 * MILLISECOND]
    assert driver.run.completed


@pytest.mark.parametrize('stall_ms', [9, 11])
def test_stall_between_the_check_and_the_trigger_leaves_no_late_pulse(running, stall_ms):
    """The machine stands still when the pulse has passed every check."""
    driver = running
    driver.once_booked(lambda: driver.clock.stall(stall_ms * 1e-3))
    driver.advance(4.65)
    late = stall_ms > 10
    assert driver.controller.dropped == late
    assert driver.controller.run.delivered == 100 - late
    # it was sent, or certainly not: the sequence goes on
    assert [pulse.sequence for pulse in driver.fired] == list(range(100 - late))
    assert driver.controller.lateness.max_s <= 0.01


def test_a_trigger_may_be_written_until_its_pulse_would_be_too_late(virtual):
    driver = virtual(wire=WireTimes(trigger_s=3e-3), lateness_limit_s=10e-3).armed()
    fire, latest = driver.device.fire, []

    def noting(intensity, width_s, latest_ns):
        latest.append(latest_ns)
        return fire(intensity, width_s, latest_ns)

    driver.device.instead['fire'] = noting
    run = driver.controller.start(SHORT)
    driver.advance(1.0)
    assert latest == [run.onset_ns(index) + 7 * MILLISECOND for index in range(10)]


def test_a_pulse_has_to_pass_with_and_without_one_that_was_never_given(virtual):
    """Asked for, not given: the step counts from the one before it as well."""
    limits = Limits(maximum_intensity_step=0.4, minimum_pause_s=0.5)
    steps = tuple(Constant(20.0, 0.05, intensity=value) for value in (0.3, 0.6, 0.9))
    driver = virtual(limits).started(Schedule(steps), 0.06)
    driver.clock.now = driver.due_ns()
    driver.once_booked(lambda: driver.clock.stall(11e-3))
    driver.advance(0.5)
    assert [value for _, value in driver.device.commands] == [0.3]
    assert driver.run.ended.startswith('maximum_intensity_step: expected a step')


def test_no_pulse_is_late_at_the_wire_times_of_9600_baud(virtual):
    driver = virtual(wire=WIRE, steps=100).started(constant(0.3, 20.0, 50.0), 21.0)
    assert driver.run.completed
    # the trigger is sent ahead by the time that it takes
    assert driver.controller.lateness.max_s == 0.0


def test_after_the_end_and_after_a_cancel_the_device_is_disarmed_at_zero(virtual):
    for seconds, cause in ((0.5, 'cancelled'), (1.1, 'completed')):
        driver = virtual().started(constant(0.5, 1.0, 20.0), seconds)
        driver.controller.cancel()
        assert driver.controller.state is State.DISARMED
        assert driver.run.cause == cause
        assert (driver.device.intensity, driver.device.armed) == (0.0, False)


def test_intensity_is_zero_after_the_last_pulse_and_in_long_pauses(virtual):
    pauses = Schedule(
        (Single(duration_s=2.0, intensity=0.8), Single(1.0, duration_s=2.0), Pause(3.0))
    )
    driver = virtual().started(pauses)
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
    driver = virtual(limits, steps=100).started(constant(asked, 0.2, 20.0), 0.5)
    assert {value for _, value in driver.device.commands} == {given}
    assert {pulse.intensity for pulse in driver.fired} == {given}
    assert {pulse.delivery.intensity for pulse in driver.fired} == {given}
    assert driver.controller.limiter.last_intensity == given
    # four pulses
    assert driver.controller.limiter.session_energy_j == pytest.approx(400 * given**2, rel=1e-12)


def test_pulses_are_held_back_while_the_executor_is_silent(virtual):
    driver = virtual().started(seconds=0.51)
    driver.alive = False
    lost = driver.clock.now
    driver.advance(0.49)
    # 0.4 of the longest silence: the rest of it brings no pulse, and no stop yet
    assert lost + 150 * MILLISECOND < driver.device.commands[-1][0] <= lost + 200 * MILLISECOND
    assert driver.controller.fault_counts() == {'executor': 5}
    assert driver.controller.state is State.RUNNING
    driver.alive = True
    driver.look()
    driver.advance(0.1)
    assert driver.device.commands[-1][0] > lost + 490 * MILLISECOND
    # a cancel that comes from the executor after its silence finds no pulse meanwhile
    driver.controller.cancel()
    assert driver.controller.state is State.DISARMED


def test_bound_on_the_intensity_can_be_lowered_while_running(running):
    controller = running.controller
    given = len(running.device.commands)
    controller.tighten(0.4)
    running.advance(0.5)
    assert len(running.device.commands) == given
    assert controller.run.ended == (
        'maximum_intensity: expected an intensity in [0, 0.4], got 0.5'
    )
    controller.tighten(1.0)
    with pytest.raises(StimulationError, match=r'expected a share in \[0, 1\], got 1.1'):
        controller.tighten(1.1)


def test_pulse_that_is_not_reserved_is_not_fired(virtual):
    driver = virtual().started()
    # the ledger's thread writes no more
    driver.controller.reserve = partial(driver.controller.seen, 'ledger')
    driver.advance(2.0)
    assert len(driver.device.commands) == 21
    assert driver.controller.fault_counts()['ledger'] == driver.run.dropped > 10


def test_a_disk_that_hangs_stops_a_train(virtual):
    """It went on by itself when the disk did, after any time."""
    driver = virtual().started()
    reserve, driver.controller.reserve = driver.controller.reserve, lambda: None
    driver.advance(1.5)
    assert 10 < len(driver.device.commands) <= 21
    assert driver.controller.state is State.DISARMED
    assert 'ledger: expected a sign of life within 1 s, got none for' in driver.run.ended
    driver.controller.reserve = reserve
    given = len(driver.device.commands)
    driver.advance(2.0)
    assert len(driver.device.commands) == given


def test_armed_device_is_kept_alive(driver_in):
    driver = driver_in(State.ARMED)
    for _ in range(20):
        driver.advance(0.5)
        # told every 0.4 s, looked at every 50 ms
        assert driver.clock.now - driver.device._last_sign_ns <= 450 * MILLISECOND
