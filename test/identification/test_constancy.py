# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A fit of everything says whether one muscle explains everything."""

import numpy as np
import pytest

from rpms_ros.identification import estimator_by_name
from rpms_ros.identification.estimation.batch import is_constant, unexplained
from rpms_ros.identification.quality.doubts import NO_CONSTANT_MUSCLE, REASON

pytestmark = pytest.mark.long


def fitted(what):
    """Return a batch fit of a session, and its estimate."""
    estimator = estimator_by_name('batch')
    estimator.add_pulses(what.onset_ns, what.intensity)
    estimator.update(what.stamp_ns, what.force, np.ones(len(what.stamp_ns), dtype=np.bool_))
    return estimator, estimator.estimate(int(what.stamp_ns[-1]), {})


@pytest.mark.parametrize('excitation', ['random', 'sinusoid'])
def test_a_steady_muscle_is_constant_under_a_sensor_that_drifts(
    living_sessions, excitation: str
) -> None:
    what = living_sessions.session('steady', excitation, 0, 30.0)
    drift = 0.3 * np.sin(1e-9 * what.stamp_ns * 2.0 * np.pi / 60.0)
    estimator, estimate = fitted(what._replace(force=what.force + drift))
    assert estimate.doubts == ()
    # bench/constant_muscle.py: 0.5 % at the most, limit 1 %.
    assert unexplained(estimator._problem, estimator._window.point)[:, 0].max() < 0.01


@pytest.mark.parametrize(
    ('kind', 'seconds'), [('fatigue', 30.0), ('bursts', 30.0), ('coil moved', 50.0)]
)
@pytest.mark.parametrize('excitation', ['random', 'sinusoid'])
def test_a_muscle_that_changed_is_said_not_to_be_constant(
    living_sessions, kind: str, seconds: float, excitation: str
) -> None:
    estimator, estimate = fitted(living_sessions.session(kind, excitation, 0, seconds))
    assert NO_CONSTANT_MUSCLE in estimate.doubts
    assert REASON[NO_CONSTANT_MUSCLE] in estimate.reasons
    assert not is_constant(estimator._problem, estimator._window.point)


def test_a_clock_that_jumps_back_is_no_change_of_the_muscle(living_sessions) -> None:
    what = living_sessions.session('steady', 'random', 0, 30.0)
    estimator = estimator_by_name('batch')
    half = len(what.stamp_ns) // 2
    pulses = what.onset_ns < what.stamp_ns[half]
    for _ in range(2):
        estimator.add_pulses(what.onset_ns[pulses], what.intensity[pulses])
        estimator.update(what.stamp_ns[:half], what.force[:half], np.ones(half, dtype=np.bool_))
        estimator.forget_pulses()
    assert estimator.estimate(0, {}).doubts == ()
    assert len(unexplained(estimator._problem, estimator._window.point)) > 3


def test_nothing_recorded_is_constant() -> None:
    estimator = estimator_by_name('batch')
    assert is_constant(estimator._problem, estimator._window.point)
