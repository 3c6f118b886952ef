# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Model of a stimulated muscle: twitch, recruitment, contraction, disturbances of the sensor."""

from rpms_ros.muscle.contraction import Contraction
from rpms_ros.muscle.disturbance import Disturbances
from rpms_ros.muscle.disturbance import Sensor
from rpms_ros.muscle.identified_form import PARAMETER_NAMES
from rpms_ros.muscle.identified_form import RecruitmentParameters
from rpms_ros.muscle.identified_form import identified_recruitment
from rpms_ros.muscle.identified_form import identified_recruitment_with_gradient
from rpms_ros.muscle.recruitment import IntensityRecruitment
from rpms_ros.muscle.recruitment import RateRecruitment
from rpms_ros.muscle.recruitment import RecruitmentField
from rpms_ros.muscle.subject import SUBJECTS
from rpms_ros.muscle.subject import Modality
from rpms_ros.muscle.subject import Subject
from rpms_ros.muscle.subject import average_subject
from rpms_ros.muscle.subject import random_subject
from rpms_ros.muscle.subject import simulation_subject
from rpms_ros.muscle.subject import subject_by_name
from rpms_ros.muscle.twitch import steady_mean
from rpms_ros.muscle.twitch import summed_twitches
from rpms_ros.muscle.twitch import twitch
from rpms_ros.muscle.twitch import twitch_area

__all__ = [
    'PARAMETER_NAMES',
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
    'identified_recruitment_with_gradient',
    'random_subject',
    'simulation_subject',
    'steady_mean',
    'subject_by_name',
    'summed_twitches',
    'twitch',
    'twitch_area',
]
