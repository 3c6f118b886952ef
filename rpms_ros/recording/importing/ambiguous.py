# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The error for what cannot be guessed of a file."""

from collections.abc import Sequence

from rpms_ros.errors import RecordingError


class Ambiguous(RecordingError):
    """More than one signal, or none, could be what is looked for.

    Attributes
    ----------
    option : str
        The option that decides.
    candidates : tuple of str
        Names to choose from.
    decided : tuple of (str, str)
        What was guessed before it came to this, and why.
    """

    def __init__(self, message: str, option: str, candidates: Sequence[str]) -> None:
        super().__init__(message)
        self.option = option
        self.candidates = tuple(candidates)
        self.decided: tuple[tuple[str, str], ...] = ()
