# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Model of a stimulated muscle: twitch, recruitment, contraction, disturbances of the sensor."""

from rpms_ros.muscle.contraction import Contraction
from rpms_ros.muscle.recruitment import (
    IntensityRecruitment,
    RateRecruitment,
    RecruitmentField,
    RecruitmentParameters,
    identified_recruitment,
)
from rpms_ros.muscle.sensor import Disturbances, Sensor
from rpms_ros.muscle.subject import (
    SUBJECTS,
    Modality,
    Subject,
    average_subject,
    random_subject,
    simulation_subject,
    subject_by_name,
)
from rpms_ros.muscle.twitch import steady_mean, summed_twitches, twitch, twitch_area

__all__ = [
    'SUBJECTS',
    'Contraction',
    'Disturbances',
    'IntensityRecruitment',
    'Modality',
    'RateRecruitment',
    'RecruitmentField',
    'RecruitmentParameters',
    'Sensor',
    'Subject',
    'average_subject',
    'identified_recruitment',
    'random_subject',
    'simulation_subject',
    'steady_mean',
    'subject_by_name',
    'summed_twitches',
    'twitch',
    'twitch_area',
]
