# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Model of a stimulated muscle: twitch, recruitment, contraction, disturbances of the sensor."""

from rpms_ros.muscle.contraction import Contraction as Contraction
from rpms_ros.muscle.recruitment import (
    IntensityRecruitment as IntensityRecruitment,
    RateRecruitment as RateRecruitment,
    RecruitmentField as RecruitmentField,
    RecruitmentParameters as RecruitmentParameters,
    identified_recruitment as identified_recruitment,
)
from rpms_ros.muscle.sensor import Disturbances as Disturbances, Sensor as Sensor
from rpms_ros.muscle.subject import (
    SUBJECTS as SUBJECTS,
    Modality as Modality,
    Subject as Subject,
    average_subject as average_subject,
    random_subject as random_subject,
    simulation_subject as simulation_subject,
    subject_by_name as subject_by_name,
)
from rpms_ros.muscle.twitch import (
    steady_mean as steady_mean,
    summed_twitches as summed_twitches,
    twitch as twitch,
    twitch_area as twitch_area,
)
