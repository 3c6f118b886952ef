# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Every source file says whose it is and under which licence; tools/headers writes it."""

from collections.abc import Callable
from types import ModuleType

import pytest


@pytest.fixture
def headers(tool: Callable[[str], ModuleType]) -> ModuleType:
    return tool('headers')


def test_no_file_is_without(headers: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert headers.main(['--check']) == 0, capsys.readouterr().out
    found = {path.relative_to(headers.ROOT).as_posix() for path in headers.sources(headers.ROOT)}
    assert {'setup.py', 'tools/build', 'rpms_ros/axis.py', 'rpms_ros/live/page.html'} <= found
    assert {'launch/simulation.launch.py', 'msg_defs/CMakeLists.txt', 'bench/run.py'} <= found
    assert not any('axe_core' in path or 'uplot' in path for path in found)
