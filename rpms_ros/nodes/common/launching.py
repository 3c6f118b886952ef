# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Arguments and nodes that the launch files share.

ROS's `launch` is imported where it is used: it is not on PyPI, and nothing but a launch file needs
it.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from launch.launch_context import LaunchContext
    from launch.launch_description import LaunchDescription
    from launch_ros.actions import Node

Given = Callable[[str], str]
"""Returns the value of a launch argument."""
Argument = tuple[str, str, str]
"""Name, default and description of a launch argument."""

PACKAGE = 'rpms_ros'
AS_THE_FILES_SAY = 'Empty: as the files say.'
"""How the description of an argument ends that replaces a parameter only if it is given."""
# Arguments of every launch file.
_COMMON: tuple[Argument, ...] = (
    ('parameters', '', 'YAML of parameters that replace those of config/.'),
    ('live', 'false', 'Serve the live page as well, at http://127.0.0.1:8765/.'),
    ('record', 'false', 'Record as well.'),
    ('path', '', 'Folder of the recording; empty makes a name.'),
)


def described(
    arguments: Iterable[Argument], nodes: Callable[[Given], 'list[Node]']
) -> 'LaunchDescription':
    """Return what is started, and the arguments that `--show-args` lists.

    Parameters
    ----------
    arguments : iterable of Argument
        Before those of every launch file.
    nodes : callable
        Returns the nodes as the arguments say.
    """
    from launch.actions import DeclareLaunchArgument, OpaqueFunction
    from launch.launch_description import LaunchDescription
    from launch.substitutions import LaunchConfiguration

    declared = [
        DeclareLaunchArgument(
            name,
            default_value=default,
            description=meaning,
            choices=['true', 'false'] if name in ('live', 'record') else None,
        )
        for name, default, meaning in (*arguments, *_COMMON)
    ]

    def started(context: 'LaunchContext') -> 'list[Node]':
        return nodes(lambda name: str(LaunchConfiguration(name).perform(context)))

    return LaunchDescription([*declared, OpaqueFunction(function=started)])


def configured(name: str, given: Given, chosen: dict[str, object], **options: Any) -> 'Node':
    """Return one node: its file of config/, then the file of the user, then what was chosen.

    Parameters
    ----------
    name : str
        Of the executable, the node and its file.
    given : callable
        The arguments of the launch file; `namespace` and `parameters` are asked for.
    chosen : dict
        Parameters of the node.
    **options : object
        Further ones of `launch_ros.actions.Node`.
    """
    from ament_index_python.packages import get_package_share_directory
    from launch_ros.actions import Node

    default = Path(get_package_share_directory(PACKAGE)) / 'config' / f'{name}.yaml'
    files = [str(default), *filter(None, [given('parameters')])]
    return Node(
        package=PACKAGE,
        executable=name,
        name=name,
        namespace=given('namespace'),
        parameters=[*files, *([chosen] if chosen else [])],
        output='screen',
        **options,
    )
