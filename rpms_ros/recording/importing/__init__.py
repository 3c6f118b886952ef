# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of laboratories as pulses and forces: reading, guessing what is what, converting."""

from rpms_ros.recording.importing.ambiguous import Ambiguous
from rpms_ros.recording.importing.conversion import ImportChoices
from rpms_ros.recording.importing.conversion import converted
from rpms_ros.recording.importing.guess import Guess
from rpms_ros.recording.importing.guess import guessed
from rpms_ros.recording.importing.reader import read_signals
from rpms_ros.recording.importing.signals import Events
from rpms_ros.recording.importing.signals import Signal
from rpms_ros.recording.importing.signals import SignalFile
from rpms_ros.recording.importing.whole_file import Imported
from rpms_ros.recording.importing.whole_file import ImportOptions
from rpms_ros.recording.importing.whole_file import guess_by
from rpms_ros.recording.importing.whole_file import import_file
from rpms_ros.recording.importing.whole_file import is_foreign

__all__ = [
    'Ambiguous',
    'Events',
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
    'read_signals',
]
