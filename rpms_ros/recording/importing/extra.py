# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Packages that only some formats need."""

from collections.abc import Callable
from typing import Any

from rpms_ros.errors import RecordingError


def needed(load: Callable[[str], Any], package: str, what: str) -> Any:
    """Return a package that reading `what` needs.

    Raises
    ------
    RecordingError
        If it is not installed.
    """
    try:
        return load(package)
    except ModuleNotFoundError as error:
        raise RecordingError(
            f'expected {package} for {what}, got {error}: '
            "python3 -m pip install 'rpms_ros[formats]' installs it"
        ) from error
