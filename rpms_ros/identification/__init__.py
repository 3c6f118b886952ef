# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Identification of a muscle from its force: bases, estimators, alignment of pulses and force."""

from rpms_ros.identification.catalogue import (
    ESTIMATORS,
    EstimatorOptions,
    estimator_by_name,
    estimator_names,
)
from rpms_ros.identification.estimation.batch import BatchEstimator
from rpms_ros.identification.estimation.settings import ProjectionSettings
from rpms_ros.identification.model.basis import DistortedSineBasis, LaguerreBasis
from rpms_ros.identification.model.estimate import (
    CONVERGED,
    CURVE_INTENSITY,
    DEFAULT_RATE,
    INFORMED,
    NOT_INFORMED,
    Estimate,
    Estimator,
)
from rpms_ros.identification.model.settings import (
    PAPER_PRESETS,
    PRESET_NAMES,
    TABLE_4,
    TABLE_5,
    RecursiveSettings,
    settings_by_name,
)
from rpms_ros.identification.recursion.paper import ModifiedRecursiveLM
from rpms_ros.identification.recursion.people import PEOPLE, FixedSizeRecursion
from rpms_ros.identification.session import IdentifiedSession, identify
from rpms_ros.identification.stream.stream import IdentificationStream, StreamSettings

__all__ = [
    'CONVERGED',
    'CURVE_INTENSITY',
    'DEFAULT_RATE',
    'ESTIMATORS',
    'INFORMED',
    'NOT_INFORMED',
    'PAPER_PRESETS',
    'PEOPLE',
    'PRESET_NAMES',
    'TABLE_4',
    'TABLE_5',
    'BatchEstimator',
    'DistortedSineBasis',
    'Estimate',
    'Estimator',
    'EstimatorOptions',
    'FixedSizeRecursion',
    'IdentificationStream',
    'IdentifiedSession',
    'LaguerreBasis',
    'ModifiedRecursiveLM',
    'ProjectionSettings',
    'RecursiveSettings',
    'StreamSettings',
    'estimator_by_name',
    'estimator_names',
    'identify',
    'settings_by_name',
]
