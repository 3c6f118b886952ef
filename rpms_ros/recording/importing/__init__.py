# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of laboratories as pulses and forces: reading, guessing what is what, converting."""

from rpms_ros.recording.importing.signals import Ambiguous, ImportOptions
from rpms_ros.recording.importing.whole_file import Imported, import_file, is_foreign

__all__ = ['Ambiguous', 'ImportOptions', 'Imported', 'import_file', 'is_foreign']
