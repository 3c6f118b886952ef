# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Names of topics, relative to the namespace of the node, and the classes of their messages."""

from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from std_msgs.msg import Header

from rpms_msgs.msg import MuscleEstimate, MuscleTruth, Pulse, Schedule, ScheduleSegment
from rpms_ros.messages import MessageTypes

PULSES = 'pulses'
"""rpms_msgs/Pulse: pulses that were delivered."""

PULSES_COMMANDED = 'pulses_commanded'
"""rpms_msgs/Pulse: pulses that were requested."""

FORCE = 'force'
"""geometry_msgs/WrenchStamped: what the force sensor measures."""

ESTIMATE = 'estimate'
"""rpms_msgs/MuscleEstimate: estimate of the muscle."""

DISTURBANCE = 'disturbance'
"""geometry_msgs/WrenchStamped: estimated force that the stimulation does not cause."""

TRUTH = 'truth'
"""rpms_msgs/MuscleTruth: true state of a simulated muscle."""

DRIVER_STATUS = 'driver_status'
"""rpms_msgs/DriverStatus: state of a stimulator driver."""

ACCEPTED_SCHEDULE = 'accepted_schedule'
"""rpms_msgs/AcceptedSchedule: schedule that a driver is about to run."""

RUN_SCHEDULE = 'run_schedule'
"""rpms_msgs/RunSchedule: action that makes a driver run a schedule."""

EMERGENCY_STOP = 'emergency_stop'
"""std_msgs/Bool: state of a stop button, at a rate; std_srvs/Trigger: stop as a service."""

RESET_EMERGENCY_STOP = 'reset_emergency_stop'
"""std_srvs/Trigger: resets a latched stop whose cause is gone."""

HEARTBEAT = 'heartbeat'
"""rpms_msgs/OperatorHeartbeat: the operator who has armed is there and holds the enable."""

REQUEST_ARMING = 'request_arming'
"""rpms_msgs/RequestArming: first step of arming, gives one operator a token."""

CONFIRM_ARMING = 'confirm_arming'
"""rpms_msgs/ConfirmArming: second step, arms."""

JOY = 'joy'
"""sensor_msgs/Joy: buttons of a joystick."""

DIAGNOSTICS = '/diagnostics'
"""diagnostic_msgs/DiagnosticArray: absolute, where ROS tools look for them."""


def type_name_of(kind: Any) -> str:
    """Return the name of a message class, such as ``rpms_msgs/msg/Pulse``."""
    package, folder = kind.__module__.split('.')[:2]
    return f'{package}/{folder}/{kind.__name__}'


_OF_ROS = (Time, Header, Vector3, Wrench, WrenchStamped)
_OWN = (Pulse, MuscleEstimate, MuscleTruth, Schedule, ScheduleSegment)
MESSAGE_TYPES: MessageTypes = {type_name_of(kind): kind for kind in (*_OF_ROS, *_OWN)}
