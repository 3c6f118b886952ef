# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Scripts of the folder tools as modules; they have no ending."""

import importlib.util
from importlib.machinery import SourceFileLoader
from pathlib import Path

import pytest


@pytest.fixture
def tool():
    """Load a fresh module from a script of tools/."""

    def load(name):
        loader = SourceFileLoader(name, str(Path(__file__).parents[2] / 'tools' / name))
        specification = importlib.util.spec_from_loader(name, loader)
        assert specification is not None
        module = importlib.util.module_from_spec(specification)
        loader.exec_module(module)
        return module

    return load
