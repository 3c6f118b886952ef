# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Open a serial port exclusively."""

import contextlib
import fcntl
import os
import termios

import serial

from rpms_ros.guard import rapid2


def open_port(name: str) -> int:
    """Return the descriptor of a serial port, opened exclusively with the instrument's settings.

    Raises
    ------
    OSError
        If there is no such port, or somebody holds it.
    """
    port = serial.Serial(baudrate=rapid2.BAUD, timeout=0, write_timeout=0, exclusive=True)
    port.port = name
    # on some cables this line is a trigger
    port.rts = False
    try:
        port.open()
        # a lock is asked for by who knows of it; this keeps the others out, but for root
        with contextlib.suppress(OSError):
            fcntl.ioctl(port.fileno(), termios.TIOCEXCL)
        port.reset_input_buffer()
        # a copy: it shares the lock, and stays when the object goes
        descriptor = os.dup(port.fileno())
    except (ValueError, termios.error) as error:
        raise OSError(str(error)) from error
    finally:
        port.close()
    os.set_blocking(descriptor, False)
    return descriptor


def release_port(descriptor: int) -> None:
    """Let others open the port again; the lock ends with its last descriptor."""
    with contextlib.suppress(OSError):
        fcntl.ioctl(descriptor, termios.TIOCNXCL)
