# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The limiter and its forecast: each limit by itself, and what jitter may and may not do."""

import dataclasses
import math

import numpy as np
import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import Pause, Schedule, Single, constant, paper_random, paper_sinusoid
from rpms_ros.stimulation.limits.forecast import forecast
from rpms_ros.stimulation.limits.limiter import BookedPulse, DoseLimits, Limits, PulseLimiter

WIDTH = 100e-6
IN_STEP = 'expected as many rate_limits_hz, descending, as rate_intensities, ascending'
SECOND = 1_000_000_000


def give(limiter, times_s, intensity):
    """Fire at times [s]; return the name of the first limit that refuses, None without."""
    for time_s in times_s:
        refusal = limiter.refusal(round(time_s * SECOND), intensity, WIDTH)
        if refusal is not None:
            return refusal.limit
        limiter.book(round(time_s * SECOND), intensity)
    return None


def regular(count, rate, start=0.0):
    return [start + index / rate for index in range(count)]


def test_intensity_and_width():
    limiter = PulseLimiter(Limits())
    for intensity in (-0.1, 1.1, math.nan, math.inf, -math.inf):
        refusal = limiter.refusal(0, intensity, WIDTH)
        assert refusal.limit == 'maximum_intensity'
        assert refusal.reason.startswith('expected an intensity in [0, 1], got')
    for width, bound in ((1e-6, 'minimum'), (5e-3, 'maximum'), (math.nan, 'maximum')):
        assert limiter.refusal(0, 0.5, width).limit == f'{bound}_width_s'


def test_stronger_pulse_of_an_interval_decides(rapid):
    limiter = PulseLimiter(dataclasses.replace(rapid.limits, interval_tolerance_s=0.0))
    limiter.book(0, 1.0)
    assert limiter.refusal(SECOND // 50, 0.1, WIDTH).limit == 'rate_limits_hz'
    assert limiter.refusal(SECOND // 15 + 1, 0.1, WIDTH) is None


def test_jitter_is_tolerated_but_does_not_add_up():
    limits = Limits(maximum_rate_hz=50.0, interval_tolerance_s=2e-3)
    late_then_right = [0.0, 0.0215, 0.04, 0.06, 0.0815, 0.1]
    assert give(PulseLimiter(limits), late_then_right, 0.5) is None
    # 5 % too fast: each interval is 1 ms short, which the tolerance covers twice
    assert give(PulseLimiter(limits), regular(3, 1 / 0.019), 0.5) is None
    assert give(PulseLimiter(limits), regular(5, 1 / 0.019), 0.5) == 'maximum_rate_hz'


def test_time_that_stands_or_goes_back_is_refused():
    limiter = PulseLimiter(Limits())
    limiter.book(SECOND, 0.5)
    for time_ns in (SECOND, SECOND - 1, 0):
        assert limiter.refusal(time_ns, 0.5, WIDTH).limit == 'maximum_rate_hz'


def test_step_of_intensity_from_zero_and_from_pulse_to_pulse():
    limiter = PulseLimiter(Limits(maximum_intensity_step=0.2))
    assert limiter.refusal(0, 0.3, WIDTH).limit == 'maximum_intensity_step'
    limiter.book(0, 0.2)
    assert limiter.refusal(SECOND // 10, 0.41, WIDTH).limit == 'maximum_intensity_step'
    assert limiter.refusal(SECOND // 10, 0.4, WIDTH) is None
    limiter.book(SECOND // 10, 0.4)
    # a new train begins at zero
    assert limiter.refusal(2 * SECOND, 0.4, WIDTH).limit == 'maximum_intensity_step'


def test_pulses_of_a_train():
    limiter = PulseLimiter(Limits(maximum_train_pulses=10))
    assert give(limiter, regular(10, 20.0), 0.5) is None
    assert limiter.refusal(round(0.5 * SECOND), 0.5, WIDTH).limit == 'maximum_train_pulses'
    assert give(limiter, regular(10, 20.0, start=0.96), 0.5) is None


@pytest.mark.parametrize(('pulses', 'rate', 'intensity'), [(100, 20.0, 0.7), (200, 15.0, 1.0)])
def test_wait_after_a_train(rapid, pulses, rate, intensity):
    limiter = PulseLimiter(rapid.limits)
    assert give(limiter, regular(pulses, rate), intensity) is None
    joule = 252.0 * intensity**2
    wait = max(0.5, pulses * (rate * joule - 1050.0) / (1050.0 * rate))
    assert limiter.wait_s == pytest.approx(wait, rel=1e-9)
    over = (pulses - 1) / rate + wait
    assert limiter.refusal(round((over - 0.01) * SECOND), 0.1, WIDTH).limit == 'wait'
    assert limiter.refusal(round((over + 0.001) * SECOND), 0.1, WIDTH) is None


def test_pulses_that_a_crash_has_left_after_a_train_hide_no_wait_of_it(rapid):
    """What could be read of a reservation that was cut off counts as given at the restart."""
    limiter = PulseLimiter(rapid.limits)
    assert give(limiter, regular(60, 15.0), 1.0) is None
    wait_s = limiter.wait_s
    limiter.book_history([BookedPulse(6 * SECOND, 0.1, 2.5)])
    over = round((59 / 15.0 + wait_s) * SECOND)
    assert wait_s > 10.0
    assert limiter.refusal(7 * SECOND, 0.1, WIDTH).limit == 'wait'
    assert limiter.refusal(over - SECOND, 0.1, WIDTH).limit == 'wait'
    assert limiter.refusal(over + 1, 0.1, WIDTH) is None


@pytest.mark.parametrize(('rate', 'intensity'), [(20.0, 0.7), (15.0, 1.0)])
def test_on_time_in_a_minute(rapid, rate, intensity):
    joule = 252.0 * intensity**2
    on_time = 63_000.0 / (rate * joule)
    limiter = PulseLimiter(rapid.limits)
    given = 0
    while limiter.refusal(round(given / rate * SECOND), intensity, WIDTH) is None:
        limiter.book(round(given / rate * SECOND), intensity)
        given += 1
    # the last pulse that fits begins at most one period before the on-time is over
    assert given / rate == pytest.approx(on_time, abs=1 / rate)
    refusal = limiter.refusal(round(given / rate * SECOND), intensity, WIDTH)
    assert refusal.limit == 'continuous_power_w'


def test_session_outlives_everything():
    limiter = PulseLimiter(Limits(session_pulses=3))
    assert give(limiter, [0.0, 1.0, 2.0], 0.5) is None
    assert limiter.refusal(100 * SECOND, 0.5, WIDTH).limit == 'session_pulses'
    limiter = PulseLimiter(Limits(pulse_energy_j=100.0, session_energy_j=250.0))
    assert give(limiter, [0.0, 1.0], 1.0) is None
    assert limiter.refusal(100 * SECOND, 1.0, WIDTH).limit == 'session_energy_j'


def test_history_counts_as_if_this_process_had_fired_it():
    limits = Limits(pulse_energy_j=100.0, continuous_power_w=30.0, energy_window_s=10.0)
    limiter = PulseLimiter(limits)
    # another device gave the patient the second one, this device another patient the third
    limiter.book_history(
        [
            BookedPulse(-SECOND, 1.0, 100.0),
            BookedPulse(-SECOND // 2, 1.0, 150.0, on_device=False),
            BookedPulse(-SECOND // 4, 0.5, 25.0, on_patient=False),
        ]
    )
    assert (limiter.session_pulses, limiter.session_energy_j) == (2, 250.0)
    # a train of 175 J: 175 / 30 s less the half second that it lasted
    assert limiter.refusal(5 * SECOND, 0.1, WIDTH).limit == 'wait'
    # 275 J of 300 J in ten seconds, until the first of them is ten seconds ago
    assert limiter.refusal(9 * SECOND - 1, 0.6, WIDTH).limit == 'continuous_power_w'
    assert limiter.refusal(9 * SECOND, 0.6, WIDTH) is None


@pytest.mark.parametrize(
    ('changes', 'fault'),
    [
        ({'rate_intensities': (0.5, 1.0)}, IN_STEP),
        ({'rate_intensities': (0.5, 1.0), 'rate_limits_hz': (20.0, 30.0)}, IN_STEP),
        # which of the two?
        ({'rate_intensities': (0.5, 0.5, 1.0), 'rate_limits_hz': (50.0, 20.0, 10.0)}, IN_STEP),
        ({'rate_intensities': (0.5,)}, 'expected a rate limit up to the maximum intensity 1'),
        (
            {'minimum_width_s': 1e-3, 'maximum_width_s': 1e-4},
            'expected minimum_width_s <= maximum_width_s, got 0.001 and 0.0001',
        ),
        ({'maximum_rate_hz': 0.0}, 'maximum_rate_hz: expected a number in'),
        ({'continuous_power_w': math.nan}, 'continuous_power_w: expected a number in'),
    ],
)
def test_impossible_limits_are_refused(changes, fault):
    with pytest.raises(StimulationError, match=fault):
        Limits(**changes)


def test_a_subject_is_led_to_an_intensity_step_by_step():
    limiter = PulseLimiter(Limits(maximum_intensity_rise=0.1, rise_window_s=10.0))
    assert limiter.refusal(0, 0.11, WIDTH).limit == 'maximum_intensity_rise'
    assert give(limiter, [0.0], 0.1) is None
    assert limiter.refusal(SECOND, 0.3, WIDTH).limit == 'maximum_intensity_rise'
    assert give(limiter, [1.0], 0.2) is None
    # what is known may come again after something weaker, until it was too long ago
    assert give(limiter, [2.0, 3.0], 0.0) is None
    assert give(limiter, [4.0], 0.3) is None
    assert give(limiter, [13.0], 0.1) is None
    assert limiter.refusal(14 * SECOND, 0.31, WIDTH) is None
    assert limiter.refusal(14 * SECOND + 1, 0.31, WIDTH).limit == 'maximum_intensity_rise'
    assert give(limiter, [15.0], 0.2) is None


def test_a_pulse_that_came_later_is_known_from_then_on():
    limiter = PulseLimiter(Limits(maximum_intensity_rise=0.1, rise_window_s=10.0))
    limiter.book(0, 0.1)
    limiter.correct(SECOND)
    assert list(limiter.known) == [(SECOND, 0.1)]
    assert limiter.refusal(11 * SECOND, 0.2, WIDTH) is None


def test_no_intensity_of_an_earlier_process_is_known():
    limiter = PulseLimiter(Limits(maximum_intensity_rise=0.1))
    limiter.book_history([BookedPulse(-SECOND, 0.5, 10.0)])
    refusal = limiter.refusal(SECOND, 0.2, WIDTH)
    assert refusal.limit == 'maximum_intensity_rise'
    assert 'at most 0.1 more than 0, the strongest of the 60 s before' in refusal.reason


def test_the_paper_exceeds_the_device(rapid):
    random, sinusoid = forecast(paper_random(), rapid), forecast(paper_sinusoid(), rapid)
    assert not random.deliverable
    assert not sinusoid.deliverable
    # E[u^2] is 1/3 and 3/8: 1680 and 1890 W; the draw of one seed is within 1 % of it
    assert random.mean_power_w == pytest.approx(1680.0, rel=0.01)
    assert sinusoid.mean_power_w == pytest.approx(1890.0, rel=1e-9)
    assert random.max_rate_hz == 20.0
    assert {found.limit for found in random.violations} >= {'rate_limits_hz', 'continuous_power_w'}
    # energy over power, less the 90 s that the train lasted
    assert sinusoid.waits_s == pytest.approx((170_100 / 1050 - 90,), rel=1e-9)


def test_a_dose_that_is_just_used_up_is_not_exceeded_by_rounding(rapid):
    pulses = constant(0.3, 1.0, 10.0)
    for most, exceeded in ((1.0 - 1e-12, False), (0.95, True)):
        dose = DoseLimits(10, most * forecast(pulses, rapid).energy_j, 1.0)
        assert bool(forecast(pulses, rapid, dose).violations) is exceeded


@pytest.mark.parametrize(
    ('schedule', 'limit'),
    [
        (constant(0.3, 1.0, 51.0), 'maximum_rate_hz'),
        (constant(0.5, 1.0, 31.0), 'rate_limits_hz'),
        (constant(0.7, 27.0, 20.0), 'continuous_power_w'),
        (constant(0.1, 101.0, 20.0), 'maximum_train_pulses'),
        (Schedule((Pause(61.0), Single(1.0))), 'idle_disarm_s'),
        (Schedule((*constant(0.7, 20.0, 20.0).segments, Pause(5.0), Single(1.0))), 'wait'),
        (Schedule((Single(1.0),), width_s=1e-3), 'maximum_width_s'),
        (constant(0.45, 90.0, 20.0), 'deliverable'),
    ],
)
def test_each_limit_is_named(rapid, schedule, limit):
    expected = set() if limit == 'deliverable' else {limit}
    assert {found.limit for found in forecast(schedule, rapid).violations} == expected


def test_silence_counts_up_to_the_end(rapid):
    specification = dataclasses.replace(rapid, limits=Limits(idle_disarm_s=5.0))
    assert forecast(Schedule((Pause(4.0), Single(1.0, duration_s=1.0))), specification).deliverable
    trailing = forecast(Schedule((Single(1.0, duration_s=1.0), Pause(5.0))), specification)
    assert [(found.time_s, found.pulses) for found in trailing.violations] == [(6.0, 0)]
    assert not forecast(Schedule((Pause(5.1),)), specification).deliverable


def test_every_rate_at_its_limit_can_go_on_for_ever(rapid):
    """Whatever the rate: 66,666,667 ns and 66,666,666 ns are both a period at 15 Hz."""
    random = np.random.default_rng(1)
    for rate in [15.0, 30.0, 60.0, *random.uniform(0.5, 100.0, 97).tolist()]:
        limits = Limits(maximum_rate_hz=rate, minimum_pause_s=3.0)
        specification = dataclasses.replace(rapid, limits=limits)
        assert forecast(constant(0.5, 500.0 / rate, rate), specification).deliverable, rate


def test_a_rate_above_its_limit_is_refused_at_the_second_pulse(rapid):
    specification = dataclasses.replace(rapid, limits=Limits(maximum_rate_hz=15.0))
    # a period shorter by two nanoseconds
    (found,) = forecast(constant(0.5, 1.0, 1e9 / 66_666_664), specification).violations
    assert (found.limit, found.pulses) == ('maximum_rate_hz', 14)
    assert found.time_s == pytest.approx(1 / 15, abs=1e-6)
