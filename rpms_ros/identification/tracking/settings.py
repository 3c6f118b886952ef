# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the tracking estimator."""

from dataclasses import dataclass

from rpms_ros.identification.laguerre import LaguerreBasis
from rpms_ros.identification.projection.settings import ProjectionSettings

LONGEST_BASIS = LaguerreBasis(7, 90e-3, 30e-3)
"""Slowest twitch and longest latency of the bases that are tried."""


@dataclass(frozen=True)
class TrackingSettings(ProjectionSettings):
    """Model and numerics of the tracking estimator.

    `basis` and `start` are the first ones; `horizon` is the longest window.  `knot_spacing`,
    `steps` and `forgetting` are not used.

    Attributes
    ----------
    choose_basis : bool
        Choose latency and time constant of the basis by the samples.
    find_changes : bool
        Look for sudden changes of the muscle.
    """

    horizon: float = 60.0
    step_period: float = 0.25
    choose_basis: bool = True
    find_changes: bool = True
