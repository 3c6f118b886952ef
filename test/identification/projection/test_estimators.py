# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Batch, and tracking in a rest: right curve, bad input, outages, gaps and jumps."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.identification import FixedSizeRecursion
from rpms_ros.identification.estimation.batch import BatchEstimator
from rpms_ros.identification.estimation.settings import ProjectionSettings
from rpms_ros.identification.estimation.tracking import TrackingEstimator, TrackingSettings
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.estimate import CONVERGED, NOT_INFORMED
from rpms_ros.identification.offline import identify
from rpms_ros.muscle import Contraction, RecruitmentParameters, average_subject
from rpms_ros.pulses import ForceTrace, PulseTrain

SETTINGS = ProjectionSettings(basis=LaguerreBasis(7, 38e-3, 0.0))
TRACKING = TrackingSettings(basis=SETTINGS.basis, choose_basis=False)


def test_noise_free_is_exact(recorded):
    take = recorded(12.0)
    estimator = BatchEstimator(SETTINGS)
    prediction = take.feed(estimator)
    estimate = estimator.estimate(int(take.stamp_ns[-1]), {})
    # Seven functions hold a twitch of T_a 38.44 ms to 1e-5; the rest is the weak prior.
    assert take.curve_error(estimate) < 1e-3
    late = slice(10_000, None)
    error = np.linalg.norm((take.force - prediction)[late]) / np.linalg.norm(take.force[late])
    assert error < 1e-3
    assert (estimate.nonlinear_identifiability == CONVERGED).all()
    np.testing.assert_allclose(estimate.nonlinear, [0.48, 0.98, 4.0, 6.0], rtol=1e-2)


def test_five_seconds_suffice_in_noise(recorded):
    take = recorded(5.0, noise=0.01, seed=1)
    # One per cent of the maximum: the figure for the median of seeds
    assert take.curve_error(take.fit(BatchEstimator(SETTINGS))) < 0.01


@pytest.mark.parametrize('start', [(0.2, 0.3, 1.0), (0.7, 1.2, 20.0), (0.68, 0.79, 2.0)])
def test_wide_starts_end_at_the_right_minimum(start, recorded):
    take = recorded(8.0, noise=0.01)
    settings = ProjectionSettings(basis=SETTINGS.basis, start=RecruitmentParameters(*start))
    assert take.curve_error(take.fit(BatchEstimator(settings))) < 0.01


def test_changing_rate_is_one_model(recorded):
    """The weight of a pulse follows its rate: 15, 20 and 30 Hz in one recording."""
    generator = np.random.default_rng(0)
    rate = np.repeat([15.0, 30.0, 20.0], 60)
    onset = np.cumsum(1e9 / rate).astype(np.int64)
    intensity = generator.uniform(0, 1, len(onset))
    contraction = Contraction(average_subject())
    contraction.add_pulses(onset, intensity)
    take = recorded(9.0, subject=average_subject())
    force = contraction.force(take.stamp_ns)
    take = take._replace(onset_ns=onset, intensity=intensity, force=force)
    basis = LaguerreBasis(7, 38e-3, 9e-3)
    with_rate, without = (
        take.curve_error(
            take.fit(BatchEstimator(ProjectionSettings(basis=basis, by_rate=by_rate)))
        )
        for by_rate in (ProjectionSettings().by_rate, None)
    )
    assert with_rate < 2e-3
    assert without > 10 * with_rate


LONG_RESTS = [pytest.param(silence, marks=pytest.mark.long) for silence in (50.0, 150.0)]


@pytest.mark.parametrize('silence', [70.0, *LONG_RESTS])
def test_a_rest_erases_nothing(recorded, silence):
    take = recorded(6.0, noise=0.005, silence=silence)
    estimate = take.fit(TrackingEstimator(TRACKING))
    assert take.curve_error(estimate) < 0.01
    width = (estimate.curve_upper - estimate.curve_force).max() / take.curve.max()
    assert width < 0.05


def outcome(take):
    """Return the estimate after a recording, every number of it finite."""
    estimator = BatchEstimator(SETTINGS)
    prediction = take.feed(estimator, cuts=range(500, len(take.force), 500))
    assert np.isfinite(prediction).all()
    estimate = estimator.estimate(int(take.stamp_ns[-1]), {})
    for field in dataclasses.fields(estimate):
        value = getattr(estimate, field.name)
        if isinstance(value, np.ndarray | float):
            assert np.isfinite(value).all(), field.name
    return estimate


NOISE_ALONE = 0.01 * np.random.default_rng(0).standard_normal(6000)


@pytest.mark.parametrize(
    ('made', 'force', 'curve'),
    [
        ((6.0, np.full(120, 0.8), 0.01), None, False),
        ((1.0, [1.0], 0.01, 0, None, 1.0), None, False),
        ((6.0, np.random.default_rng(0).uniform(0, 0.1, 120)), NOISE_ALONE, True),
        ((5.0,), np.zeros(5000), True),
    ],
    ids=['one intensity', 'one pulse', 'below the threshold', 'no force'],
)
def test_what_tells_nothing_informs_of_nothing(recorded, made, force, curve):
    take = recorded(*made)
    estimate = outcome(take if force is None else take._replace(force=force))
    assert (estimate.nonlinear_identifiability == NOT_INFORMED).all()
    assert curve or not estimate.curve_known
    if take.intensity[-1] == 0.8:
        # Noise of 1 % of the maximum, and the batch predicts by a fit of 3 s before.
        assert estimate.output_error < 0.1
    if force is not None and not force.any():
        np.testing.assert_allclose(estimate.curve_force, 0.0, atol=1e-6)
        assert not len(estimate.physiology)


def test_saturated_force_has_wide_intervals(recorded):
    take = recorded(8.0, noise=0.002)
    free = outcome(take)
    np.clip(take.force, None, 0.4 * take.force.max(), out=take.force)
    estimate = outcome(take)
    # The sensor's limit looks like an early saturation; correlated residuals widen the intervals.
    half = np.max(estimate.curve_upper - estimate.curve_force) / estimate.curve_force.max()
    assert half > 3 * np.max(free.curve_upper - free.curve_force) / free.curve_force.max()


def test_noise_as_large_as_the_force(recorded):
    take = recorded(8.0, noise=1.0, seed=2)
    estimate = outcome(take)
    assert not (estimate.nonlinear_identifiability == CONVERGED).any()
    held = (estimate.curve_lower <= take.curve) & (take.curve <= estimate.curve_upper)
    assert held.mean() > 0.9


def test_step_of_the_baseline_is_left_out(recorded):
    take = recorded(10.0, noise=0.005)
    take.force[5_000:] += 0.2 * take.force.max()
    estimate = outcome(take)
    # 0.07 % without the step
    assert np.abs(estimate.curve_force - take.curve).max() < 2e-3 * take.curve.max()
    held = (estimate.curve_lower <= take.curve) & (take.curve <= estimate.curve_upper)
    assert held.mean() > 0.9


def test_large_step_of_the_baseline(recorded):
    take = recorded(10.0, noise=0.005)
    take.force[5_000:] += take.force.max()
    estimate = outcome(take)
    # The few samples in which the disturbance passes do not tell it from the muscle.
    assert not (estimate.nonlinear_identifiability == CONVERGED).any()
    assert (estimate.curve_upper - estimate.curve_force).max() > 0.05 * take.curve.max()


@pytest.mark.parametrize('build', [BatchEstimator, TrackingEstimator, FixedSizeRecursion])
def test_nothing_at_all(build):
    estimate = build().estimate(0, {})
    assert estimate.samples == 0
    assert estimate.confidence == 0.0
    assert not estimate.curve_known


def test_unusable_samples_are_predicted_only(recorded):
    take = recorded(3.0)
    estimator = BatchEstimator(SETTINGS)
    estimator.add_pulses(take.onset_ns, take.intensity)
    usable = np.zeros(len(take.stamp_ns), dtype=bool)
    estimator.update(take.stamp_ns, np.full(len(take.stamp_ns), 1e9), usable)
    found = estimator.estimate(0, {})
    assert found.samples == 0
    assert RecruitmentParameters(*found.nonlinear.tolist()) == SETTINGS.start


SECOND_NS = 1_000_000_000


def session_of(estimator, take, kept):
    """Return the session of an estimator over the samples that are kept."""
    pulses = PulseTrain.numbered(take.onset_ns, take.intensity)
    return identify(estimator, pulses, ForceTrace(take.stamp_ns[kept], take.force[kept]))


def test_pulses_through_an_outage_of_the_force_destroy_nothing(recorded):
    """150 s at 20 Hz without force are more pulses than the window has room for."""
    take = recorded(12.0 + 150.0 + 1.5, noise=0.005)
    kept = (take.stamp_ns < 12 * SECOND_NS) | (take.stamp_ns >= 162 * SECOND_NS)
    estimate = session_of(TrackingEstimator(TRACKING), take, kept).last
    assert estimate.confidence == 0.95
    assert take.curve_error(estimate) < 0.01
    half = (estimate.curve_upper - estimate.curve_force).max() / take.curve.max()
    # Twelve seconds at 0.5 % noise tell the curve to 0.2 %; it is neither lost nor more certain.
    assert 1e-4 < half < 0.02


def test_more_pulses_than_there_is_room_for_are_a_fault(recorded):
    take = recorded(8.0, noise=0.005)
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


@pytest.mark.parametrize('rest_s', [1.5, 4.6, 6.0, 30.0])
def test_a_muscle_is_predicted_soon_after_a_rest_at_the_beginning(recorded, rest_s):
    """A fit made at rest told nothing of the pulses, and the next came after 15 s or a minute."""
    take, rest = recorded(12.0, noise=0.005), int(1000 * rest_s)
    noise = np.random.default_rng(2).normal(0.0, 0.05, rest)
    late = take._replace(
        onset_ns=take.onset_ns + 1_000_000 * rest,
        stamp_ns=np.arange(rest + len(take.force), dtype=np.int64) * 1_000_000,
        force=np.concatenate((noise, take.force)),
    )
    prediction = late.feed(BatchEstimator(SETTINGS))
    settled = (late.force - prediction)[rest + 6000 :]
    assert np.sqrt(np.mean(settled**2)) < 0.02 * np.ptp(late.force)
    cuts = (rest // 2, rest + 100, rest + 900, rest + 1100)
    assert np.array_equal(late.feed(BatchEstimator(SETTINGS), cuts=cuts), prediction)


@pytest.mark.parametrize('gap', [5, 60])
def test_the_prediction_after_a_gap_stays_near_the_force(gap, recorded):
    take = recorded(10.0 + gap + 3.0, noise=0.005)
    # A drift that the baseline follows with a slope: 0.2 N a second of forces that peak at 7 N
    take.force[:10_000] += 0.2 * 1e-9 * take.stamp_ns[:10_000]
    take.force[10_000:] += 2.0
    kept = (take.stamp_ns < 10 * SECOND_NS) | (take.stamp_ns >= (10 + gap) * SECOND_NS)
    session = session_of(BatchEstimator(SETTINGS), take, kept)
    later = session.stamp_ns >= (10 + gap) * SECOND_NS + 700_000_000
    # Noise of 0.5 % and the drift that the batch did not see since its last fit
    assert np.abs(session.prediction - session.force)[later].max() < 2.0


def test_the_prediction_after_a_jump_stays_near_the_force(recorded):
    take = recorded(10.0, noise=0.005)
    take.force[:] += 0.2 * 1e-9 * take.stamp_ns
    estimator = BatchEstimator(SETTINGS)
    take.feed(estimator)
    estimator.estimate(0, {})
    estimator.forget_pulses()
    again = recorded(2.0, noise=0.005, seed=8)
    again.force[:] += 2.0
    hour_ns = 3600 * SECOND_NS
    again = again._replace(onset_ns=again.onset_ns - hour_ns, stamp_ns=again.stamp_ns - hour_ns)
    prediction = again.feed(estimator)
    assert np.abs(prediction - again.force)[700:].max() < 2.0


def test_a_failed_factorisation_is_counted_and_moves_nothing(recorded):
    take = recorded(4.0, noise=0.01)
    estimator = BatchEstimator(SETTINGS)
    take.feed(estimator)
    estimator.estimate(0, {})
    gram = estimator._problem.blocks.gram
    before, kept = estimator._predictor.linear.copy(), gram.copy()
    gram[:] = -1e12 * np.eye(7)
    more = recorded(0.1)
    estimator.update(more.stamp_ns + 4 * SECOND_NS, more.force, np.ones(100, dtype=bool))
    failed = estimator.estimate(0, {})
    np.testing.assert_array_equal(estimator._predictor.linear, before)
    assert failed.faults['factorisation_failed'] > 0
    gram[: len(kept)] = kept
