# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Muscle analysis: latency, twitch, order, summation and recruitment (Sec. 2 of the paper)."""

from rpms_ros.identification.analysis.analyze import analyze
from rpms_ros.identification.analysis.field_fit import FieldAnalysis
from rpms_ros.identification.analysis.field_fit import fit_field
from rpms_ros.identification.analysis.history_law import TrainLaw
from rpms_ros.identification.analysis.muscle_analysis import MuscleAnalysis
from rpms_ros.identification.analysis.settings import AnalysisSettings
from rpms_ros.identification.analysis.steady import SteadyPoint
from rpms_ros.identification.analysis.summation import SummationAnalysis
from rpms_ros.identification.analysis.summation import analyze_trains
from rpms_ros.identification.analysis.twitches import TwitchAnalysis

__all__ = [
    'AnalysisSettings',
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
