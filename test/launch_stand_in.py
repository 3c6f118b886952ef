# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What launch files import, as far as they use it, where ROS's `launch` is not installed.

`launch` and `launch_ros` are not on PyPI.  Here they only keep what they are given, so that a test
reads from a launch file which processes it would start, and starts those itself.  Where the real
ones can be imported, `test_launch_files.py` runs `ros2 launch` as well.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any


@dataclass
class LaunchContext:
    """Values of launch arguments."""

    values: dict[str, str] = field(default_factory=dict)


@dataclass
class LaunchConfiguration:
    """Stands for the value of an argument."""

    name: str

    def perform(self, context: LaunchContext) -> str:
        """Return the value."""
        return context.values[self.name]


@dataclass
class DeclareLaunchArgument:
    """An argument."""

    name: str
    default_value: str
    description: str
    choices: list[str] | None = None


@dataclass
class OpaqueFunction:
    """A function that returns what is started."""

    function: Callable[[LaunchContext], list[Any]]


class Node:
    """A process to start."""

    def __init__(self, **options: Any) -> None:
        self.options = options


@dataclass
class LaunchDescription:
    """What a launch file returns."""

    entities: list[Any]


MODULES: dict[str, tuple[Any, ...]] = {
    'launch': (LaunchContext, LaunchDescription),
    'launch.actions': (DeclareLaunchArgument, OpaqueFunction),
    'launch.launch_context': (LaunchContext,),
    'launch.launch_description': (LaunchDescription,),
    'launch.substitutions': (LaunchConfiguration,),
    'launch_ros': (),
    'launch_ros.actions': (Node,),
}


def install(set_item: Callable[[dict[str, Any], str, Any], None]) -> None:
    """Put the modules where an import finds them; `set_item` is monkeypatch.setitem."""
    for name, members in MODULES.items():
        module = ModuleType(name)
        for member in members:
            setattr(module, member.__name__, member)
        set_item(sys.modules, name, module)
