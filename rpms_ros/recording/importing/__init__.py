# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of laboratories as pulses and forces: reading, guessing what is what, converting."""

from rpms_ros.recording.importing.guess import Guess, guess_by
from rpms_ros.recording.importing.signals import (
    Ambiguous,
    Events,
    ImportOptions,
    Signal,
    SignalFile,
)
from rpms_ros.recording.importing.whole_file import (
    Imported,
    import_file,
    is_foreign,
    read_csv,
    read_signals,
)

__all__ = [
    'Ambiguous',
    'Events',
    'Guess',
    'ImportOptions',
    'Imported',
    'Signal',
    'SignalFile',
    'guess_by',
    'import_file',
    'is_foreign',
    'read_csv',
    'read_signals',
]
