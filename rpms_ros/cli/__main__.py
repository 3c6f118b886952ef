# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``python -m rpms_ros.cli``."""

import sys

from rpms_ros.cli import main

if __name__ == '__main__':
    sys.exit(main())
