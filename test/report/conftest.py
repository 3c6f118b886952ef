# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What tests of reports share."""

from collections.abc import Callable
from types import ModuleType

import pytest


@pytest.fixture(scope='session')
def made_up(beside: Callable[[str], ModuleType]) -> ModuleType:
    """The module of made-up estimates: `estimate`, `session_of`."""
    return beside('made_up_estimates')
