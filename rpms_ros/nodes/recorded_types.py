# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Message class, definition and quality of service of a topic that is recorded."""

from collections.abc import Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError
from ament_index_python.packages import get_package_share_directory
from rclpy.qos import DurabilityPolicy
from rclpy.qos import QoSProfile
from rclpy.qos import ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosbags.interfaces import Qos
from rosbags.interfaces import QosDurability
from rosbags.interfaces import QosHistory
from rosbags.interfaces import QosLiveliness
from rosbags.interfaces import QosReliability
from rosbags.interfaces import QosTime

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.recording.definitions import described_type
from rpms_ros.recording.definitions import known_types
from rpms_ros.recording.definitions import written_definition

# A hundred seconds at 50 Hz.
_DEPTH = 5000


def message_class(type_name: str) -> Any:
    """Return the class of ``package/msg/Name``.

    Raises
    ------
    RecordingError
        If its package is not installed.
    """
    package, folder, name = type_name.split('/')
    try:
        return getattr(import_module(f'{package}.{folder}'), name)
    except (ImportError, AttributeError) as error:
        raise RecordingError(f'expected an installed {type_name}, got {error}') from error


def type_name_of(kind: Any) -> str:
    """Return ``package/msg/Name`` of a message class."""
    package, folder = kind.__module__.split('.')[:2]
    return f'{package}/{folder}/{kind.__name__}'


@cache
def definition_of(type_name: str) -> tuple[str, str]:
    """Return text and hash of any installed type.

    Raises
    ------
    RecordingError
        If its package has no definition of it.
    """
    if type_name in known_types().fielddefs:
        return written_definition(type_name)
    return described_type(type_name, _installed_text)


def _installed_text(type_name: str) -> str:
    package, folder, name = type_name.split('/')
    try:
        share = get_package_share_directory(package)
        return Path(share, folder, f'{name}.msg').read_text('utf-8')
    except (PackageNotFoundError, OSError) as error:
        raise RecordingError(f'expected an installed {type_name}.msg, got {error}') from error


def subscription_qos(publishers: Sequence[TopicEndpointInfo]) -> QoSProfile:
    """Return a profile compatible with all publishers: as reliable and durable as the least."""
    profiles = [publisher.qos_profile for publisher in publishers]
    reliable = all(one.reliability == ReliabilityPolicy.RELIABLE for one in profiles)
    durable = all(one.durability == DurabilityPolicy.TRANSIENT_LOCAL for one in profiles)
    return QoSProfile(
        depth=_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if durable else DurabilityPolicy.VOLATILE,
    )


def offered_qos(publishers: Sequence[TopicEndpointInfo]) -> list[Qos]:
    """Return the quality of service that each publisher offers, as recordings store it."""
    return [_recorded(publisher.qos_profile) for publisher in publishers]


def _recorded(profile: QoSProfile) -> Qos:
    return Qos(
        QosHistory[profile.history.name],
        profile.depth,
        QosReliability[profile.reliability.name],
        QosDurability[profile.durability.name],
        _time(profile.deadline),
        _time(profile.lifespan),
        QosLiveliness[profile.liveliness.name],
        _time(profile.liveliness_lease_duration),
        bool(profile.avoid_ros_namespace_conventions),
    )


def _time(duration: Any) -> QosTime:
    return QosTime(*divmod(int(duration.nanoseconds), NANOSECONDS_PER_SECOND))
