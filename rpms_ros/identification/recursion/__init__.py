# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recursion for people: one pass over the samples, a state of fixed size."""
