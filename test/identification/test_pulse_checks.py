# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses on another clock, and intensities that are no shares of the maximum."""

import re
from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.identification import StreamSettings, estimator_by_name, identify
from rpms_ros.identification.quality.doubts import (
    CLOCKS_DIFFER,
    FORCE_WITHOUT_PULSES,
    stated_doubt,
)
from rpms_ros.identification.quality.verdict import reasons_of_data, verdict_of
from rpms_ros.identification.stream.pulse_checks import no_overlap, of_one_intensity, range_outside
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, ForceTrace, PulseTrain

SELDOM = StreamSettings(estimate_period=2.0)
HOUR_NS = 3_600_000_000_000
STAMPS = 10**18 + 1_000_000 * np.arange(10_000)
FORCES = ForceTrace(STAMPS, np.sin(0.01 * np.arange(10_000)))
RANDOM = np.random.default_rng(1).uniform(0.0, 1.0, 200)


def pulses_of(intensity, late_ns=0) -> PulseTrain:
    return PulseTrain.regular(intensity, 20.0, 10**18 + late_ns)


def reasons_of(pulses, forces=FORCES) -> list[tuple[str, str]]:
    return list(reasons_of_data(pulses, forces, 200.0, 0.05))


@pytest.mark.parametrize(
    ('late_ns', 'spans'),
    [
        (HOUR_NS, 'from 3600.0 s to 3609.9 s, force from 0.0 s to 10.0 s'),
        (-HOUR_NS, 'from 0.0 s to 9.9 s, force from 3600.0 s to 3610.0 s'),
    ],
)
def test_pulses_on_another_clock_are_told_with_both_times(late_ns, spans):
    pulses = pulses_of(RANDOM, late_ns)
    text = f'pulses are {spans}: they do not overlap'
    assert no_overlap(pulses.onset_ns, STAMPS) == text
    assert reasons_of(pulses) == [('no', f'{CLOCKS_DIFFER}: {text}')]


def test_pulses_that_begin_before_the_force_overlap_with_it():
    assert no_overlap(pulses_of(RANDOM, -5_000_000_000).onset_ns, STAMPS) is None
    assert no_overlap(np.empty(0, np.int64), STAMPS) is None
    assert reasons_of(pulses_of(RANDOM)) == []


@pytest.mark.parametrize(
    ('intensity', 'text'),
    [
        (100.0 * np.linspace(0.0, 0.989, 200), 'up to 98.9: percent?'),
        (np.array([0.5, 99.8]), 'up to 99.8: percent?'),
        (np.array([0.5, -0.1, 1.1]), 'from -0.1 to 1.1'),
        (np.array([0.5, 1.5]), '1.5'),
        (np.array([0.5, 300.0, 800.0]), 'from 300 to 800'),
        (np.array([0.5, np.nan]), 'not finite'),
    ],
)
def test_the_range_of_wrong_intensities_has_a_guess_at_their_unit(intensity, text):
    assert range_outside(intensity) == text


def test_intensities_that_are_mostly_no_shares_are_the_reason_of_a_no():
    percent = np.linspace(0.0, 99.8, 200)
    count = np.count_nonzero(percent > 1.0)
    named = f'pulse_intensity_invalid: the intensity of {count} of 200 pulses is outside 0 to 1'
    assert reasons_of(pulses_of(percent)) == [('no', f'{named} (up to 99.8: percent?)')]
    ((grade, text),) = reasons_of(pulses_of(-RANDOM))
    assert grade == 'no'
    assert text.startswith('pulse_intensity_invalid: the intensity of 200 of 200 pulses')
    assert reasons_of(pulses_of(np.zeros(200))) == [('no', 'there is no pulse above intensity 0')]


def test_a_force_that_no_sensor_resolves_may_be_in_kilonewtons():
    small = replace(FORCES, force=1e-3 * FORCES.force)
    ((grade, text),) = reasons_of(pulses_of(RANDOM), small)
    assert grade == 'doubtful'
    assert text == (
        'the force spans 0.002 N, less than the 0.05 N that a sensor for people resolves: '
        'is the force in kN?'
    )
    assert not list(reasons_of_data(pulses_of(RANDOM), small, 200.0, 0.05, 'N m'))


@pytest.mark.parametrize(
    ('pulses', 'one'),
    [
        (pulses_of(np.full(200, 0.7)), True),
        (pulses_of(np.append(RANDOM[:0], 0.7)), True),
        (pulses_of(np.tile([0.0, 0.7], 100)), True),
        (pulses_of(RANDOM), False),
        (pulses_of(RANDOM, HOUR_NS), False),
        (pulses_of(-RANDOM), False),
        (pulses_of(np.zeros(200)), False),
        # those outside 0 to 1 are not used
        (pulses_of(np.tile([70.0, 0.7], 100)), True),
    ],
)
def test_one_intensity_is_that_of_the_pulses_that_were_used(pulses, one):
    assert of_one_intensity(pulses, STAMPS) is one


def answered(intensity, seconds, rate=20.0) -> tuple[PulseTrain, ForceTrace]:
    """Pulses from 1 s on, and the noisy force that a muscle answers with."""
    pulses = PulseTrain.regular(intensity, rate, NANOSECONDS_PER_SECOND)
    muscle = Contraction(simulation_subject())
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = np.arange(round(1000 * seconds), dtype=np.int64) * 1_000_000
    noise = 0.05 * np.random.default_rng(2).standard_normal(len(stamps))
    return pulses, ForceTrace(stamps, muscle.force(stamps) + noise)


def shifted(forces, seconds) -> ForceTrace:
    return ForceTrace(forces.stamp_ns + round(seconds * NANOSECONDS_PER_SECOND), forces.force)


@pytest.fixture(scope='module')
def random_session() -> tuple[PulseTrain, ForceTrace]:
    return answered(np.random.default_rng(1).uniform(0.0, 1.0, 290), 17.0)


@pytest.mark.parametrize(
    ('ahead', 'said'),
    [
        (5.0, 'pulses are stamped 5.* s before the force'),
        (0.3, r'pulses are stamped 0\.3\d* s before the force'),
        (0.1, r'pulses are stamped 0\.1\d* s before the force'),
        (-0.05, r'the force answers 0\.04\d* s before the pulses'),
        (-0.1, r'the force answers 0\.09\d* s before the pulses'),
        (-5.0, r'the force answers (4\.99|5)\d* s before the pulses'),
        (0.06, r'the force answers 0\.06\d* s after the pulses'),
        (-1e5, 'pulses are stamped 1e.05 s after the force'),
    ],
)
def test_a_sensor_of_another_clock_is_said_with_the_distance(random_session, ahead, said):
    pulses, forces = random_session
    # the order of arrival is that of the events, whatever the stamps say
    before = np.searchsorted(forces.stamp_ns, pulses.onset_ns) + 5
    moved = shifted(forces, ahead)
    recursive = estimator_by_name('recursive')
    found = identify(recursive, pulses, moved, SELDOM, samples_before_pulse=before)
    assert CLOCKS_DIFFER in found.last.doubts
    assert re.search(said, stated_doubt(found.last, CLOCKS_DIFFER))
    verdict = verdict_of(found, pulses, moved)
    assert verdict.grade == 'no'
    assert CLOCKS_DIFFER in verdict.line


@pytest.mark.parametrize('ahead', [5.0, -0.1])
def test_without_an_order_of_arrival_the_force_tells_the_clock(random_session, ahead):
    pulses, forces = random_session
    found = identify(estimator_by_name('batch'), pulses, shifted(forces, ahead))
    assert CLOCKS_DIFFER in found.last.doubts


def test_pulses_that_are_held_up_once_are_of_no_other_clock(random_session):
    pulses, forces = random_session
    before = np.searchsorted(forces.stamp_ns, pulses.onset_ns) + 5
    before[100:120] = before[120]
    found = identify(estimator_by_name('recursive'), pulses, forces, samples_before_pulse=before)
    assert all(CLOCKS_DIFFER not in one.doubts for one in found.estimates)
    assert found.last.faults['pulse_late'] > 10


@pytest.mark.parametrize('seconds', [4.0, 8.0, 17.0])
def test_noise_is_of_no_other_clock(random_session, seconds):
    pulses, forces = random_session
    count = round(1000 * seconds)
    for seed in range(2):
        noise = np.random.default_rng(seed).standard_normal(count)
        trace = ForceTrace(forces.stamp_ns[:count], noise)
        found = identify(estimator_by_name('recursive'), pulses, trace, SELDOM)
        assert not {CLOCKS_DIFFER, FORCE_WITHOUT_PULSES} & set(found.last.doubts)


@pytest.mark.parametrize('known', [slice(30), slice(60, 100)])
def test_pulses_missing_at_an_end_are_said(known):
    pulses, forces = answered(np.full(100, 0.8), 8.0)
    for name in ('batch', 'recursive'):
        found = identify(estimator_by_name(name), pulses[known], forces)
        assert FORCE_WITHOUT_PULSES in found.last.doubts
        verdict = verdict_of(found, pulses[known], forces)
        assert verdict.grade != 'good'
        assert 'without a pulse the force goes on at the rate of the pulses' in verdict.line
    assert (
        FORCE_WITHOUT_PULSES
        not in identify(estimator_by_name('batch'), pulses, forces).last.doubts
    )
