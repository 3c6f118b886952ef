# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a recording that is explained by one muscle was that of one muscle."""
