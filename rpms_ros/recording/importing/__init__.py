# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of laboratories as pulses and forces: reading, guessing what is what, converting."""

from rpms_ros.recording.importing.conversion import ImportChoices, converted
from rpms_ros.recording.importing.gates import GateSettings
from rpms_ros.recording.importing.guess import Guess, guessed
from rpms_ros.recording.importing.signals import Ambiguous, Events, Signal, SignalFile
from rpms_ros.recording.importing.whole_file import (
    Imported,
    ImportOptions,
    guess_by,
    import_file,
    is_foreign,
    read_csv,
    read_signals,
)

__all__ = [
    'Ambiguous',
    'Events',
    'GateSettings',
    'Guess',
    'ImportChoices',
    'ImportOptions',
    'Imported',
    'Signal',
    'SignalFile',
    'converted',
    'guess_by',
    'guessed',
    'import_file',
    'is_foreign',
    'read_csv',
    'read_signals',
]
