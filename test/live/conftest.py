# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A session without ROS: topics, an estimate, a driver's status."""

from types import SimpleNamespace

import numpy as np
import pytest

from rpms_ros.identification import CURVE_INTENSITY
from rpms_ros.live.live_session import LiveSession
from rpms_ros.live.topic_health import Topic

START_NS = 1_700_000_000_000_000_000


@pytest.fixture
def start_ns():
    return START_NS


@pytest.fixture
def session():
    topics = {
        name: Topic(f'/{name}', kind, silence)
        for name, kind, silence in (
            ('force', 'geometry_msgs/msg/WrenchStamped', 0.5),
            ('pulses', 'rpms_msgs/msg/Pulse', float('inf')),
            ('estimate', 'rpms_msgs/msg/MuscleEstimate', 2.0),
            ('driver_status', 'rpms_msgs/msg/DriverStatus', 1.0),
        )
    }
    return LiveSession('/', topics)


@pytest.fixture
def make_estimate(beside):
    """Make an estimate of a second after the start, with a baseline of 0.5 N."""
    made_up, time = beside('made_up_estimates'), np.linspace(0.0, 0.4, 81)
    plain = {
        'stamp_ns': START_NS + 1_000_000_000,
        'nonlinear': np.array([0.3, 0.7, 6.0, 6.0]),
        'linear_names': ('basis_1', 'baseline_1', 'baseline_2'),
        'linear': np.array([1.0, 5.0, 0.5]),
        'curve_force': 10.0 * CURVE_INTENSITY,
        'response_time': time,
        'response_force': 100.0 * time * np.exp(-time / 0.04),
    }
    return lambda **fields: made_up.estimate(0, **{**plain, **fields})


@pytest.fixture
def make_status():
    def make(**fields):
        plain = {
            'state': 3, 'reason': 'running', 'schedule': 's', 'segment': 0, 'segments': 2,
            'time_left': 4.0, 'pulses_commanded': 3, 'pulses_delivered': 2, 'pulses_dropped': 1,
            'pulses_unverified': 0, 'coil_energy': 1.0, 'coil_temperature': 20.0,
            'lateness_max': 0.001, 'device': 'simulated', 'maximum_intensity': 1.0,
            'operator_id': 'ada', 'enabled': True, 'dose_pulses': 2, 'dose_energy': 3.0,
            'fault_names': ['late'], 'fault_counts': [1], 'button_names': ['/stop_button'],
            'button_states': [0],
        }  # fmt: skip
        return SimpleNamespace(**{**plain, **fields})

    return make
