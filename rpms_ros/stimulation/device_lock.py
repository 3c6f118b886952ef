# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One driver for one device: a lock on this machine that ends with the process that holds it."""

import contextlib
import fcntl
import os
import re
import tempfile
from pathlib import Path

from rpms_ros.errors import StimulationError

_SHARED = Path('/run/lock')


def _folder() -> Path:
    return _SHARED if os.access(_SHARED, os.W_OK) else Path(tempfile.gettempdir())


class DeviceLock:
    """Keeps every other driver on this machine from the device.

    Parameters
    ----------
    device : str
        What is driven: the path of its port, links followed, or another name.
    folder : Path, optional
        Where locks are; the machine's own folder for them if not given.
    """

    def __init__(self, device: str, folder: Path | None = None) -> None:
        port = os.path.realpath(device) if device.startswith('/') else device
        name = re.sub(r'[^A-Za-z0-9]+', '_', port).strip('_')
        self.path = (folder or _folder()) / f'rpms_ros_{name}.lock'
        self._device = device
        self._descriptor: int | None = None

    def take(self) -> None:
        """Take the device.

        Raises
        ------
        StimulationError
            If another driver has it, or the lock cannot be made.
        """
        if self._descriptor is not None:
            return
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        try:
            descriptor = os.open(self.path, flags, 0o666)
        except OSError as error:
            raise StimulationError(
                f'expected a lock for device {self._device}, got {error}'
            ) from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.pread(descriptor, 64, 0).decode('ascii', 'replace').strip()
            os.close(descriptor)
            raise StimulationError(
                f'expected device {self._device} free, got another driver on it: '
                f'process {holder or "unknown"}'
            ) from error
        with contextlib.suppress(OSError):
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, str(os.getpid()).encode(), 0)
        self._descriptor = descriptor

    def release(self) -> None:
        """Let go of the device."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
