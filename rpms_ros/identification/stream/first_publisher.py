# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Of several publishers of a topic only the first is used, until it has been silent for long."""

import numba
import numpy as np

from rpms_ros.pulses import BoolArray, IntArray

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


def counting(publisher: IntArray, stamp_ns: IntArray, silence_ns: int) -> BoolArray:
    """Return which messages count, as a `FirstPublisher` tells of one after the other.

    Parameters
    ----------
    publisher : ndarray of int64 (messages,)
        Numbers of the publishers, from 0 on, in the order of arrival.
    stamp_ns : ndarray of int64 (messages,)
        Stamps [ns].
    silence_ns : int
        As of `FirstPublisher` [ns].

    Returns
    -------
    ndarray of bool (messages,)
    """
    counts = np.ones(len(publisher), dtype=np.bool_)
    if len(publisher):
        _count(publisher, stamp_ns, silence_ns, int(publisher.max()) + 1, counts)
    return counts


@numba.njit(cache=True)
def _count(
    publisher: IntArray, stamp_ns: IntArray, silence_ns: int, publishers: int, counts: BoolArray
) -> None:
    since_ns = np.zeros(publishers, dtype=np.int64)
    # Those of the round that began when the publisher that is listened to was last heard.
    heard = np.full(publishers, -1, dtype=np.int64)
    turn = 0
    others = 0
    listened = publisher[0]
    for index in range(len(publisher)):
        here = publisher[index]
        stamp = stamp_ns[index]
        if here == listened:
            turn += 1
            others = 0
            continue
        if heard[here] != turn and others < _MOST:
            heard[here] = turn
            since_ns[here] = stamp
            others += 1
        since = since_ns[here] if heard[here] == turn else stamp
        # Any two stamps: their distance need not be one of 63 bits.
        away = np.uint64(max(stamp, since)) - np.uint64(min(stamp, since))
        if away <= np.uint64(silence_ns):
            counts[index] = False
        else:
            listened = here
            turn += 1
            others = 0
