# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from rpms_ros.identification.analysis.responses import (
    clean,
    find_artifacts,
    near_pulses,
    without_artifacts,
)
from rpms_ros.identification.analysis.simulated import SensorShares, simulated_force
from rpms_ros.muscle import average_subject
from rpms_ros.pulses import PulseTrain

COUNT = 20
SEARCH = 20e-3


def session(artifact=1.0, offset=0.0, seed=0):
    """Return the trace of pulses off the grid, and stamps that lag by `offset` [s]."""
    random = np.random.default_rng(seed)
    onset = (np.arange(COUNT) + 1) * 1_000_000_000 + random.integers(0, 1_000_000, COUNT)
    pulses = PulseTrain(onset, np.full(COUNT, 1.0), np.arange(COUNT), np.full(COUNT, 1e-4))
    shares = SensorShares(noise=0.01, artifact=artifact)
    trace = clean(simulated_force(average_subject(), pulses, COUNT + 2.0, shares, seed=seed))
    return trace, onset - round(offset * 1e9)


def test_artifacts_lie_at_the_first_sample_after_the_pulse():
    trace, onset = session()
    found = find_artifacts(trace, onset, SEARCH)
    assert found.found
    assert found.count == COUNT
    assert (found.offset >= 0).all()
    assert (found.offset <= 1e-3).all()
    assert found.clock_offset == 0.0


@pytest.mark.parametrize('offset', [-8e-3, -3e-3, 3e-3, 12e-3])
def test_clocks_that_differ_are_found_out(offset):
    trace, onset = session(offset=offset)
    # the first sample after a pulse is known to a period of 1 ms, its mean over 20 to less
    assert find_artifacts(trace, onset, SEARCH).clock_offset == pytest.approx(offset, abs=4e-4)


def test_no_artifact_is_not_invented():
    trace, onset = session(artifact=0.0)
    found = find_artifacts(trace, onset, SEARCH)
    assert not found.found
    assert found.clock_offset == 0.0


def test_an_artifact_of_one_pulse_proves_nothing():
    trace, onset = session()
    assert not find_artifacts(trace, onset[:1], SEARCH).found


def test_samples_near_a_pulse_are_those_from_just_before_to_the_span():
    stamps = np.arange(20, dtype=np.int64) * 1_000_000
    touched = near_pulses(stamps, np.array([10_000_000]), 1e-3, 4e-3)
    assert np.flatnonzero(touched).tolist() == [9, 10, 11, 12, 13]


def test_straight_lines_take_the_place_of_artifacts():
    trace, onset = session()
    bare, _ = session(artifact=0.0)
    cleaned = without_artifacts(trace, onset, 4e-3)
    # what is left: noise, and 0.03 % of the artifact after 4 ms
    assert np.abs(cleaned.force - bare.force).max() < 8 * bare.noise
    assert np.abs(trace.force - bare.force).max() > 20 * bare.noise
