# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimation of a muscle that changes: slow change, sudden change, disturbance, dynamics."""
