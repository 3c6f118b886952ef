# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A word where something takes long."""

from collections.abc import Callable
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer

PATIENCE_S = 1.0
"""What takes longer is told."""


@contextmanager
def calling_if_slow(tell: Callable[[], object]) -> Iterator[None]:
    """Call `tell`, in a thread of its own, when what is done here takes longer than a second."""
    timer = Timer(PATIENCE_S, tell)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
