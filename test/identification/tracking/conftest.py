"""Sessions of a muscle that changes."""

from collections.abc import Callable
from types import ModuleType

import pytest


@pytest.fixture(scope='session')
def living_sessions(beside: Callable[[str], ModuleType]) -> ModuleType:
    """The module of sessions in the folder of all tests: `session`, `SUBJECT`."""
    return beside('living_sessions')
