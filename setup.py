# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Package description for colcon (ament_python) and pip alike."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = 'rpms_ros'


def files(pattern: str) -> list[str]:
    """Return the files that match, as data_files wants them."""
    return sorted(str(path) for path in Path().glob(pattern))


setup(
    name=NAME,
    version='0.1.0',
    description='On-line identification of magnetically or electrically stimulated muscle',
    long_description=Path('README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    classifiers=[
        'Development Status :: 4 - Beta',
        'Intended Audience :: Science/Research',
        'Programming Language :: Python :: 3 :: Only',
        'Programming Language :: Python :: 3.11',
        'Programming Language :: Python :: 3.12',
        'Programming Language :: Python :: 3.13',
        'Programming Language :: Python :: 3.14',
        'Topic :: Scientific/Engineering :: Medical Science Apps.',
        'Typing :: Typed',
    ],
    license='Apache-2.0',
    url='https://github.com/rpms-ros/rpms_ros',
    author='rpms_ros contributors',
    author_email='rpms-ros@users.noreply.github.com',
    maintainer='rpms_ros maintainers',
    maintainer_email='rpms-ros@users.noreply.github.com',
    python_requires='>=3.11',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={
        NAME: ['py.typed', '**/LICENSE']
        + [f'**/*.{ending}' for ending in ('yaml', 'xml', 'msg', 'css', 'js', 'html')]
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/launch', files('launch/*.launch.py')),
        (f'share/{NAME}/config', files('config/*.yaml') + files('config/*_layout.*')),
    ],
    zip_safe=False,
    # The lower bounds are what Ubuntu 24.04 ships.
    install_requires=[
        'argcomplete>=3.1',
        'backports.zstd; python_version < "3.14"',
        # only speed: without it zlib computes the checksums; it has no wheels for other machines
        'isal>=1.5; platform_machine in "x86_64 AMD64 aarch64 arm64"',
        'lz4',
        'matplotlib>=3.6',
        'mcap>=1.6',
        'numba',
        'numpy>=1.26',
        'pyserial>=3.5',
        'PyYAML>=6.0',
        'rosbags>=0.11',
        'scipy>=1.11',
        'tornado>=6.4',
        'tqdm>=4.66',
    ],
    extras_require={
        'report': ['jinja2>=3.1'],
        # rpms_msgs comes from msg_defs: pip install ./msg_defs
        'ros': [
            'ros-jazzy-rclpy[fastrtps]==7.1.6; sys_platform == "linux"',
            'ros-diagnostic-msgs==5.3.6',
            'ros-geometry-msgs==5.3.6',
            'ros-sensor-msgs==5.3.6',
            'ros-std-msgs==5.3.6',
            'ros-std-srvs==5.3.6',
        ],
        'formats': ['openpyxl', 'pyxdf'],
        'test': ['hypothesis', 'jsonschema', 'pytest', 'pytest-timeout'],
    },
    entry_points={
        'console_scripts': [
            'rpms = rpms_ros.cli:main',
            'identifier = rpms_ros.nodes.executables:identifier',
            'plant_simulator = rpms_ros.nodes.executables:plant_simulator',
            'recorder = rpms_ros.nodes.executables:recorder',
            'stop_button = rpms_ros.nodes.executables:stop_button',
            'live_page = rpms_ros.nodes.executables:live_page',
            'operator_console = rpms_ros.nodes.executables:operator_console',
            'stimulator_driver = rpms_ros.nodes.executables:stimulator_driver',
        ],
        'rpms_ros.devices': [
            'serial = rpms_ros.stimulation.devices.rapid2:build',
            'simulated = rpms_ros.stimulation.devices.simulated:build',
        ],
    },
)
