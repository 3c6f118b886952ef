# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The live page: what a browser shows of a running session.

Nothing of ROS is imported here: a node hands over what it hears, see `rpms_ros.nodes.live_page`.
"""
