# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that are there as a whole or not at all."""

import os
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from rpms_ros.errors import RecordingError


def written_whole(place: Path, write: Callable[[Path], object]) -> None:
    """Write a file or folder beside its place and move it there when it is complete.

    Parameters
    ----------
    place : Path
        Where it goes; there must be nothing yet.
    write : callable
        Is given the path to write.

    Raises
    ------
    RecordingError
        If there is something already, or it cannot be written.
    """
    if os.path.lexists(place):
        raise RecordingError(f'expected nothing at {place} yet, got something')
    parent = place.resolve().parent
    try:
        parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix='.rpms-', dir=parent) as folder:
            made = Path(folder) / place.name
            write(made)
            if not made.is_dir():
                # a rename would replace a file that has come meanwhile without a word
                place.touch(exist_ok=False)
            made.replace(place)
    except OSError as error:
        raise RecordingError(f'expected to write {place}, got {error}') from error
