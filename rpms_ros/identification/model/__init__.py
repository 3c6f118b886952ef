# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The identified model: basis, summation, physiology, and the algebra of its fits."""
