# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of identification and analysis that are refused."""

import math
from dataclasses import replace
from functools import partial as of

import pytest

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import (
    TABLE_4,
    BatchEstimator,
    DistortedSineBasis,
    FixedSizeRecursion,
    LaguerreBasis,
    ModifiedRecursiveLM,
    StreamSettings,
    estimator_by_name,
)
from rpms_ros.identification.analysis import TrainLaw
from rpms_ros.identification.catalogue import EstimatorOptions
from rpms_ros.identification.quality.verdict import verdict_of
from rpms_ros.muscle import RecruitmentParameters as Theta

NAN, INF = math.nan, math.inf
ESTIMATORS = (BatchEstimator, FixedSizeRecursion, ModifiedRecursiveLM)
table = of(replace, TABLE_4)


@pytest.mark.parametrize(
    ('make', 'fault'),
    [
        (of(table, forgetting=0.0), r'forgetting above 0 up to 1, got 0\.0'),
        (of(table, forgetting=1.1), r'forgetting above 0 up to 1, got 1\.1'),
        (of(table, gain_ratio_margin=0.5), r'expected 0 <= gain ratio margin < 0\.5, got 0\.5'),
        (of(table, damping_factor=1.0), r'damping_factor above 1, got 1\.0'),
        (of(table, condition_limit=1.0), r'condition_limit above 1, got 1\.0'),
        (of(table, damping=0.0), r'finite damping above 0, got 0\.0'),
        (of(table, force_scale=NAN), 'finite force_scale above 0, got nan'),
        (of(table, linear_covariance=INF), 'finite linear_covariance above 0, got inf'),
        (of(table, start=Theta(0.9, 0.4, 3.0)), 'expected a start within the bounds'),
        (of(table, start=Theta(NAN, 0.4, 3.0)), 'expected a start within'),
        (of(table, start=Theta(0.4, 0.9, 3.0, NAN)), 'finite alpha_thr above 0, got nan'),
        (of(DistortedSineBasis, functions=0), 'number of basis functions from 1 to 350, got 0'),
        (
            of(DistortedSineBasis, functions=351),
            'number of basis functions from 1 to 350, got 351',
        ),
        (of(DistortedSineBasis, form_factor=0.0), r'a finite form factor above 0, got 0\.0'),
        (of(DistortedSineBasis, form_factor=NAN), 'a finite form factor above 0, got nan'),
        (of(DistortedSineBasis, tap=-1e-3), r'a finite tap above 0 s, got -0\.001'),
        (of(LaguerreBasis, 0, 38e-3, 0.0), 'number of Laguerre functions from 1 to 16, got 0'),
        (of(LaguerreBasis, 6, 0.0, 0.0), 'a finite time constant above 0 s, got 0.0'),
        (of(LaguerreBasis, 6, 38e-3, -1e-3), 'finite latency of at least 0 s, got -0.001'),
        (of(StreamSettings, pulse_look_ahead=0.3), r'pulse_look_ahead from 0 to 0\.2 s, got 0\.3'),
        (of(StreamSettings, reorder_delay=INF), 'finite reorder_delay of at least 0 s, got inf'),
        (of(StreamSettings, estimate_period=0.0), 'a finite estimate_period above 0 s, got 0'),
        (of(StreamSettings, largest_force=0.0), 'a finite largest_force above 0 N, got 0'),
        (of(verdict_of, None, None, None, 0.0), 'a finite largest force above 0 N, got 0'),
        *((of(TrainLaw, **{name: 0.0}), f'{name} above 0, got 0') for name in TrainLaw.POSITIVE),
        (of(TrainLaw, facilitation=-1.0), 'facilitation of at least 0, got -1'),
        *(
            (of(estimator, rate_hz=rate), 'repetition rate above 0 Hz, got')
            for estimator in ESTIMATORS
            for rate in (0.0, -1.0, NAN, INF)
        ),
        *(
            (
                of(estimator_by_name, 'batch', rate_hz=rate),
                f'expected a repetition rate from 0.1 to 1000 Hz, got {rate!r}',
            )
            for rate in (0.0, 0.09, 1e6, NAN, '20')
        ),
        *(
            (of(EstimatorOptions, seed=seed), f'expected a seed, .*, got {seed!r}')
            for seed in (-1, 1.5, '1', 2**53 + 1)
        ),
    ],
)
def test_settings_that_cannot_be_are_refused(make, fault) -> None:
    with pytest.raises(IdentificationError, match=fault):
        make()
