# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Values of simulated muscles, efforts and sensors that are refused."""

import math
from functools import partial as of

import pytest

from rpms_ros.errors import MuscleError
from rpms_ros.muscle import (
    Contraction,
    Disturbances,
    IntensityRecruitment,
    RateRecruitment,
    Subject,
    average_subject,
    steady_mean,
    subject_by_name,
    summed_twitches,
    twitch,
    twitch_area,
)
from rpms_ros.muscle.scenario import Spasm, Tremor, VoluntaryEffort
from rpms_ros.muscle.sensor import SensorFault
from rpms_ros.muscle.time_varying import Change, Fatigue, Potentiation

NAN, INF = math.nan, math.inf
IMPOSSIBLE = (0.0, -1.0, NAN, INF)
ENDS, SLOPES = ('threshold', 'saturation'), ('threshold_slope', 'saturation_slope')
RATES, RATE = ('slope', 'gain', 'lowest_rate'), 'repetition rate above 0 Hz, got'
POSITIVE = ('drift_period', 'artifact_decay', 'saturation')


def each(make, names, values, fault):
    """Make with each value of each name; the fault names it."""
    return [(of(make, **{name: one}), fault.format(name)) for name in names for one in values]


@pytest.mark.parametrize(
    ('make', 'fault'),
    [
        (of(IntensityRecruitment, 0.9, 0.5), r'saturation above 0\.9, got 0\.5'),
        *each(IntensityRecruitment, SLOPES, [0.0], '{} above 0, got'),
        *each(IntensityRecruitment, (*ENDS, *SLOPES, 'gain', 'offset'), (NAN, INF), 'finite {}'),
        (IntensityRecruitment(0.1, 0.2, 0.1, 50.0).normalised, r'rho_u\(1\) > rho_u\(0\), got'),
        *each(RateRecruitment, ('saturation', 'offset', *RATES), (NAN, INF), 'finite {}'),
        *each(RateRecruitment, RATES, (0.0, -0.05), '{} above 0, got'),
        (of(RateRecruitment, offset=-2.0), r'rho_f at 15\.0 Hz above 0, got -0\.89'),
        *each(Subject, ['latency'], (-1, NAN, INF), '{} of at least 0 s, got'),
        *each(Subject, ['order'], (0, 7, -1), '{} from 1 to 6, got'),
        *each(Subject, ['maximum_force'], IMPOSSIBLE, 'force above 0 N, got'),
        *each(Subject, ['time_constant'], IMPOSSIBLE, 'time constant above 0 s, got'),
        *each(of(twitch, 0.1), ['time_constant'], IMPOSSIBLE, 'time constant above 0 s, got'),
        *each(twitch_area, ['time_constant'], IMPOSSIBLE, 'time constant above 0 s, got'),
        *each(of(steady_mean, 20.0), ['time_constant'], IMPOSSIBLE, 'time constant above 0 s'),
        *each(of(twitch, 0.1, 0.04), ['order'], (0.99, -1.0, NAN, INF), 'order of at least 1'),
        (of(subject_by_name, 'x'), "a subject of rpms, fes, simulation, random, got 'x'"),
        *each(of(summed_twitches, 0.1, time_constant=0.04), ['rate_hz'], IMPOSSIBLE, RATE),
        *each(of(Contraction, average_subject()), ['fixed_rate_hz'], IMPOSSIBLE, RATE),
        (
            of(Contraction(average_subject()).add_pulses, [0, 1], [0.5]),
            'as many intensities as onsets, got 1 and 2',
        ),
        (of(Fatigue, force_loss=-1.0), 'finite force_loss of at least 0, got -1'),
        (of(Fatigue, recovery=0.0), 'finite recovery above 0 s, got 0'),
        (of(Fatigue, lowest_gain=0.0), 'lowest_gain above 0 up to 1, got 0'),
        (of(Potentiation, per_pulse=2.0), 'per_pulse from 0 to 1, got 2'),
        (of(Potentiation, decay=NAN), 'finite decay above 0 s, got nan'),
        (of(Change, -1.0, gain=1.0), 'finite at of at least 0 s, got -1'),
        (of(Change, 1.0, time_constant=0.0), 'time_constant above 0 up to 1, got 0'),
        (of(Change, 1.0, time_constant=38.0), 'time_constant above 0 up to 1, got 38'),
        (of(Change, 1.0, gain=1e308), r'gain from 0 to 100, got 1e\+308'),
        (of(Change, 1.0, latency=9.0), 'latency from 0 to 1, got 9'),
        (of(Change, 1.0, threshold=9.0), 'threshold from -1 to 3, got 9'),
        (of(Change, 1.0, saturation=NAN), 'saturation from -1 to 3, got nan'),
        (
            of(Change, 1.0, 2.0, threshold=0.9, saturation=0.3),
            r'saturation at least 0\.05 above the threshold, got 0\.3 and 0\.9 at 3 s',
        ),
        (of(Change, 1.0), 'expected a change of gain, time_constant, .*, got none'),
        (of(VoluntaryEffort, at=-1.0, duration=1.0, peak=1.0), 'at of at least 0 s, got -1'),
        (of(VoluntaryEffort, at=0.0, duration=0.0, peak=1.0), 'duration above 0 s, got 0'),
        (
            of(VoluntaryEffort, at=0.0, duration=2.0, peak=1.0, every=1.0),
            'a finite every of at least 2 s, got 1',
        ),
        (of(Spasm, 0.0, 1.0, rise=0.0), 'finite rise above 0 s, got 0'),
        (of(Spasm, 0.0, NAN), 'finite peak, got nan'),
        (of(Spasm, 0.0, 1.0, decay=0.0), 'finite decay above 0 s, got 0'),
        (of(Tremor, 0.1, 0.0), 'frequency above 0 up to 1000 Hz, got 0'),
        (of(SensorFault, 'melted', 0.0, 1.0), "a fault of frozen, .* got 'melted'"),
        (of(SensorFault, 'lost', -1.0, 1.0), 'finite at of at least 0 s, got -1'),
        (of(SensorFault, 'lost', 0.0, 0.0), 'finite duration above 0 s, got 0'),
        (of(SensorFault, 'clipped', 0.0, 1.0), 'a value for a clipped sensor, got 0'),
        (of(SensorFault, 'clipped', 0.0, 1.0, INF), 'a finite value, got inf'),
        *each(Disturbances, ['noise'], (-0.1, NAN, INF), '{} of at least 0 N'),
        *each(Disturbances, POSITIVE, (0.0, -1.0, NAN), 'expected a {} above 0, got'),
        *each(
            Disturbances, ('offset', 'drift', 'artifact'), (NAN, INF), 'expected a finite {}, got'
        ),
    ],
)
def test_values_that_cannot_be_are_refused(make, fault):
    with pytest.raises(MuscleError, match=fault):
        make()
