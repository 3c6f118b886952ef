# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""No file holds more than one idea's worth of lines; tools/sizes counts."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

MODULE = '''# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Two lines
of docstring."""

import os
from pathlib import (
    Path,
)

# a remark
PLACE = Path(os.curdir)  # and another


def here() -> str:
    """One line."""
    return """text
of two lines"""
'''


@pytest.fixture
def sizes(tool: Callable[[str], ModuleType]) -> ModuleType:
    return tool('sizes')


def test_no_file_is_too_long(sizes: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert sizes.main(['--check']) == 0, capsys.readouterr().out


def test_lines_are_told_apart(sizes: ModuleType) -> None:
    found = sizes.size_of(MODULE)
    assert found._asdict() == {
        'modules': 1,
        'code': 4,
        'imports': 4,
        'docstrings': 3,
        'comments': 1,
        'all': 16,
    }


@pytest.mark.parametrize(('folder', 'limit'), [('rpms_ros', 600), ('test', 900)])
def test_a_file_that_is_too_long_is_named(
    sizes: ModuleType, tmp_path: Path, folder: str, limit: int
) -> None:
    path = tmp_path / folder / 'long.py'
    path.parent.mkdir()
    path.write_text('pass\n' * (limit + 2))
    assert sizes.too_long(tmp_path) == []
    path.write_text('pass\n' * (limit + 3))
    told = f'{folder}/long.py: expected at most {limit} lines, got {limit + 1}'
    assert sizes.too_long(tmp_path) == [told]
    sizes.LONGER[f'{folder}/long.py'] = 'because'
    assert sizes.too_long(tmp_path) == []
    path.write_text('pass\n')
    assert sizes.too_long(tmp_path) == [
        f'{folder}/long.py: expected no entry in LONGER, got -1 lines'
    ]


def test_the_table_adds_up(sizes: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert sizes.main([]) == 0
    head, _, *rows = [
        line.strip('| ').split(' | ') for line in capsys.readouterr().out.splitlines()
    ]
    assert head == ['room', 'modules', 'code', 'imports', 'docstrings', 'comments', 'all']
    numbers = [[int(cell) for cell in row[1:]] for row in rows]
    assert rows[-1][0] == 'package'
    assert [sum(column) for column in zip(*numbers[:-1], strict=True)] == numbers[-1]
