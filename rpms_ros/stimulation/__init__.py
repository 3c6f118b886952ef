# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stimulation: pulses, schedules, limits, coil energy, devices and the stop."""

from rpms_ros.stimulation.schedule.description import (
    SEGMENT_KINDS,
    load_schedule,
    schedule_from_mapping,
    schedule_from_text,
    schedule_to_mapping,
    schedule_to_text,
)
from rpms_ros.stimulation.schedule.fields import DescriptionError
from rpms_ros.stimulation.schedule.protocols import (
    constant,
    paper_random,
    paper_sinusoid,
    staircase,
)
from rpms_ros.stimulation.schedule.schedule import Pause, Plan, Repeat, Schedule, Segment
from rpms_ros.stimulation.schedule.segments import (
    Constant,
    Doublet,
    PulseBurst,
    Ramp,
    Single,
    Sinusoid,
    Staircase,
    UniformRandom,
)

__all__ = [
    'SEGMENT_KINDS',
    'Constant',
    'DescriptionError',
    'Doublet',
    'Pause',
    'Plan',
    'PulseBurst',
    'Ramp',
    'Repeat',
    'Schedule',
    'Segment',
    'Single',
    'Sinusoid',
    'Staircase',
    'UniformRandom',
    'constant',
    'load_schedule',
    'paper_random',
    'paper_sinusoid',
    'schedule_from_mapping',
    'schedule_from_text',
    'schedule_to_mapping',
    'schedule_to_text',
    'staircase',
]
