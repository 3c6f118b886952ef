# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sessions as files of other programs: CSV, MATLAB and BIDS, which `rpms import` reads again."""

from rpms_ros.recording.export.bids import BidsNames, write_bids
from rpms_ros.recording.export.content import EstimateTable, SessionExport
from rpms_ros.recording.export.reading import is_export, read_export
from rpms_ros.recording.export.tables import write_matlab, write_tables, written_whole

__all__ = [
    'BidsNames',
    'EstimateTable',
    'SessionExport',
    'is_export',
    'read_export',
    'write_bids',
    'write_matlab',
    'write_tables',
    'written_whole',
]
