# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether an estimate can be trusted: doubts, verdict."""
