# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A simulated session and what was found of it, made once."""

import pytest

import rpms_ros


@pytest.fixture(scope='package')
def simulated():
    """Fifteen seconds of the paper's simulated identification, with noise."""
    return rpms_ros.simulate(duration=15.0, noise=0.02)


@pytest.fixture(scope='package')
def found(simulated):
    """What the batch finds of it."""
    return simulated.identify()
