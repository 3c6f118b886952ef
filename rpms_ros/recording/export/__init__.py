# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sessions as files of other programs: CSV, MATLAB and BIDS, which `rpms import` reads again."""

from rpms_ros.recording.export.bids import BidsNames, write_bids
from rpms_ros.recording.export.tables import (
    EstimateTable,
    SessionExport,
    write_matlab,
    write_tables,
    written_whole,
)

__all__ = [
    'BidsNames',
    'EstimateTable',
    'SessionExport',
    'write_bids',
    'write_matlab',
    'write_tables',
    'written_whole',
]
