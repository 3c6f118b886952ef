# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A prior is not shown as a measurement."""

from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.identification import Estimate
from rpms_ros.identification.model.physiology import PHYSIOLOGY_NAMES, PRIOR
from rpms_ros.identification.quality.explained_force import (
    informed_parameters,
    informed_physiology,
)

QUANTILE = 1.959964


def estimate(values: list[float], deviations: list[float], peak: float) -> Estimate:
    centre, half = np.array(values), QUANTILE * np.array(deviations)
    return Estimate(
        stamp_ns=0,
        estimator='test',
        nonlinear_names=('u_thr', 'u_sat'),
        nonlinear=np.array([0.5, 0.9]),
        linear_names=(),
        linear=np.empty(0),
        repetition_rate=20.0,
        curve_intensity=np.empty(0),
        curve_force=np.empty(0),
        response_time=np.linspace(0.0, 0.3, 4),
        response_force=peak * np.array([0.0, 1.0, 0.5, 0.0]),
        output_error=0.0,
        samples=1,
        pulses=1,
        physiology_names=PHYSIOLOGY_NAMES,
        physiology=centre,
        physiology_lower=centre - half,
        physiology_upper=centre + half,
        confidence=0.95,
    )


CENTRES = [PRIOR[name][0] for name in PHYSIOLOGY_NAMES[:3]]
SPREADS = [PRIOR[name][1] for name in PHYSIOLOGY_NAMES[:3]]


def narrowed(one: Estimate) -> list[str]:
    return [PHYSIOLOGY_NAMES[index] for index in informed_physiology(one)]


def test_a_prior_is_no_measurement() -> None:
    assert narrowed(estimate([*CENTRES, 3.0], [*SPREADS, 0.1], 3.0)) == ['twitch_peak_n']


def test_what_the_data_determine_is() -> None:
    half = [0.5 * spread for spread in SPREADS]
    assert narrowed(estimate([*CENTRES, 3.0], [*half, 0.1], 3.0)) == list(PHYSIOLOGY_NAMES)
    one = estimate([*CENTRES, 3.0], [half[0], SPREADS[1], half[2], 3.0], 3.0)
    assert narrowed(one) == ['twitch_time_constant_s', 'order']


def test_a_twitch_of_another_height_than_the_response_is_not_informed() -> None:
    half = [0.5 * spread for spread in SPREADS]
    assert narrowed(estimate([*CENTRES, 2e-4], [*half, 1e-5], 3.3)) == []


def test_without_intervals_there_is_nothing_to_show() -> None:
    one = estimate([*CENTRES, 3.0], [1e-3, 1e-3, 0.1, 0.1], 3.0)
    assert narrowed(replace(one, confidence=0.0)) == []


@pytest.mark.parametrize(
    ('flags', 'informed'),
    [([], [True, True]), ([2, 0], [True, False]), ([1, 1], [True, True])],
)
def test_flags_decide_over_parameters(flags: list[int], informed: list[bool]) -> None:
    one = estimate([*CENTRES, 3.0], [*SPREADS, 0.1], 3.0)
    one = replace(one, nonlinear_identifiability=np.array(flags, dtype=np.int64))
    assert informed_parameters(one).tolist() == informed
