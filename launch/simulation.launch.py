# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated muscle, stimulator driver, identifier; a recorder, a live page if asked.

ros2 launch rpms_ros simulation.launch.py namespace:=left_leg schedule:=random.yaml record:=true
"""

from launch_ros.actions import Node

from launch import LaunchDescription
from rpms_ros.nodes.common.launching import AS_THE_FILES_SAY, Given, configured, described

ARGUMENTS = (
    ('namespace', '', 'Namespace of every node.'),
    ('estimator', '', f'Algorithm of the identifier. {AS_THE_FILES_SAY}'),
    ('subject', '', f'Preset of the muscle. {AS_THE_FILES_SAY}'),
    ('scenario', '', 'What happens in the session: a name or a YAML file.'),
    ('quantity', '', f'What the sensor measures: force or torque. {AS_THE_FILES_SAY}'),
    ('schedule', '', 'YAML file, run once everybody listens. Empty: a goal is waited for.'),
)


def generate_launch_description() -> LaunchDescription:
    """Return what is started, and the arguments that `--show-args` lists."""
    return described(ARGUMENTS, nodes)


def nodes(given: Given) -> list[Node]:
    """Return the nodes as the arguments say."""
    record, live = given('record') == 'true', given('live') == 'true'
    # the force goes to identifier, recorder and page, the pulses to the plant too
    listeners = 1 + record + live
    chosen: dict[str, dict[str, object]] = {
        'plant_simulator': {
            **some(given, subject='subject', scenario='scenario', quantity='quantity'),
            'minimum_subscribers': listeners,
        },
        'stimulator_driver': {
            **some(given, quantity='quantity', schedule_file='schedule'),
            **({'autostart': True} if given('schedule') else {}),
            'minimum_subscribers': listeners + 1,
        },
        'identifier': some(given, estimator='estimator', quantity='quantity'),
    }
    if record:
        chosen['recorder'] = some(given, path='path')
    if live:
        chosen['live_page'] = some(given, quantity='quantity')
    return [configured(name, given, parameters) for name, parameters in chosen.items()]


def some(given: Given, **names: str) -> dict[str, object]:
    """Return parameters of the arguments that are not empty."""
    return {key: given(name) for key, name in names.items() if given(name)}
