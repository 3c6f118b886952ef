# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses on another clock, and intensities that are no shares of the maximum."""

from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.identification.pulse_checks import no_overlap
from rpms_ros.identification.pulse_checks import of_one_intensity
from rpms_ros.identification.pulse_checks import range_outside
from rpms_ros.identification.verdict_of_data import reasons
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import PulseTrain

HOUR_NS = 3_600_000_000_000
STAMPS = 10**18 + 1_000_000 * np.arange(10_000)
FORCES = ForceTrace(STAMPS, np.sin(0.01 * np.arange(10_000)))
RANDOM = np.random.default_rng(1).uniform(0.0, 1.0, 200)


def pulses_of(intensity: np.ndarray, late_ns: int = 0) -> PulseTrain:
    return PulseTrain.regular(intensity, 20.0, 10**18 + late_ns)


def reasons_of(pulses: PulseTrain, forces: ForceTrace = FORCES) -> list[tuple[str, str]]:
    return list(reasons(pulses, forces, 200.0, 0.05))


@pytest.mark.parametrize(
    ('late_ns', 'spans'),
    [
        (HOUR_NS, 'from 3600.0 s to 3609.9 s, force from 0.0 s to 10.0 s'),
        (-HOUR_NS, 'from 0.0 s to 9.9 s, force from 3600.0 s to 3610.0 s'),
    ],
)
def test_pulses_on_another_clock_are_told_with_both_times(late_ns: int, spans: str) -> None:
    pulses = pulses_of(RANDOM, late_ns)
    text = f'pulses are {spans}: they do not overlap'
    assert no_overlap(pulses.onset_ns, STAMPS) == text
    assert reasons_of(pulses) == [('no', text)]


def test_pulses_that_begin_before_the_force_overlap_with_it() -> None:
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
def test_the_range_of_wrong_intensities_has_a_guess_at_their_unit(
    intensity: np.ndarray, text: str
) -> None:
    assert range_outside(intensity) == text


def test_intensities_that_are_mostly_no_shares_are_the_reason_of_a_no() -> None:
    percent = np.linspace(0.0, 99.8, 200)
    count = np.count_nonzero(percent > 1.0)
    named = f'pulse_intensity_invalid: the intensity of {count} of 200 pulses is outside 0 to 1'
    assert reasons_of(pulses_of(percent)) == [('no', f'{named} (up to 99.8: percent?)')]
    ((grade, text),) = reasons_of(pulses_of(-RANDOM))
    assert grade == 'no'
    assert text.startswith('pulse_intensity_invalid: the intensity of 200 of 200 pulses')
    assert reasons_of(pulses_of(np.zeros(200))) == [('no', 'there is no pulse above intensity 0')]


def test_a_force_that_no_sensor_resolves_may_be_in_kilonewtons() -> None:
    small = replace(FORCES, force=1e-3 * FORCES.force)
    ((grade, text),) = reasons_of(pulses_of(RANDOM), small)
    assert grade == 'doubtful'
    assert text == (
        'the force spans 0.002 N, less than the 0.05 N that a sensor for people resolves: '
        'is the force in kN?'
    )
    assert not list(reasons(pulses_of(RANDOM), small, 200.0, 0.05, 'N m'))


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
def test_one_intensity_is_that_of_the_pulses_that_were_used(pulses: PulseTrain, one: bool) -> None:
    assert of_one_intensity(pulses, STAMPS) is one
