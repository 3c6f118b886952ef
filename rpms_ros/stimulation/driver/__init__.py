# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver apart from ROS: states, the owner of the device, interlocks, authority."""
