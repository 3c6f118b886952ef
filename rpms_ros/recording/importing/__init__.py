# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of laboratories as pulses and forces: reading, guessing what is what, converting."""

from rpms_ros.recording.importing.conversion import ImportChoices
from rpms_ros.recording.importing.conversion import converted
from rpms_ros.recording.importing.gates import GateSettings
from rpms_ros.recording.importing.guess import Guess
from rpms_ros.recording.importing.guess import guessed
from rpms_ros.recording.importing.signals import Ambiguous
from rpms_ros.recording.importing.signals import Events
from rpms_ros.recording.importing.signals import Signal
from rpms_ros.recording.importing.signals import SignalFile
from rpms_ros.recording.importing.whole_file import Imported
from rpms_ros.recording.importing.whole_file import ImportOptions
from rpms_ros.recording.importing.whole_file import guess_by
from rpms_ros.recording.importing.whole_file import import_file
from rpms_ros.recording.importing.whole_file import is_foreign
from rpms_ros.recording.importing.whole_file import read_csv
from rpms_ros.recording.importing.whole_file import read_signals

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
