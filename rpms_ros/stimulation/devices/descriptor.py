# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A descriptor that several threads hold and none of them closes while another uses it."""

import contextlib
import os


class Descriptor:
    """A descriptor that is closed when no thread holds it any more.

    `silence` uses one while another thread closes the line: without a lock, which it would have
    to wait for, it must not write to a number that meanwhile stands for something else.
    """

    def __init__(self, number: int) -> None:
        self.number = number

    def __del__(self) -> None:
        with contextlib.suppress(OSError):
            os.close(self.number)
