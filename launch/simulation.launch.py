# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated muscle, stimulator driver, identifier; a recorder, a live page if asked.

ros2 launch rpms_ros simulation.launch.py namespace:=left_leg schedule:=uniform_random record:=true
"""

from collections.abc import Callable
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.actions import OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext
from launch import LaunchDescription

PACKAGE = 'rpms_ros'
Given = Callable[[str], str]
ARGUMENTS = (
    ('namespace', '', 'Namespace of every node.'),
    ('estimator', '', 'Algorithm of the identifier. Empty: as the files say.'),
    ('subject', '', 'Preset of the muscle. Empty: as the files say.'),
    ('scenario', '', 'What happens in the session: a name or a YAML file.'),
    ('quantity', '', 'What the sensor measures: force or torque. Empty: as the files say.'),
    (
        'schedule',
        '',
        'YAML file or name of a kind, run once everybody listens. Empty: a goal is waited for.',
    ),
    ('parameters', '', 'YAML of parameters that replace those of config/.'),
    ('live', 'false', 'Serve the live page as well, at http://127.0.0.1:8765/.'),
    ('record', 'false', 'Record as well.'),
    ('path', '', 'Folder of the recording; empty makes a name.'),
)


def generate_launch_description() -> LaunchDescription:
    """Return what is started, and the arguments that `--show-args` lists."""
    arguments = [
        DeclareLaunchArgument(
            name,
            default_value=default,
            description=doc,
            choices=['true', 'false'] if name in ('live', 'record') else None,
        )
        for name, default, doc in ARGUMENTS
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes as the arguments say."""

    def given(name: str) -> str:
        return str(LaunchConfiguration(name).perform(context))

    record = given('record') == 'true'
    # the force goes to identifier and recorder, the pulses to the plant too
    listeners = 2 if record else 1
    chosen: dict[str, dict[str, object]] = {
        'plant_simulator': {
            **some(given, subject='subject', scenario='scenario', quantity='quantity'),
            'minimum_subscribers': listeners,
        },
        'stimulator_driver': {
            **some(given, quantity='quantity'),
            **schedule(given('schedule')),
            'minimum_subscribers': listeners + 1,
        },
        'identifier': some(given, estimator='estimator', quantity='quantity'),
    }
    if record:
        chosen['recorder'] = some(given, path='path')
    if given('live') == 'true':
        # nobody waits for a page: it only looks
        chosen['live_page'] = some(given, quantity='quantity')
    return [node(name, given, parameters) for name, parameters in chosen.items()]


def some(given: Given, **names: str) -> dict[str, object]:
    """Return parameters of the arguments that are not empty."""
    return {key: given(name) for key, name in names.items() if given(name)}


def schedule(asked: str) -> dict[str, object]:
    """Return the parameters of the driver that make it run a schedule by itself."""
    if not asked:
        return {}
    is_file = Path(asked).suffix in ('.yaml', '.yml')
    return {'autostart': True, 'schedule_file' if is_file else 'schedule': asked}


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
        output='screen',
    )
