# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Intervals of batch and recursion are as wide as a muscle that their functions do not fit."""

from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.identification import estimator_by_name
from rpms_ros.identification.estimation.uncertainty import ResidualSums
from rpms_ros.muscle import Contraction, simulation_subject

NOISE = 0.05
# Cells of 0.1 s with one pulse each, sampled at 1 kHz.
CELLS, SAMPLES = 4000, 100
NAMES = ['batch', 'recursive']


def fixed_basis(name):
    """Return an estimator whose functions do not follow the muscle."""
    return estimator_by_name(name, 'paper_table_5' if name == 'batch' else 'people')


def sums_of(residuals, recruitment):
    """Return `ResidualSums` of the sums of the residuals in each cell (cells,)."""
    spread = np.array([np.mean(residuals**2 / SAMPLES)])
    total = float(CELLS * SAMPLES)
    return ResidualSums(spread, float(CELLS), total, 1e-3 * total, float(np.sum(recruitment**2)))


def test_white_residuals_show_nothing_missing():
    generator = np.random.default_rng(1)
    white = NOISE * np.sqrt(SAMPLES) * generator.standard_normal(CELLS)
    sums = sums_of(white, generator.uniform(size=CELLS))
    # The mean square of sums of white residuals varies by 2.2 %: three of these beyond what counts
    # as chance are 0.6 mN s, beside a response of half a N s.
    assert sums.missing_area(NOISE**2) < 6e-4
    assert replace(sums, cells=0.0).missing_area(NOISE**2) == 0.0
    assert replace(sums, recruited=0.0).missing_area(NOISE**2) == 0.0


def test_what_is_missing_is_found_in_newton_seconds():
    generator = np.random.default_rng(2)
    recruitment = generator.choice((-1.0, 1.0), CELLS)
    areas = np.array([0.03, -0.02, 0.01])
    missing = np.convolve(recruitment, areas)[:CELLS] / 1e-3
    white = NOISE * np.sqrt(SAMPLES) * generator.standard_normal(CELLS)
    found = sums_of(missing + white, recruitment).missing_area(NOISE**2)
    # 2.5 times what the residuals show; 4000 cells tell it to a few per cent.
    assert found == pytest.approx(2.5 * np.linalg.norm(areas), rel=0.1)


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize(
    ('latency', 'time_constant'), [(24e-3, 38e-3), (9e-3, 10e-3), (9e-3, 70e-3)]
)
def test_intervals_hold_the_curve_of_a_muscle_that_the_functions_do_not_fit(
    living_sessions, name, latency, time_constant
):
    muscle = replace(simulation_subject(), latency=latency, time_constant=time_constant)
    what = living_sessions.session('steady', 'random', 1, 24.0, muscle)
    estimator = fixed_basis(name)
    estimator.add_pulses(what.onset_ns, what.intensity)
    estimator.update(what.stamp_ns, what.force, np.ones(len(what.force), dtype=bool))
    estimate = estimator.estimate(0, {})
    truth = what.curve[-1]
    error = np.abs(estimate.curve_force - truth).max()
    half = 0.5 * (estimate.curve_upper - estimate.curve_lower).max()
    # Without what is missing half of the interval is a quarter to a half of the error.
    assert error < half < 8.0 * error
    held = (estimate.curve_lower <= truth) & (truth <= estimate.curve_upper)
    # The mean of 20 seeds is in bench/misfit.py.
    assert held[5:].mean() > 0.8


@pytest.mark.parametrize('name', NAMES)
def test_intervals_of_a_muscle_that_fits_stay_narrow(living_sessions, name):
    what = living_sessions.session('steady', 'random', 2, 24.0)
    estimator = fixed_basis(name)
    estimator.add_pulses(what.onset_ns, what.intensity)
    estimator.update(what.stamp_ns, what.force, np.ones(len(what.force), dtype=bool))
    estimate = estimator.estimate(0, {})
    # Noise of 0.5 % over 20 s leaves 0.05 % of the curve, one standard deviation.
    half = 0.5 * (estimate.curve_upper - estimate.curve_lower).max()
    assert half < 0.003 * what.curve[-1].max()


@pytest.mark.parametrize('name', NAMES)
def test_a_pause_without_samples_does_not_widen_the_intervals(name):
    """The sensor is off for most of a pause of the stimulation."""
    intensity = np.random.default_rng(1).uniform(size=200)
    onset_ns = 50_000_000 * np.arange(200) + np.where(np.arange(200) < 160, 0, 40_000_000_000)
    muscle = Contraction(replace(simulation_subject(), latency=24e-3))
    muscle.add_pulses(onset_ns, intensity)
    stamp_ns = 1_000_000 * np.arange(50_000)
    force = muscle.force(stamp_ns) + 0.05 * np.random.default_rng(2).standard_normal(50_000)
    half = []
    for off_ns in (0, 38_000_000_000):
        on = np.abs(stamp_ns - 29_000_000_000) >= off_ns / 2
        estimator = fixed_basis(name)
        estimator.add_pulses(onset_ns, intensity)
        estimator.update(stamp_ns[on], force[on], np.ones(np.count_nonzero(on), dtype=bool))
        estimate = estimator.estimate(0, {})
        half.append((estimate.curve_upper - estimate.curve_lower).max())
    # What is rest differs, and with it how much of the noise is known; the area is the same.
    assert half[1] < 1.5 * half[0]
