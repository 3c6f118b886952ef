# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a device, a patient and a coil may be asked for, and the limiter that enforces it."""
