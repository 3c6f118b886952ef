# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""ROS nodes: parameters, topics, clocks, life cycle.  Only this part imports rclpy."""
