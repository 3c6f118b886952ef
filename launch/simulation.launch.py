"""Simulated muscle, stimulator driver, identifier and recorder.

ros2 launch rpms_ros simulation.launch.py namespace:=left_leg record:=true
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

PACKAGE = 'rpms_ros'
NODES = ('plant_simulator', 'stimulator_driver', 'identifier')


def generate_launch_description() -> LaunchDescription:
    share = Path(get_package_share_directory(PACKAGE))
    namespace = LaunchConfiguration('namespace')
    record = IfCondition(LaunchConfiguration('record'))
    return LaunchDescription(
        [
            DeclareLaunchArgument('namespace', default_value='', description='Of every node.'),
            DeclareLaunchArgument('record', default_value='false', description='Record as well.'),
            *(node(name, namespace, share) for name in NODES),
            node('recorder', namespace, share, condition=record),
        ]
    )


def node(
    name: str, namespace: LaunchConfiguration, share: Path, condition: IfCondition | None = None
) -> Node:
    return Node(
        package=PACKAGE,
        executable=name,
        name=name,
        namespace=namespace,
        parameters=[str(share / 'config' / f'{name}.yaml')],
        condition=condition,
        output='screen',
    )
