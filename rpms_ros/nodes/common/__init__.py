# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What every node shares: parameters, quality of service, topics, life of the process."""
