# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One page on many recordings: of several people, or of one person over weeks."""

from rpms_ros.report.group.document import group_document
from rpms_ros.report.group.page import as_group_page

__all__ = ['as_group_page', 'group_document']
