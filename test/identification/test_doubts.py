# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Doubts of an estimate, and which of its numbers come from the data."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from rpms_ros.identification import FixedSizeRecursion, StreamSettings, estimator_by_name, identify
from rpms_ros.identification.estimation.estimate_builder import (
    PHYSIOLOGY_NAMES,
    PRIOR,
    TwitchReader,
)
from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.quality.doubts import (
    FORCE_REPEATS,
    REASON,
    RESPONSE_MISFIT,
    SLOW_INTENSITIES,
    IntensitySteps,
    ResponseMisfit,
)
from rpms_ros.identification.quality.explained_force import (
    informed_parameters,
    informed_physiology,
)
from rpms_ros.muscle import Contraction, simulation_subject, twitch
from rpms_ros.pulses import ForceTrace, PulseTrain


def doubts(name, what) -> tuple[str, ...]:
    """Return the doubts of the last estimate of a session."""
    pulses = PulseTrain.regular(what.intensity, 20.0, 1_000)
    settings = StreamSettings(estimate_period=5.0)
    forces = ForceTrace(what.stamp_ns, what.force)
    return identify(estimator_by_name(name), pulses, forces, settings).last.doubts


@pytest.mark.parametrize('name', ['recursive', 'tracking'])
def test_a_response_of_the_model_is_not_doubted(living_sessions, name):
    assert doubts(name, living_sessions.session('steady', 'random', 3, 25.0)) == ()


@pytest.mark.long
@pytest.mark.parametrize('excitation', ['random', 'sinusoid'])
def test_a_twitch_too_fast_for_the_functions_is_said(living_sessions, excitation):
    fast = replace(living_sessions.SUBJECT, time_constant=8e-3)
    what = living_sessions.session('steady', excitation, 3, 25.0, fast)
    assert RESPONSE_MISFIT in doubts('recursive', what)
    # tracking finds functions for it
    assert RESPONSE_MISFIT not in doubts('tracking', what)


@pytest.mark.parametrize('name', [pytest.param('tracking', marks=pytest.mark.long), 'recursive'])
def test_functions_that_begin_a_little_late_are_not_doubted(living_sessions, name):
    soon = replace(living_sessions.SUBJECT, latency=0.0)
    assert doubts(name, living_sessions.session('steady', 'random', 3, 25.0, soon)) == ()


@pytest.mark.parametrize(('hertz', 'doubted'), [(60.0, (FORCE_REPEATS,)), (57.0, ())])
@pytest.mark.parametrize(
    'name',
    ['recursive', *(pytest.param(one, marks=pytest.mark.long) for one in ('batch', 'tracking'))],
)
def test_hum_in_step_with_the_pulses_is_doubted(living_sessions, name, hertz, doubted):
    """A harmonic of the repetition rate passes for a response: 0.8 %, good within 0.2 %."""
    what = living_sessions.session('steady', 'random', 1, 25.0)
    hum = 0.01 * what.curve.max() * np.sin(2e-9 * np.pi * hertz * what.stamp_ns)
    assert doubts(name, what._replace(force=what.force + hum)) == doubted


def test_a_sudden_change_that_was_found_is_no_misfit(living_sessions):
    what = living_sessions.session('gain step', 'random', 0, 50.0)
    assert RESPONSE_MISFIT not in doubts('recursive', what)


def filled(cuts, right=False, offset=0.0) -> ResponseMisfit:
    """Return the sums over made-up samples cut into blocks; the prediction may be right."""
    generator = np.random.default_rng(1)
    stamp = np.arange(25_000, dtype=np.int64) * 1_000_000
    onset = np.arange(500, dtype=np.int64) * 50_000_000
    force, prediction = generator.standard_normal((2, len(stamp)))
    intensity = generator.uniform(size=len(onset))
    if right:
        prediction *= 0.05
        force += prediction
    force += offset
    misfit = ResponseMisfit()
    for first, last in pairwise([0, *cuts, len(stamp)]):
        known = (onset >= first * 1_000_000) & (onset < last * 1_000_000)
        misfit.add_pulses(onset[known], intensity[known])
        part = slice(first, last)
        usable = np.ones(last - first, dtype=np.bool_)
        misfit.add(stamp[part], force[part], prediction[part], usable)
    return misfit


def test_blocks_change_no_bit():
    whole = filled(())
    # Errors as large as the force itself, but none that follow the pulses' intensities.
    assert whole.sizes[0] < 0.1
    assert filled((3, 9_000, 9_025, 17_333)).sizes == whole.sizes


def test_noise_of_a_force_that_hardly_varies_is_no_misfit():
    assert filled((), right=True).sizes == (0.0, 0.0, 0.0)
    assert filled(()).sizes[1] == pytest.approx(1.0, abs=0.05)
    # a baseline that is not known yet is no noise
    assert filled((), offset=100.0).sizes[1] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    ('seconds', 'change', 'doubted'),
    [(2.0, 25.0, True), (8.9, 25.0, True), (9.1, 25.0, False), (2.0, 5.0, False)],
)
def test_a_muscle_that_may_tire_fast_is_in_doubt_in_a_train_after_a_rest(
    beside, seconds, change, doubted
):
    steps, train_ns = IntensitySteps(), 50_000_000 * np.arange(8)
    for begin_ns in (0, 400_000_000, 10**10, 10**10 + 400_000_000):
        steps.add_pulses(begin_ns + train_ns, np.full(8, 0.5))
    ends = {'rate_lower': np.array([-change, 0.0]), 'rate_upper': np.array([2.0, 2.0])}
    one = beside('made_up_estimates').estimate(0, **ends)
    one = replace(one, stamp_ns=10**10 + int(seconds * 1e9))
    assert steps.tires_anew(one) is doubted
    # a clock that was set back
    for begin_ns in (2 * 10**9, 5 * 10**9):
        steps.add_pulses(begin_ns + train_ns, np.full(8, 0.5))
    assert steps.tires_anew(replace(one, stamp_ns=one.stamp_ns - 5 * 10**9)) is doubted


def slow_sinusoid(noise, seed, latency=0.0) -> tuple[PulseTrain, ForceTrace]:
    """A minute of the paper's sinusoid of 18 s."""
    intensity = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(1200) / 20.0 / 18.0)
    pulses = PulseTrain.regular(intensity, 20.0)
    muscle = Contraction(replace(simulation_subject(), latency=latency))
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = 1_000_000 * np.arange(60_000, dtype=np.int64)
    noises = noise * np.random.default_rng(seed).standard_normal(len(stamps))
    return pulses, ForceTrace(stamps, muscle.force(stamps) + noises)


def test_a_muscle_that_answers_before_the_functions_begin_is_doubtful():
    # Under a slow sinusoid at one rate the response is hardly seen: what the functions miss of
    # it turns it upside down, while the curve stays right.
    last = identify(FixedSizeRecursion(), *slow_sinusoid(0.02, 1)).last
    assert last.doubts == ('response_negative',)
    assert last.reasons == (REASON['response_negative'], SLOW_INTENSITIES)


SHARES = np.random.default_rng(4).uniform(size=400)
SINUSOID = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(400) / 180.0)
CAUGHT = np.where(np.arange(400) % 10 == 0, SHARES, SINUSOID)


@pytest.mark.parametrize(
    ('intensity', 'interval', 'slow'),
    [
        (SINUSOID, 0.05, True),
        (SHARES, 0.05, False),
        (CAUGHT, 0.05, False),
        (np.linspace(0.0, 1.0, 60), 1.0, False),
        # two of a kind, and then a rest
        (np.repeat(SHARES[:60], 2), [0.01, 0.99], False),
        # trains
        (np.repeat(SHARES[:20], 20), [0.05] * 19 + [1.0], False),
    ],
)
def test_intensities_that_change_slowly_are_said_with_the_estimates(intensity, interval, slow):
    period = np.resize(np.atleast_1d(interval), len(intensity))
    onset = 1_000_000 * np.rint(1e3 * np.cumsum(period)).astype(np.int64)
    pulses = replace(PulseTrain.regular(intensity, 20.0), onset_ns=onset)
    muscle = Contraction(simulation_subject())
    muscle.add_pulses(onset, intensity)
    stamps = 1_000_000 * np.arange(onset[-1] // 1_000_000 + 500, dtype=np.int64)
    noise = 0.02 * np.random.default_rng(1).standard_normal(len(stamps))
    forces = ForceTrace(stamps, muscle.force(stamps) + noise)
    estimates = identify(FixedSizeRecursion(), pulses, forces).estimates
    known = [one for one in estimates if one.curve_known]
    known = known[len(known) // 2 :]
    assert known
    assert {SLOW_INTENSITIES in one.reasons for one in known} == {slow}


def test_a_curve_that_is_hardly_known_says_so():
    pulses, forces = slow_sinusoid(0.02, 2)
    early = forces.stamp_ns < 3_000_000_000
    first = ForceTrace(forces.stamp_ns[early], forces.force[early])
    last = identify(FixedSizeRecursion(), pulses[pulses.onset_ns < 3_000_000_000], first).last
    assert 'band_wider_than_curve' in last.doubts


QUANTILE = 1.959964


@pytest.fixture(name='estimate', scope='module')
def estimate_fixture(beside):
    """Make an estimate with this physiology, and a response of this peak."""

    def make(values, deviations, peak, **fields):
        centre, half = np.array(values), QUANTILE * np.array(deviations)
        return beside('made_up_estimates').estimate(
            1,
            response_time=np.linspace(0.0, 0.3, 4),
            response_force=peak * np.array([0.0, 1.0, 0.5, 0.0]),
            physiology_names=PHYSIOLOGY_NAMES,
            physiology=centre,
            physiology_lower=centre - half,
            physiology_upper=centre + half,
            **fields,
        )

    return make


CENTRES = [PRIOR[name][0] for name in PHYSIOLOGY_NAMES[:3]]
SPREADS = [PRIOR[name][1] for name in PHYSIOLOGY_NAMES[:3]]


def narrowed(one) -> list[str]:
    return list(informed_physiology(one))


def test_what_the_data_determine_is_a_measurement_and_a_prior_is_none(estimate):
    assert narrowed(estimate([*CENTRES, 3.0], [*SPREADS, 0.1], 3.0)) == ['twitch_peak_n']
    half = [0.5 * spread for spread in SPREADS]
    assert narrowed(estimate([*CENTRES, 3.0], [*half, 0.1], 3.0)) == list(PHYSIOLOGY_NAMES)
    one = estimate([*CENTRES, 3.0], [half[0], SPREADS[1], half[2], 3.0], 3.0)
    assert narrowed(one) == ['twitch_time_constant_s', 'order']
    # a twitch of another height than the response, and no intervals
    assert narrowed(estimate([*CENTRES, 2e-4], [*half, 1e-5], 3.3)) == []
    assert narrowed(estimate([*CENTRES, 3.0], [*half, 0.1], 3.0, confidence=0.0)) == []


@pytest.mark.parametrize(
    ('flags', 'informed'),
    [([], [True] * 4), ([2, 0, 1, 0], [True, False, True, False]), ([1] * 4, [True] * 4)],
)
def test_flags_decide_over_parameters(estimate, flags, informed):
    flagged = np.array(flags, dtype=np.int64)
    one = estimate([*CENTRES, 3.0], [*SPREADS, 0.1], 3.0, nonlinear_identifiability=flagged)
    assert informed_parameters(one).tolist() == informed


@pytest.mark.parametrize('order', [2, 3, 4])
@pytest.mark.parametrize('constant', [0.022, 0.038, 0.058])
@pytest.mark.parametrize('latency', [6e-3, 0.015])
def test_a_response_that_is_known_well_is_read_exactly(constant, latency, order):
    basis, truth = LaguerreBasis(7, 38e-3, 8e-3), np.array([constant, latency, order, 5.0])
    time = np.arange(2e-3, basis.duration, 4e-3)
    response = np.linalg.pinv(basis.evaluate(time)) @ (
        5.0 * twitch(time - latency, constant, order)
    )
    values, deviations, _ = TwitchReader(basis).read(response, 1e-10 * np.eye(len(response)))
    assert len(values) == len(PHYSIOLOGY_NAMES)
    # the reader takes the basis to miss 0.1 % of the response: its deviations say what that means
    assert (np.abs(values - truth) < deviations).all()
    np.testing.assert_allclose(values[0], constant, rtol=0.02)
