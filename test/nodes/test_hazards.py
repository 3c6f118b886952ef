# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""docs/hazards.md names tests that exist, and says what it does not claim."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / 'docs' / 'hazards.md').read_text()
NAMED = sorted(set(re.findall(r'`(test_\w+\.py)::(\w+)`', PAGE)))


@pytest.mark.parametrize(('file', 'test'), NAMED)
def test_a_test_that_is_named_exists(file: str, test: str) -> None:
    (path,) = (ROOT / 'test').rglob(file)
    assert re.search(rf'^def {test}\(', path.read_text(), re.MULTILINE)


def test_every_hazard_has_a_test() -> None:
    rows = [line for line in PAGE.splitlines() if line.startswith('| ') and '---' not in line]
    measures = [row for row in rows if not row.startswith('| hazard |')]
    assert len(measures) > 30
    assert all('`test_' in row for row in measures)


def test_no_conformity_is_claimed() -> None:
    assert 'claims no conformity' in PAGE
