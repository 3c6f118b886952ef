# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From messages to an estimator: order, alignment, sensor checks."""
