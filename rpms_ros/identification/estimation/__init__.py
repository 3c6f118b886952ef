# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Exact estimation on sums over the samples between pulses: of everything, or of a window."""
