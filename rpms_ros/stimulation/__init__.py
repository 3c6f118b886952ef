# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stimulation: pulses, schedules, limits, coil energy, devices and the stop."""

from rpms_ros.stimulation.schedule.description import (
    SEGMENT_KINDS as SEGMENT_KINDS,
    load_schedule as load_schedule,
    schedule_from_mapping as schedule_from_mapping,
    schedule_from_text as schedule_from_text,
    schedule_to_text as schedule_to_text,
)
from rpms_ros.stimulation.schedule.fields import DescriptionError as DescriptionError
from rpms_ros.stimulation.schedule.protocols import (
    constant as constant,
    paper_random as paper_random,
    paper_sinusoid as paper_sinusoid,
    staircase as staircase,
)
from rpms_ros.stimulation.schedule.schedule import (
    Pause as Pause,
    Plan as Plan,
    Repeat as Repeat,
    Schedule as Schedule,
    Segment as Segment,
)
from rpms_ros.stimulation.schedule.segments import (
    Constant as Constant,
    Doublet as Doublet,
    PulseBurst as PulseBurst,
    Ramp as Ramp,
    Single as Single,
    Sinusoid as Sinusoid,
    Staircase as Staircase,
    UniformRandom as UniformRandom,
)
