# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The guard's end of its driver's socket."""

import contextlib
import os

from rpms_ros.guard import packets
from rpms_ros.guard.packets import Packet

# More in one turn would keep the guard from the line.
_AT_ONCE = 100


class DriverGone(Exception):
    """The driver has left, or sends what no driver sends."""


class DriverSocket:
    """Packets of one driver, over a descriptor that does not block and keeps their boundaries.

    Parameters
    ----------
    descriptor : int
        Of the socket.
    """

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor

    def received(self) -> list[Packet]:
        """Return what the driver has sent, oldest first.

        Raises
        ------
        DriverGone
            If its end is closed, or if one of them is no packet.
        """
        received: list[Packet] = []
        while len(received) < _AT_ONCE:
            try:
                raw = os.read(self.descriptor, packets.MAXIMUM_PACKET + 1)
                if not raw:
                    raise DriverGone('the driver is gone')
                received.append(packets.unpacked(raw, packets.FROM_DRIVER))
            except BlockingIOError:
                break
            except OSError as error:
                raise DriverGone(f'the driver is gone: {error}') from error
            except ValueError as error:
                raise DriverGone(str(error)) from error
        return received

    def tell(self, kind: bytes, payload: bytes = b'', sequence: int = 0, time_ns: int = 0) -> None:
        """Send a packet; one that cannot be sent is dropped."""
        with contextlib.suppress(OSError):
            os.write(self.descriptor, packets.packed(Packet(kind, sequence, time_ns, payload)))
