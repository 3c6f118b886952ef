# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Identification of a muscle from its force: bases, estimators, alignment of pulses and force."""

from rpms_ros.identification.catalogue import (
    ESTIMATORS as ESTIMATORS,
    EstimatorOptions as EstimatorOptions,
    estimator_by_name as estimator_by_name,
    estimator_names as estimator_names,
)
from rpms_ros.identification.estimation.batch import BatchEstimator as BatchEstimator
from rpms_ros.identification.estimation.settings import ProjectionSettings as ProjectionSettings
from rpms_ros.identification.model.basis import (
    DistortedSineBasis as DistortedSineBasis,
    LaguerreBasis as LaguerreBasis,
)
from rpms_ros.identification.model.estimate import (
    CONVERGED as CONVERGED,
    CURVE_INTENSITY as CURVE_INTENSITY,
    DEFAULT_RATE as DEFAULT_RATE,
    INFORMED as INFORMED,
    NOT_INFORMED as NOT_INFORMED,
    Estimate as Estimate,
    Estimator as Estimator,
)
from rpms_ros.identification.model.settings import (
    PAPER_PRESETS as PAPER_PRESETS,
    PRESET_NAMES as PRESET_NAMES,
    TABLE_4 as TABLE_4,
    TABLE_5 as TABLE_5,
    PaperSettings as PaperSettings,
)
from rpms_ros.identification.offline import (
    IdentifiedSession as IdentifiedSession,
    identify as identify,
)
from rpms_ros.identification.recursion.paper import ModifiedRecursiveLM as ModifiedRecursiveLM
from rpms_ros.identification.recursion.recursive import (
    PEOPLE as PEOPLE,
    FixedSizeRecursion as FixedSizeRecursion,
)
from rpms_ros.identification.stream.stream import (
    IdentificationStream as IdentificationStream,
    StreamSettings as StreamSettings,
)
