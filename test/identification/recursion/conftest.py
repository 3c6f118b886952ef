# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated people for the recursion."""

import numpy as np
import pytest

from rpms_ros.muscle import average_subject


@pytest.fixture(scope='session')
def session(recorded):
    """Make a session: seed, period (None: random), seconds, noise, muscle, when pulses end."""

    def make(seed=1, period=None, seconds=20.0, noise=0.01, subject=None, rest_from=np.inf):
        time = np.arange(int(seconds * 20)) / 20.0
        intensity = np.random.default_rng(seed).uniform(0.0, 1.0, len(time))
        if period is not None:
            intensity = 0.5 - 0.5 * np.cos(2.0 * np.pi * time / period)
        intensity[time >= rest_from] = 0.0
        return recorded(seconds, intensity, noise, seed, subject or average_subject())

    return make
