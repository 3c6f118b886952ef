# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""pytest plugin: the packages under test are those installed below RPMS_INSTALL, no others."""

import importlib
import os
from pathlib import Path

import pytest


def pytest_configure() -> None:
    """Import both packages, which settles for the whole process where they come from."""
    root = Path(os.environ['RPMS_INSTALL']).resolve()
    for name in ('rpms_ros', 'rpms_msgs'):
        file = importlib.import_module(name).__file__
        if file is None or not Path(file).resolve().is_relative_to(root):
            raise pytest.UsageError(f'expected {name} from {root}, got {file}')
