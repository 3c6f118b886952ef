# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report of one session: identification, its quality, and the page that shows them."""

from rpms_ros.report.session.analysis import SessionAnalysis, analyse
from rpms_ros.report.session.document import as_document
from rpms_ros.report.session.figures import FIGURES, write_figures
from rpms_ros.report.session.page import as_page

__all__ = [
    'FIGURES',
    'SessionAnalysis',
    'analyse',
    'as_document',
    'as_page',
    'write_figures',
]
