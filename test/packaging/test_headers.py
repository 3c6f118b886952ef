# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Every source file says whose it is and under which licence; tools/headers writes it."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

NOTICE = '# Copyright 2026 rpms_ros contributors\n# SPDX-License-Identifier: Apache-2.0\n'
CSS_NOTICE = NOTICE.replace('# ', '/* ').replace('\n', ' */\n')


@pytest.fixture
def headers(tool: Callable[[str], ModuleType]) -> ModuleType:
    return tool('headers')


def test_no_file_is_without(headers: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert headers.main(['--check']) == 0, capsys.readouterr().out
    found = {path.relative_to(headers.ROOT).as_posix() for path in headers.sources(headers.ROOT)}
    assert {'setup.py', 'tools/build', 'rpms_ros/axis.py', 'rpms_ros/live/page.html'} <= found
    assert {'launch/simulation.launch.py', 'msg_defs/CMakeLists.txt', 'bench/run.py'} <= found
    assert not any('axe_core' in path or 'uplot' in path for path in found)


@pytest.mark.parametrize(
    ('name', 'before', 'after'),
    [
        ('plain.py', '"""It."""\n', f'{NOTICE}"""It."""\n'),
        ('script', '#!/bin/sh\n# What it does.\n', f'#!/bin/sh\n{NOTICE}\n# What it does.\n'),
        ('page.css', 'body {}\n', f'{CSS_NOTICE}body {{}}\n'),
        ('empty.py', '', ''),
        ('data', 'no program\n', 'no program\n'),
        ('text.md', '# Heading\n', '# Heading\n'),
    ],
)
def test_it_is_written_where_it_is_missing(
    headers: ModuleType, tmp_path: Path, name: str, before: str, after: str
) -> None:
    path = tmp_path / 'rpms_ros' / name
    path.parent.mkdir()
    path.write_text(before)
    assert headers.main(['--check'], tmp_path) == int(before != after)
    assert path.read_text() == before
    for _ in range(2):
        assert headers.main([], tmp_path) == 0
        assert path.read_text() == after
    assert headers.main(['--check'], tmp_path) == 0
