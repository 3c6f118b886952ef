# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Of several publishers of a topic only the first is used, until it has been silent for long."""

# Further publishers than so many are not remembered.
_MOST = 64


class FirstPublisher:
    """Decides which messages are used.

    A publisher that restarts, as a driver after a crash, is another one: it is used once it has
    sent for `silence_ns` by its own stamps and nothing came from the former one meanwhile.

    Parameters
    ----------
    silence_ns : int
        How long the present publisher has to be silent [ns].
    """

    def __init__(self, silence_ns: int) -> None:
        self._silence_ns = silence_ns
        self._identity: bytes | None = None
        self._others: dict[bytes, int] = {}

    def counts(self, identity: bytes, stamp_ns: int) -> bool:
        """Return whether the next message in the order of arrival is to be used."""
        if identity == self._identity:
            self._others.clear()
            return True
        if self._identity is None:
            self._identity = identity
            return True
        if len(self._others) < _MOST:
            self._others.setdefault(identity, stamp_ns)
        if abs(stamp_ns - self._others.get(identity, stamp_ns)) <= self._silence_ns:
            return False
        self._identity = identity
        self._others.clear()
        return True
