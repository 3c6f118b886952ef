# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The end of another process on this machine, which the kernel reports at once.

A heartbeat tells that a process has ended only after the longest silence that is allowed to it.
"""

import contextlib
import os
import select
from pathlib import Path

_BOOT = Path('/proc/sys/kernel/random/boot_id')
_PROCESSES = Path('/proc/self/ns/pid')


def host_identity() -> str:
    """Return what is the same for two processes that can name each other by process id."""
    try:
        return f'{_BOOT.read_text().strip()} {_PROCESSES.readlink()}'
    except OSError:
        return ''


class ProcessLife:
    """Watches one process; use `close` in the end.

    Parameters
    ----------
    host : str
        What `host_identity` is there.
    process : int
        Its id there.
    """

    def __init__(self, host: str, process: int) -> None:
        self.descriptor = -1
        self.known = False
        if process > 0 and host and host == host_identity():
            self.known = True
            # a process that is gone already stays at -1
            with contextlib.suppress(OSError):
                self.descriptor = os.pidfd_open(process)

    @property
    def ended(self) -> bool:
        """Whether the process is known to have ended."""
        # in the reverse of the order of `close`, which another thread may call
        descriptor, known = self.descriptor, self.known
        if not known:
            return False
        if descriptor < 0:
            return True
        poll = select.poll()
        poll.register(descriptor, select.POLLIN)
        return bool(poll.poll(0))

    def close(self) -> None:
        """Stop watching; afterwards no end is seen."""
        self.known = False
        descriptor, self.descriptor = self.descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)
