# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The one answer to the question whether a recording was that of one muscle."""

from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.identification import IdentifiedSession, estimator_by_name, identify
from rpms_ros.identification.estimation.tracking import TrackingEstimator
from rpms_ros.identification.quality.stationarity import FOLLOWER, change_over, is_mixture
from rpms_ros.pulses import ForceTrace, PulseTrain


@pytest.fixture(scope='module')
def tired(living_sessions) -> tuple[IdentifiedSession, PulseTrain]:
    """A muscle that tires, explained by one."""
    what = living_sessions.session('fatigue', 'random', 0, 30.0)
    pulses = PulseTrain.regular(what.intensity, 20.0, what.onset_ns[0])
    np.testing.assert_array_equal(pulses.onset_ns, what.onset_ns)
    forces = ForceTrace(what.stamp_ns, what.force)
    return identify(estimator_by_name('batch'), pulses, forces), pulses


def test_parts_and_force_agree_on_a_muscle_that_tires(tired) -> None:
    session, pulses = tired
    assert is_mixture(session.last)
    change = change_over(session, pulses)
    assert change is not None
    assert change.share < 0.0


def test_samples_out_of_order_or_unusable_are_left_out(tired) -> None:
    session, pulses = tired
    stamps = session.stamp_ns.copy()
    stamps[2000:2100] -= 1_000_000_000
    usable = session.usable.copy()
    usable[:10] = False
    spoilt = replace(session, stamp_ns=stamps, usable=usable)
    assert np.flatnonzero(~spoilt.in_order).tolist() == [*range(10), *range(2000, 2100)]
    assert change_over(spoilt, pulses) is not None


def test_estimates_that_follow_changes_are_not_asked(tired) -> None:
    session, pulses = tired
    several = replace(session, estimates=[session.last, session.last])
    assert change_over(several, pulses) is None
    rates = {name: np.zeros(1) for name in ('rate', 'rate_lower', 'rate_upper')}
    follower = replace(session.last, rate_names=('force_percent',), **rates)
    assert change_over(replace(session, estimates=[follower]), pulses) is None


def test_the_follower_is_an_estimator() -> None:
    assert isinstance(estimator_by_name(FOLLOWER), TrackingEstimator)
