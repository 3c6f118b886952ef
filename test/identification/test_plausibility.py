# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""An impossible estimate has doubts."""

from dataclasses import replace

import numpy as np

from rpms_ros.identification import FixedSizeRecursion, identify
from rpms_ros.identification.quality.doubts import REASON
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import ForceTrace, PulseTrain


def slow_sinusoid(noise: float, seed: int, latency: float = 0.0) -> tuple[PulseTrain, ForceTrace]:
    """A minute of the paper's sinusoid of 18 s."""
    intensity = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(1200) / 20.0 / 18.0)
    pulses = PulseTrain.regular(intensity, 20.0)
    muscle = Contraction(replace(simulation_subject(), latency=latency))
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = 1_000_000 * np.arange(60_000, dtype=np.int64)
    noises = noise * np.random.default_rng(seed).standard_normal(len(stamps))
    return pulses, ForceTrace(stamps, muscle.force(stamps) + noises)


def test_a_muscle_that_answers_before_the_functions_begin_is_doubtful() -> None:
    # Under a slow sinusoid at one rate the response is hardly seen: what the functions miss of
    # it turns it upside down, while the curve stays right.
    last = identify(FixedSizeRecursion(), *slow_sinusoid(0.02, 1)).last
    assert last.doubts == ('response_negative',)
    assert last.reasons == (REASON['response_negative'],)


def test_a_curve_that_is_hardly_known_says_so() -> None:
    pulses, forces = slow_sinusoid(0.02, 2)
    early = forces.stamp_ns < 3_000_000_000
    first = ForceTrace(forces.stamp_ns[early], forces.force[early])
    last = identify(FixedSizeRecursion(), pulses[pulses.onset_ns < 3_000_000_000], first).last
    assert 'band_wider_than_curve' in last.doubts
