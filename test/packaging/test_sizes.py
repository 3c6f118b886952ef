# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The package does not grow: tools/sizes counts, and holds it against a ceiling."""

from collections.abc import Callable
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


def test_the_package_is_below_its_ceiling(
    sizes: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
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
