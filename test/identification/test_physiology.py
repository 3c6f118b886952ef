# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from rpms_ros.identification.model.basis import LaguerreBasis
from rpms_ros.identification.model.physiology import PHYSIOLOGY_NAMES, TwitchReader
from rpms_ros.muscle import twitch

BASIS = LaguerreBasis(7, 38e-3, 8e-3)
READER = TwitchReader(BASIS)


def coefficients(constant, latency, order, peak):
    time = np.arange(2e-3, BASIS.duration, 4e-3)
    return np.linalg.pinv(BASIS.evaluate(time)) @ (peak * twitch(time - latency, constant, order))


@pytest.mark.parametrize('order', [2, 3, 4])
@pytest.mark.parametrize('constant', [0.022, 0.038, 0.058])
@pytest.mark.parametrize('latency', [6e-3, 0.015])
def test_a_response_that_is_known_well_is_read_exactly(constant, latency, order):
    truth = np.array([constant, latency, order, 5.0])
    response = coefficients(*truth)
    found = READER.read(response, 1e-10 * np.eye(len(response)))
    assert len(found.values) == len(PHYSIOLOGY_NAMES)
    # the reader takes the basis to miss 0.1 % of the response: its deviations say what that means
    assert (np.abs(found.values - truth) < found.deviations).all()
    np.testing.assert_allclose(found.values[0], constant, rtol=0.02)
