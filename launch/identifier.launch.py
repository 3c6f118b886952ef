# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The identifier beside somebody's own sensor and stimulator; a recorder, a live page if asked.

ros2 launch rpms_ros identifier.launch.py force:=/ft_sensor/wrench axis:=x
"""

import yaml
from launch_ros.actions import Node

from launch import LaunchDescription
from rpms_ros.nodes.common.launching import AS_THE_FILES_SAY, Given, configured, described

TOPICS = ('force', 'pulses')
# Parameter of the identifier, meaning.
PARAMETERS = (
    ('estimator', 'Algorithm.'),
    ('axis', 'Axis of the wrench along which the muscle pulls.'),
    ('quantity', 'What the sensor measures: force or torque.'),
    ('use_sim_time', 'Follow /clock, as of a recording that is played.'),
)
OF_THE_RECORDER = ('use_sim_time',)
OF_THE_LIVE_PAGE = ('axis', 'quantity', 'use_sim_time')


def generate_launch_description() -> LaunchDescription:
    """Return what is started, and the arguments that `--show-args` lists."""
    arguments = [
        ('namespace', '', 'Namespace of the nodes.'),
        *((name, name, f'Topic of {name}, relative to the namespace.') for name in TOPICS),
        *((name, '', f'{meaning} {AS_THE_FILES_SAY}') for name, meaning in PARAMETERS),
    ]
    return described(arguments, nodes)


def nodes(given: Given) -> list[Node]:
    """Return the nodes as the arguments say."""
    values = {name: given(name) for name, _ in PARAMETERS}
    chosen = {
        key: value if key in ('axis', 'estimator') else yaml.safe_load(value)
        for key, value in values.items()
        if value
    }
    of_each: dict[str, dict[str, object]] = {'identifier': chosen}
    if given('record') == 'true':
        of_each['recorder'] = only(chosen, OF_THE_RECORDER)
        of_each['recorder'] |= {'path': given('path')} if given('path') else {}
    if given('live') == 'true':
        of_each['live_page'] = only(chosen, OF_THE_LIVE_PAGE)
    remappings = [(topic, given(topic)) for topic in TOPICS]
    return [
        configured(name, given, parameters, remappings=remappings)
        for name, parameters in of_each.items()
    ]


def only(chosen: dict[str, object], names: tuple[str, ...]) -> dict[str, object]:
    """Return the parameters of these names."""
    return {key: value for key, value in chosen.items() if key in names}
