# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The files that describe the two packages agree with each other and with the source tree."""

import ast
import re
import tomllib
import xml.etree.ElementTree as ET
from importlib import import_module
from pathlib import Path

import pytest
from catkin_pkg.changelog import Changelog, populate_changelog_from_rst
from catkin_pkg.package_version import get_forthcoming_label

ROOT = Path(__file__).resolve().parents[2]
MSGS = ROOT / 'msg_defs'


def package_xml(folder):
    return ET.parse(folder / 'package.xml').getroot()


def depends(element, *tags):
    return {item.text or '' for tag in tags for item in element.findall(tag)}


def setup_arguments():
    """Literal keyword arguments of setup(), without running it."""
    tree = ast.parse((ROOT / 'setup.py').read_text())
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    (setup,) = [call for call in calls if ast.unparse(call.func) == 'setup']
    arguments = {keyword.arg: keyword.value for keyword in setup.keywords}
    return {name: ast.literal_eval(arguments[name]) for name in ('version', 'entry_points')}


def imported_packages():
    """Top-level names that the sources of rpms_ros import."""
    names = set()
    for path in (ROOT / 'rpms_ros').rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                names.add(node.module.split('.')[0])
    return names


def test_one_version():
    init = (ROOT / 'rpms_ros' / '__init__.py').read_text()
    project = tomllib.loads((MSGS / 'pyproject.toml').read_text())['project']
    versions = {
        'package.xml': package_xml(ROOT).findtext('version'),
        'msg_defs/package.xml': package_xml(MSGS).findtext('version'),
        'msg_defs/pyproject.toml': project['version'],
        'setup.py': setup_arguments()['version'],
        '__version__': re.findall(r"^__version__ = '(.*)'$", init, re.MULTILINE)[0],
    }
    assert len(set(versions.values())) == 1, versions


# catkin_pkg calls docutils by an old name
@pytest.mark.filterwarnings('ignore:nodes.Node.traverse')
@pytest.mark.parametrize('folder', [ROOT, MSGS], ids=['rpms_ros', 'rpms_msgs'])
def test_a_release_finds_the_changes_of_its_version(folder):
    root = package_xml(folder)
    rst = (folder / 'CHANGELOG.rst').read_text()
    assert f'Changelog for package {root.findtext("name")}\n' in rst
    # what catkin_prepare_release does: it puts version and date in the place of this title
    label, version = get_forthcoming_label(rst), root.findtext('version')
    assert label == 'Forthcoming'
    heading = f'{version} (2026-01-01)\n------------------\n'
    released = rst.replace('Forthcoming\n-----------\n', heading)
    changelog = populate_changelog_from_rst(Changelog(), released)
    assert [found for found, *_ in changelog.foreach_version()] == [version]
    assert changelog.get_content_of_version(version)


def test_cmake_generates_every_interface_and_depends_as_package_xml_says():
    cmake = (MSGS / 'CMakeLists.txt').read_text()
    named = set(re.findall(r'"((?:msg|srv|action)/\w+\.\w+)"', cmake))
    there = {
        str(path.relative_to(MSGS))
        for kind in ('msg', 'srv', 'action')
        for path in (MSGS / kind).glob(f'*.{kind}')
    }
    assert named == there
    found = set(re.findall(r'find_package\((\w+) REQUIRED\)', cmake))
    assert found == depends(package_xml(MSGS), 'buildtool_depend', 'depend')


def test_every_console_script_has_a_target():
    for script in setup_arguments()['entry_points']['console_scripts']:
        module, function = script.split('=')[1].strip().split(':')
        assert callable(getattr(import_module(module), function)), script


# Import name: rosdep key, where they differ.
ROSDEP = {
    'argcomplete': 'python3-argcomplete',
    'matplotlib': 'python3-matplotlib',
    'mcap': 'mcap-ros2-support',
    'jinja2': 'python3-jinja2',
    'numpy': 'python3-numpy',
    'rosbags': 'python3-rosbags-pip',
    'scipy': 'python3-scipy',
    'serial': 'python3-serial',
    'tornado': 'python3-tornado',
    'tqdm': 'python3-tqdm',
    'yaml': 'python3-yaml',
}
ROS_PACKAGES = {'action_msgs', 'ament_index_python', 'builtin_interfaces', 'diagnostic_msgs'}
ROS_PACKAGES |= {'geometry_msgs', 'lifecycle_msgs', 'rcl_interfaces', 'rclpy', 'rosgraph_msgs'}
ROS_PACKAGES |= {'rpms_msgs', 'std_msgs', 'std_srvs'}


def test_every_import_is_a_declared_dependency():
    keys = {ROSDEP.get(name, name) for name in imported_packages()}
    needed = keys & (set(ROSDEP.values()) | ROS_PACKAGES)
    assert needed <= depends(package_xml(ROOT), 'depend', 'exec_depend')


def test_the_image_is_built_as_the_page_builds_a_workspace():
    readme, lines = (ROOT / 'README.md').read_text(), (ROOT / 'Dockerfile').read_text()
    steps = re.findall(r'^((?:rosdep install|colcon build) .*)$', readme, re.MULTILINE)
    assert len(steps) == 2
    for step in steps:
        assert step in lines
    assert 'FROM ros:jazzy-ros-base' in lines
    (pinned,) = re.findall(r'`python3 -m pip install (numba==[\d.]+)`', readme)
    assert f'python3 -m pip install {pinned}' in lines
    assert set(pinned.split()) <= set((ROOT / 'requirements' / 'rpms.lock').read_text().split())


def pins(name):
    lines = (ROOT / 'requirements' / f'{name}.lock').read_text().splitlines()
    return [line for line in lines if not line.startswith('#')]


def test_locks_pin_every_package_once():
    all_pins = [*pins('rpms'), *pins('colcon'), *pins('docs')]
    assert [pin for pin in all_pins if not re.fullmatch(r'[\w.-]+==[\w.]+', pin)] == []
    assert len(all_pins) == len({pin.split('==')[0] for pin in all_pins})


@pytest.mark.parametrize('name', ['rpms', 'colcon', 'docs', 'wheel'])
def test_lock_follows_its_source(name):
    source = (ROOT / 'requirements' / f'{name}.in').read_text()
    wanted = re.findall(r'^([\w.-]+)(?:\[\w+\])?(==[\w.]+)?$', source, re.MULTILINE)
    for package, version in wanted:
        (pin,) = [pin for pin in pins(name) if pin.startswith(f'{package.lower()}==')]
        assert pin.endswith(version)
