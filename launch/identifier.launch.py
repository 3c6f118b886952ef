# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The identifier beside somebody's own sensor and stimulator; a recorder, a live page if asked.

ros2 launch rpms_ros identifier.launch.py force:=/ft_sensor/wrench axis:=x best_effort:=true
"""

from collections.abc import Callable
from pathlib import Path

import yaml
from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.actions import OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext
from launch import LaunchDescription

PACKAGE = 'rpms_ros'
Given = Callable[[str], str]
TOPICS = ('force', 'pulses')
# Launch argument, parameter of the identifier, meaning.
PARAMETERS = (
    ('estimator', 'estimator', 'Algorithm.'),
    ('axis', 'axis', 'Axis of the wrench along which the muscle pulls.'),
    ('sign', 'sign', '1 or -1: the pull of the muscle is positive.'),
    ('quantity', 'quantity', 'What the sensor measures: force or torque.'),
    ('best_effort', 'best_effort_force', 'Hear a best-effort sensor from the start.'),
    ('use_sim_time', 'use_sim_time', 'Follow /clock, as of a recording that is played.'),
)
OF_THE_RECORDER = ('best_effort_force', 'use_sim_time')
OF_THE_LIVE_PAGE = ('axis', 'sign', 'quantity', 'use_sim_time')


def generate_launch_description() -> LaunchDescription:
    """Return what is started, and the arguments that `--show-args` lists."""
    declared = [('namespace', '', 'Namespace of the nodes.')]
    declared += [(name, name, f'Topic of {name}, relative to the namespace.') for name in TOPICS]
    declared += [(name, '', f'{doc} Empty: as the files say.') for name, _, doc in PARAMETERS]
    declared += [
        ('parameters', '', 'YAML of parameters that replace those of config/.'),
        ('live', 'false', 'Serve the live page as well, at http://127.0.0.1:8765/.'),
        ('record', 'false', 'Record as well.'),
        ('path', '', 'Folder of the recording; empty makes a name.'),
    ]
    arguments = [
        DeclareLaunchArgument(
            name,
            default_value=default,
            description=doc,
            choices=['true', 'false'] if name in ('live', 'record') else None,
        )
        for name, default, doc in declared
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes as the arguments say."""

    def given(name: str) -> str:
        return str(LaunchConfiguration(name).perform(context))

    values = {key: given(name) for name, key, _ in PARAMETERS}
    chosen = {
        key: value if key in ('axis', 'estimator') else yaml.safe_load(value)
        for key, value in values.items()
        if value
    }
    started = [node('identifier', given, chosen)]
    if given('record') == 'true':
        own = {key: value for key, value in chosen.items() if key in OF_THE_RECORDER}
        own |= {'path': given('path')} if given('path') else {}
        started.append(node('recorder', given, own))
    if given('live') == 'true':
        own = {key: value for key, value in chosen.items() if key in OF_THE_LIVE_PAGE}
        started.append(node('live_page', given, own))
    return started


def node(name: str, given: Given, chosen: dict[str, object]) -> Node:
    """Return one node: its file of config/, then the file of the user, then what was chosen."""
    default = Path(get_package_share_directory(PACKAGE)) / 'config' / f'{name}.yaml'
    files = [str(default), *filter(None, [given('parameters')])]
    return Node(
        package=PACKAGE,
        executable=name,
        name=name,
        namespace=given('namespace'),
        parameters=[*files, *([chosen] if chosen else [])],
        remappings=[(topic, given(topic)) for topic in TOPICS],
        output='screen',
    )
