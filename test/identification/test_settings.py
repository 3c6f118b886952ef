# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings: the paper's tables, and what is refused."""

import math
from dataclasses import replace

import pytest

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import (
    TABLE_4,
    TABLE_5,
    RecruitmentBounds,
    settings_by_name,
)
from rpms_ros.muscle.recruitment import RecruitmentParameters


def test_presets_by_name() -> None:
    assert settings_by_name('paper_table_4') is TABLE_4
    assert settings_by_name('paper_table_5') is TABLE_5
    with pytest.raises(IdentificationError, match=r"expected a preset of people, .* got 'x'"):
        settings_by_name('x')


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'forgetting': 0.0}, r'expected 0 < forgetting <= 1, got 0\.0'),
        ({'forgetting': 1.1}, r'expected 0 < forgetting <= 1, got 1\.1'),
        ({'gain_ratio_margin': 0.5}, r'expected 0 <= gain ratio margin < 0\.5, got 0\.5'),
        ({'damping_factor': 1.0}, r'expected a damping factor > 1, got 1\.0'),
        ({'condition_limit': 1.0}, r'expected a condition limit > 1, got 1\.0'),
        ({'damping': 0.0}, r'expected damping above 0, got 0\.0'),
        ({'force_scale': math.nan}, 'expected force_scale above 0, got nan'),
        ({'linear_covariance': math.inf}, 'expected linear_covariance above 0, got inf'),
        ({'start': RecruitmentParameters(0.9, 0.4, 3.0)}, 'expected a start within the bounds'),
        ({'start': RecruitmentParameters(math.nan, 0.4, 3.0)}, 'expected a start within'),
        (
            {'start': RecruitmentParameters(0.4, 0.9, 3.0, math.nan)},
            'expected alpha_thr above 0, got nan',
        ),
    ],
)
def test_impossible_settings_are_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        replace(TABLE_4, **values)


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'u_thr': (0.5, 0.5)}, r'expected bounds of u_thr in order, got 0\.5, 0\.5'),
        ({'u_sat': (math.nan, 1.0)}, 'expected bounds of u_sat in order, got nan'),
        ({'alpha_sat': (1.0, math.inf)}, 'expected bounds of alpha_sat in order'),
        ({'separation': 0.0}, r'expected a separation above 0, got 0\.0'),
        ({'u_sat': (0.1, 1.0)}, 'expected room for the separation'),
    ],
)
def test_impossible_bounds_are_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        RecruitmentBounds(**values)
