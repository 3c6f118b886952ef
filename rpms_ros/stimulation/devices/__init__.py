# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stimulators behind one small interface, `registry.Device`."""
