# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Outages, gaps and jumps: what is known is kept, and no prediction diverges."""

from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.identification.estimation.batch import BatchEstimator
from rpms_ros.identification.estimation.settings import ProjectionSettings
from rpms_ros.identification.estimation.tracking import TrackingEstimator, TrackingSettings
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.session import identify
from rpms_ros.pulses import ForceTrace, PulseTrain

SETTINGS = ProjectionSettings(basis=LaguerreBasis(7, 38e-3, 0.0))
TRACKING = TrackingSettings(basis=SETTINGS.basis, choose_basis=False)
SECOND_NS = 1_000_000_000


def session_of(estimator, take, kept):
    """Return the session of an estimator over the samples that are kept."""
    count = len(take.onset_ns)
    order = np.arange(count, dtype=np.int64)
    pulses = PulseTrain(take.onset_ns, take.intensity, order, np.zeros(count))
    return identify(estimator, pulses, ForceTrace(take.stamp_ns[kept], take.force[kept]))


@pytest.mark.parametrize('after', [0.7, 1.5, 4.0])
def test_pulses_through_an_outage_of_the_force_destroy_nothing(after, record):
    """150 s at 20 Hz without force are more pulses than the window has room for."""
    take = record(12.0 + 150.0 + after, noise=0.005)
    kept = (take.stamp_ns < 12 * SECOND_NS) | (take.stamp_ns >= 162 * SECOND_NS)
    estimate = session_of(TrackingEstimator(TRACKING), take, kept).last
    assert estimate.confidence == 0.95
    assert take.curve_error(estimate) < 0.01
    half = (estimate.curve_upper - estimate.curve_force).max() / take.curve.max()
    # Twelve seconds at 0.5 % noise tell the curve to 0.2 %; it is neither lost nor more certain.
    assert 1e-4 < half < 0.02


def test_more_pulses_than_there_is_room_for_are_a_fault(record):
    take = record(8.0, noise=0.005)
    estimator = TrackingEstimator(replace(TRACKING, window=2.0))
    take.feed(estimator)
    kept = estimator.estimate(0, {})
    last_ns = int(take.stamp_ns[-1])
    onset = last_ns + np.arange(1, 2001, dtype=np.int64) * 100_000
    estimator.add_pulses(onset, np.zeros(2000))
    stamps = last_ns + 210_000_000 + np.arange(3, dtype=np.int64) * 1_000_000
    estimator.update(stamps, np.zeros(3), np.ones(3, dtype=bool))
    estimate = estimator.estimate(0, {'force_gap': 2})
    assert estimate.faults['pulses_too_frequent'] > 1000
    assert estimate.faults['force_gap'] == 2
    # What was known is kept: the pulses that were dropped had no intensity.
    np.testing.assert_allclose(
        estimate.curve_force, kept.curve_force, atol=0.02 * take.curve.max()
    )


@pytest.mark.parametrize('gap', [5, 60])
def test_the_prediction_after_a_gap_stays_near_the_force(gap, record):
    take = record(10.0 + gap + 3.0, noise=0.005)
    # A drift that the baseline follows with a slope: 0.2 N a second of forces that peak at 7 N
    take.force[:10_000] += 0.2 * 1e-9 * take.stamp_ns[:10_000]
    take.force[10_000:] += 2.0
    kept = (take.stamp_ns < 10 * SECOND_NS) | (take.stamp_ns >= (10 + gap) * SECOND_NS)
    session = session_of(BatchEstimator(SETTINGS), take, kept)
    later = session.stamp_ns >= (10 + gap) * SECOND_NS + 700_000_000
    # Noise of 0.5 % and the drift that the batch did not see since its last fit
    assert np.abs(session.prediction - session.force)[later].max() < 2.0


def test_the_prediction_after_a_jump_stays_near_the_force(record):
    take = record(10.0, noise=0.005)
    take.force[:] += 0.2 * 1e-9 * take.stamp_ns
    estimator = BatchEstimator(SETTINGS)
    take.feed(estimator)
    estimator.estimate(0, {})
    estimator.forget_pulses()
    again = record(2.0, noise=0.005, seed=8)
    again.force[:] += 2.0
    again = replace(
        again,
        onset_ns=again.onset_ns - 3600 * SECOND_NS,
        stamp_ns=again.stamp_ns - 3600 * SECOND_NS,
    )
    prediction = again.feed(estimator)
    assert np.abs(prediction - again.force)[700:].max() < 2.0


def test_a_failed_factorisation_is_counted_and_moves_nothing(record):
    take = record(4.0, noise=0.01)
    estimator = BatchEstimator(SETTINGS)
    take.feed(estimator)
    estimator.estimate(0, {})
    gram = estimator._problem.blocks.gram
    before, kept = estimator.linear, gram.copy()
    gram[:] = -1e12 * np.eye(7)
    more = record(0.1)
    estimator.update(more.stamp_ns + 4 * SECOND_NS, more.force, np.ones(100, dtype=bool))
    failed = estimator.estimate(0, {})
    np.testing.assert_array_equal(estimator.linear, before)
    assert failed.faults['factorisation_failed'] > 0
    gram[: len(kept)] = kept


def test_stamps_are_kept_to_the_nanosecond(record):
    """In 2026 a float counts steps of 256 ns."""
    take = record(1.0)
    late = 1_790_000_000_000_000_001
    estimator = BatchEstimator(SETTINGS)
    estimator.add_pulses(take.onset_ns + late, take.intensity)
    estimator.update(take.stamp_ns + late, take.force, np.ones(1000, dtype=bool))
    assert estimator._intake.previous_ns[0] == take.stamp_ns[-1] + late
