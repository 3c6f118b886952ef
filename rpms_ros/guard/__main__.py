# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Run the guard: ``python -m rpms_ros.guard``, or this folder by its path without `site`."""

import sys
from pathlib import Path

if not __package__:
    # started by path: this folder stands where the one that holds `rpms_ros` belongs
    sys.path[0] = str(Path(__file__).resolve().parents[2])

from rpms_ros.guard.process import main

sys.exit(main())
