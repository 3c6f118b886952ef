# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sessions as files of other programs: CSV, MATLAB and BIDS, which `rpms import` reads again."""

from rpms_ros.recording.exporting.bids import BidsNames
from rpms_ros.recording.exporting.bids import write_bids
from rpms_ros.recording.exporting.content import EstimateTable
from rpms_ros.recording.exporting.content import SessionExport
from rpms_ros.recording.exporting.reading import is_export
from rpms_ros.recording.exporting.reading import read_export
from rpms_ros.recording.exporting.tables import write_matlab
from rpms_ros.recording.exporting.tables import write_tables
from rpms_ros.recording.exporting.whole import written_whole

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
