# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The process beside the driver that holds the serial port of a stimulator and disarms it.

Standard library only: it is started without `site`, so that nothing of an environment runs in it.
"""
