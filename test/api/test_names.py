# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The names are found, described and cheap to import."""

import inspect
import re
import subprocess
import sys

import pytest

import rpms_ros
from rpms_ros import api

FUNCTIONS = [
    one for one in (getattr(api, name) for name in api.__all__) if inspect.isfunction(one)
]
METHODS = [
    method
    for one in (api.Session, api.Identification)
    for name, method in inspect.getmembers(one, inspect.isfunction)
    if not name.startswith('_')
]


def test_the_package_offers_what_the_module_offers() -> None:
    assert sorted(rpms_ros.__all__) == sorted(api.__all__)
    assert set(dir(rpms_ros)) == {*api.__all__, '__version__'}
    for name in api.__all__:
        assert getattr(rpms_ros, name) is getattr(api, name)


def test_another_name_is_not_there() -> None:
    with pytest.raises(AttributeError, match="'rpms_ros' has no attribute 'laod'"):
        rpms_ros.laod  # type: ignore[attr-defined]  # noqa: B018


def modules_after(code: str) -> set[str]:
    """Return what a fresh interpreter has loaded after some code."""
    code += '\nimport sys; print(*sys.modules)'
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=True, timeout=250
    )
    return set(done.stdout.split())


def test_importing_the_package_loads_next_to_nothing() -> None:
    assert not {'numpy', 'scipy', 'numba', 'matplotlib'} & modules_after('import rpms_ros')


def test_the_api_loads_neither_ros_nor_what_only_unix_has() -> None:
    loaded = modules_after('import rpms_ros.api')
    roots = {name.partition('.')[0] for name in loaded}
    assert not {'rclpy', 'rpms_msgs', 'pandas', 'pyarrow', 'serial'} & roots
    assert not {'rpms_ros.nodes', 'rpms_ros.cli'} & loaded


@pytest.mark.parametrize('one', [*FUNCTIONS, *METHODS], ids=lambda one: one.__qualname__)
def test_every_parameter_is_described(one: object) -> None:
    names = [name for name in inspect.signature(one).parameters if name != 'self']  # type: ignore[arg-type]
    text = inspect.getdoc(one) or ''
    described = set(re.findall(r'^([\w, ]+) : ', text, re.MULTILINE))
    listed = {name for line in described for name in line.split(', ')}
    # a method of two plain numbers may say in its sentence what they are
    assert all(name in listed or f'`{name}`' in text for name in names), (names, listed)
