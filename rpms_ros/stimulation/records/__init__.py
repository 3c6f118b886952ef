# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What outlives a driver's process: audit log, dose ledger, clocks."""
