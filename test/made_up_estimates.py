# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Made-up estimates of a session, for what is said and drawn of them over time."""

import numpy as np

from rpms_ros.identification import Estimate, IdentifiedSession
from rpms_ros.identification.model.estimate import CURVE_INTENSITY

PERIOD_NS = 500_000_000
NAMES = ('u_thr', 'u_sat', 'alpha_sat', 'alpha_thr')


def estimate(index, force=10.0, half=0.1, **fields):
    """Return the estimate at `index` periods; `force` with its half interval [N]."""
    shape = np.clip((CURVE_INTENSITY - 0.5) / 0.5, 0.0, 1.0)
    return Estimate(
        **{
            'stamp_ns': index * PERIOD_NS,
            'estimator': 'tracking',
            'nonlinear_names': NAMES,
            'nonlinear': np.array([0.48, 0.98, 4.0, 6.0]),
            'nonlinear_covariance': np.diag([1e-4, 1e-4, 0.01, 0.01]),
            'nonlinear_identifiability': np.array([2, 2, 2, 2]),
            'linear_names': ('basis_1',),
            'linear': np.ones(1),
            'repetition_rate': 20.0,
            'curve_intensity': CURVE_INTENSITY,
            'curve_force': force * shape,
            'curve_lower': (force - half) * shape,
            'curve_upper': (force + half) * shape,
            'response_time': np.linspace(0.0, 0.4, 41),
            'response_force': np.linspace(1.0, 0.0, 41),
            'confidence': 0.95,
            'output_error': 0.01,
            'samples': 1 + index,
            'pulses': index,
            'rate_names': ('force_percent',),
            'rate': np.zeros(1),
            'rate_lower': -np.ones(1),
            'rate_upper': np.ones(1),
            **fields,
        }
    )


def session_of(estimates):
    """Return a session with these estimates and a force between 0 and 10 N."""
    stamps = np.arange(0, estimates[-1].stamp_ns + 1, 10_000_000)
    force = 5.0 - 5.0 * np.cos(1e-8 * stamps)
    return IdentifiedSession(estimates, stamps, force, force, np.ones(len(stamps), dtype=np.bool_))
