# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Exact variable projection on sums over the samples between pulses."""
