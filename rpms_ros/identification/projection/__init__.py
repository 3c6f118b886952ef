# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Exact variable projection on sums that are kept a pulse, not on samples."""
