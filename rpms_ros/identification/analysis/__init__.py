# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Muscle analysis: latency, twitch, order, summation and recruitment (Sec. 2 of the paper)."""

from rpms_ros.identification.analysis.analyze import MuscleAnalysis, analyze
from rpms_ros.identification.analysis.recruitment_field import (
    FieldAnalysis,
    SteadyPoint,
    fit_field,
)
from rpms_ros.identification.analysis.trains import SummationAnalysis, TrainLaw, analyze_trains
from rpms_ros.identification.analysis.twitches import TwitchAnalysis

__all__ = [
    'FieldAnalysis',
    'MuscleAnalysis',
    'SteadyPoint',
    'SummationAnalysis',
    'TrainLaw',
    'TwitchAnalysis',
    'analyze',
    'analyze_trains',
    'fit_field',
]
