# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Identification of a muscle from its force: bases, estimators, alignment of pulses and force."""

from rpms_ros.identification.basis import DistortedSineBasis
from rpms_ros.identification.batch import BatchEstimator
from rpms_ros.identification.catalogue import ESTIMATORS
from rpms_ros.identification.catalogue import EstimatorOptions
from rpms_ros.identification.catalogue import estimator_by_name
from rpms_ros.identification.catalogue import estimator_names
from rpms_ros.identification.estimate import CONVERGED
from rpms_ros.identification.estimate import CURVE_INTENSITY
from rpms_ros.identification.estimate import DEFAULT_RATE
from rpms_ros.identification.estimate import INFORMED
from rpms_ros.identification.estimate import NOT_INFORMED
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.estimate import Estimator
from rpms_ros.identification.horizon import HorizonEstimator
from rpms_ros.identification.laguerre import LaguerreBasis
from rpms_ros.identification.projection.settings import ProjectionSettings
from rpms_ros.identification.recursion.estimator import ExactRecursion
from rpms_ros.identification.recursion.settings import PEOPLE
from rpms_ros.identification.recursion.settings import ExactRecursionSettings
from rpms_ros.identification.recursive import RecursiveEstimator
from rpms_ros.identification.session import IdentifiedSession
from rpms_ros.identification.session import identify
from rpms_ros.identification.settings import PAPER_PRESETS
from rpms_ros.identification.settings import PRESET_NAMES
from rpms_ros.identification.settings import TABLE_4
from rpms_ros.identification.settings import TABLE_5
from rpms_ros.identification.settings import RecruitmentBounds
from rpms_ros.identification.settings import RecursiveSettings
from rpms_ros.identification.settings import settings_by_name
from rpms_ros.identification.stream import IdentificationStream
from rpms_ros.identification.stream_settings import StreamSettings

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
    'ExactRecursion',
    'ExactRecursionSettings',
    'HorizonEstimator',
    'IdentificationStream',
    'IdentifiedSession',
    'LaguerreBasis',
    'ProjectionSettings',
    'RecruitmentBounds',
    'RecursiveEstimator',
    'RecursiveSettings',
    'StreamSettings',
    'estimator_by_name',
    'estimator_names',
    'identify',
    'settings_by_name',
]
