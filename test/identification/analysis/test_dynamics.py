# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Trains of one intensity: onset of the force, T_a and latency with intervals, at their rate."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rpms_ros.identification.analysis import analyze
from rpms_ros.identification.analysis.dynamics import TrainDynamics, train_dynamics
from rpms_ros.identification.analysis.responses import Response
from rpms_ros.identification.analysis.trains import force_onset
from rpms_ros.muscle import twitch
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording.importing import read_csv

FOLDER = Path(os.environ.get('RPMS_RECORDINGS', Path(__file__).parents[3] / '../shared/data'))
TRIALS = sorted((FOLDER / 'rat_gastrocnemius').glob('*.csv'))
COLUMNS = ('Time [s]', 'fGM [N]', 'STIM [ ]')
CONSTANT, LATENCY, GAIN = 12e-3, 8e-3, 2.0
RATE = 50.0
# A twitch of order 3 rises as the square of the time: 4 deviations of 1e-4 N are passed when
# 2 (x/2)^2 e^2 is 4e-4 N, that is 0.13 ms after its foot; then there is a sample within 0.5 ms.
LATE = 0.7e-3


def trains(count, seed, noise=1e-4, first=1.0) -> tuple[PulseTrain, ForceTrace]:
    """Trains of eight pulses, three seconds apart, at 2 kHz; the first is so much stronger."""
    random = np.random.default_rng(seed)
    onset = np.concatenate([1.0 + 3.0 * k + np.arange(8) / RATE for k in range(count)])
    stamp = np.arange(round(2000 * (3.0 * count + 0.5))) / 2000
    lag = stamp[:, None] - onset - LATENCY
    weight = np.where(np.arange(8 * count) % 8 == 0, first, 1.0)
    force = GAIN * twitch(lag, CONSTANT, 3) @ weight
    force += noise * random.standard_normal(len(force))
    pulses = PulseTrain(
        np.rint(1e9 * onset).astype(np.int64),
        np.full(len(onset), 0.8),
        np.arange(len(onset)),
        np.full(len(onset), 1e-4),
    )
    return pulses, ForceTrace(np.rint(1e9 * stamp).astype(np.int64), force)


def found_in(pulses, forces) -> TrainDynamics:
    found = train_dynamics(analyze(pulses, forces))
    assert found is not None
    return found


@pytest.mark.parametrize('count', [1, 3])
def test_equal_pulses_are_found_at_their_own_rate(count):
    found = found_in(*trains(count, seed=1))
    assert (found.trains, found.pulses, found.model) == (count, 8 * count, 'equal pulses')
    assert found.rate_hz == pytest.approx(RATE, rel=1e-6)
    # noise is 1e-4 of the force: what is left is the search's own tolerance
    assert found.twitch_time_constant_s.value == pytest.approx(CONSTANT, rel=1e-3)
    assert found.latency_s.value == pytest.approx(LATENCY, abs=2e-5)
    assert found.fit_percent > 99.9
    assert found.onset_s is not None
    assert found.onset_s.lower <= LATENCY <= found.onset_s.value <= LATENCY + LATE


@pytest.mark.long
def test_the_intervals_hold_the_truth():
    inside = {'twitch_time_constant_s': 0, 'latency_s': 0}
    for seed in range(20):
        found = found_in(*trains(1, seed, noise=0.02))
        for name, true in (('twitch_time_constant_s', CONSTANT), ('latency_s', LATENCY)):
            stated = getattr(found, name)
            inside[name] += stated.lower <= true <= stated.upper
            # narrow enough to say something: the noise is a hundredth of the force
            assert stated.upper - stated.lower < 0.3 * true
    # 95 % intervals: 15 of 20 or fewer come in one of 3000 studies
    assert min(inside.values()) >= 16, inside


def test_the_intervals_hold_the_truth_if_pulses_are_not_quite_equal():
    # as after a pause, at 20 Hz for instance; the model of equal pulses is the better of the two
    found = found_in(*trains(6, seed=3, noise=0.02, first=1.04))
    assert found.model == 'equal pulses'
    for name, true in (('twitch_time_constant_s', CONSTANT), ('latency_s', LATENCY)):
        stated = getattr(found, name)
        assert stated.lower <= true <= stated.upper, name
        assert stated.upper - stated.lower < 0.1 * true


def test_recordings_without_a_train_have_none():
    pulses, forces = trains(1, seed=1)
    assert train_dynamics(analyze(pulses[:1], forces)) is None


def response(force, lag) -> Response:
    usable = np.ones(len(lag), dtype=np.bool_)
    return Response(np.zeros(1), lag, force, usable, 1.0, np.nan)


def test_the_onset_is_that_of_the_force_and_no_single_outlier():
    lag = np.arange(-100, 400) / 2000
    noise = 1e-3 * np.random.default_rng(2).standard_normal(len(lag))
    force = np.maximum(lag - 0.020, 0.0) + noise
    force[130] += 1.0
    found = force_onset(response(force, lag))
    assert found is not None
    lower, upper = found
    # a slope of 1 N/s passes 4 deviations, 4 mN, 4 ms later, and lies above the baseline soon
    assert lower < 0.020 + 1e-3
    assert 0.020 < upper < 0.020 + 6e-3


def test_noise_hides_an_onset():
    lag = np.arange(-100, 400) / 2000
    noise = np.random.default_rng(2).standard_normal(len(lag))
    assert force_onset(response(noise, lag)) is None
    assert force_onset(response(np.zeros(len(lag)), lag)) is None
    blind = replace(response(noise, lag), usable=lag > 0.0)
    assert force_onset(blind) is None


@pytest.mark.skipif(not TRIALS, reason=f'no recordings in {FOLDER} (set RPMS_RECORDINGS)')
@pytest.mark.parametrize('trial', TRIALS[::5], ids=lambda path: path.stem)
def test_real_force_leaves_its_baseline_within_four_milliseconds(trial):
    found = found_in(*read_csv(trial, *COLUMNS))
    assert found.model == 'history law'
    assert found.fit_percent > 94.0
    assert found.onset_s is not None
    assert 2.5e-3 <= found.onset_s.value <= 4.5e-3
    # the twitch of a rat, at 100 Hz as it was given; equal pulses alone make it 7 to 15 ms
    assert found.rate_hz == pytest.approx(100.0, rel=0.05)
    assert 3e-3 < found.twitch_time_constant_s.value < 9e-3
    for stated in (found.twitch_time_constant_s, found.latency_s):
        assert stated.lower <= stated.value <= stated.upper
