# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stimulation: pulses, schedules, limits, coil energy, devices and the stop."""

from rpms_ros.stimulation.bursts import Doublet
from rpms_ros.stimulation.bursts import PulseBurst
from rpms_ros.stimulation.bursts import Single
from rpms_ros.stimulation.description import SEGMENT_KINDS
from rpms_ros.stimulation.description import load_schedule
from rpms_ros.stimulation.description import schedule_from_mapping
from rpms_ros.stimulation.description import schedule_from_text
from rpms_ros.stimulation.description import schedule_to_mapping
from rpms_ros.stimulation.description import schedule_to_text
from rpms_ros.stimulation.fields import DescriptionError
from rpms_ros.stimulation.multilevel_prbs import MultilevelPRBS
from rpms_ros.stimulation.presets import constant
from rpms_ros.stimulation.presets import paper_random
from rpms_ros.stimulation.presets import paper_sinusoid
from rpms_ros.stimulation.presets import staircase
from rpms_ros.stimulation.repetitive import Constant
from rpms_ros.stimulation.repetitive import Ramp
from rpms_ros.stimulation.repetitive import Sinusoid
from rpms_ros.stimulation.repetitive import Staircase
from rpms_ros.stimulation.repetitive import UniformRandom
from rpms_ros.stimulation.schedule import Plan
from rpms_ros.stimulation.schedule import Repeat
from rpms_ros.stimulation.schedule import Schedule
from rpms_ros.stimulation.schedule import Totals
from rpms_ros.stimulation.segment import Pause
from rpms_ros.stimulation.segment import Segment

__all__ = [
    'SEGMENT_KINDS',
    'Constant',
    'DescriptionError',
    'Doublet',
    'MultilevelPRBS',
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
    'Totals',
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
