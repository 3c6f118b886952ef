"""The identifier alone, for a laboratory that has its own force sensor and stimulator.

ros2 launch rpms_ros identifier.launch.py force:=/ft_sensor/wrench parameters:=mine.yaml
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

PACKAGE = 'rpms_ros'


def generate_launch_description() -> LaunchDescription:
    default = Path(get_package_share_directory(PACKAGE)) / 'config' / 'identifier.yaml'
    topics = {name: LaunchConfiguration(name) for name in ('force', 'pulses')}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=name, description=f'Topic of {name}.')
                for name in topics
            ),
            DeclareLaunchArgument(
                'parameters', default_value=str(default), description='YAML of parameters.'
            ),
            Node(
                package=PACKAGE,
                executable='identifier',
                name='identifier',
                parameters=[LaunchConfiguration('parameters')],
                remappings=list(topics.items()),
                output='screen',
            ),
        ]
    )
