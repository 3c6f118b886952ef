# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What launch files import, as far as they use it, where ROS's `launch` is not installed.

`launch` and `launch_ros` are not on PyPI.  Here they only keep what they are given, so that a test
reads from a launch file which processes it would start, and starts those itself.
"""

import sys
from dataclasses import field, make_dataclass
from types import ModuleType, SimpleNamespace


def node(**options):
    """Return a process to start."""
    return SimpleNamespace(options=options)


def value_of(argument, context):
    """Return the value of an argument, for which a `LaunchConfiguration` stands."""
    return context.values[argument.name]


Argument = ['name', 'default_value', 'description', ('choices', list, field(default=None))]
MODULES = {
    'launch': {},
    'launch.actions': {
        'DeclareLaunchArgument': make_dataclass('DeclareLaunchArgument', Argument),
        'OpaqueFunction': make_dataclass('OpaqueFunction', ['function']),
    },
    'launch.launch_context': {'LaunchContext': make_dataclass('LaunchContext', ['values'])},
    'launch.launch_description': {
        'LaunchDescription': make_dataclass('LaunchDescription', ['entities'])
    },
    'launch.substitutions': {
        'LaunchConfiguration': make_dataclass(
            'LaunchConfiguration', ['name'], namespace={'perform': value_of}
        )
    },
    'launch_ros': {},
    'launch_ros.actions': {'Node': node},
}
MODULES['launch'] = {**MODULES['launch.launch_context'], **MODULES['launch.launch_description']}


def install(set_item):
    """Put the modules where an import finds them; `set_item` is monkeypatch.setitem."""
    for name, members in MODULES.items():
        module = ModuleType(name)
        vars(module).update(members)
        set_item(sys.modules, name, module)
