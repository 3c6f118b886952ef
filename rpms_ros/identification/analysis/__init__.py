# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Muscle analysis: latency, twitch, order, summation and recruitment (Sec. 2 of the paper)."""

from rpms_ros.identification.analysis.analyze import (
    MuscleAnalysis as MuscleAnalysis,
    analyze as analyze,
)
from rpms_ros.identification.analysis.recruitment_field import (
    FieldAnalysis as FieldAnalysis,
    SteadyPoint as SteadyPoint,
    fit_field as fit_field,
)
from rpms_ros.identification.analysis.trains import (
    SummationAnalysis as SummationAnalysis,
    TrainLaw as TrainLaw,
    analyze_trains as analyze_trains,
)
from rpms_ros.identification.analysis.twitches import TwitchAnalysis as TwitchAnalysis
