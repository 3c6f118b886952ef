# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One publisher of a topic is listened to: the first, until it has been silent for long."""

# So many others are told apart; a flood of further ones is not remembered.
_MOST = 64


class FirstPublisher:
    """Tells whose messages count.

    A publisher that starts anew, as a driver after a crash, is another one: it is listened to when
    it has gone on for `silence_ns` by its own stamps and nothing came from the former meanwhile.

    Parameters
    ----------
    silence_ns : int
        How long the publisher that is listened to has to be silent [ns].
    """

    def __init__(self, silence_ns: int) -> None:
        self._silence_ns = silence_ns
        self._identity: bytes | None = None
        self._others: dict[bytes, int] = {}

    def counts(self, identity: bytes, stamp_ns: int) -> bool:
        """Return whether a message, next in the order of arrival, is from that publisher."""
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
