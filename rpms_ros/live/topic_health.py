# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is heard of a topic and why not, as the page can carry it: valid JSON of bounded length."""

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from rpms_ros.printable import counted

LONGEST_TEXT = 300
MOST_NAMES = 60
_DIGITS = 5
# The largest double is infinite with five digits, which JSON does not have.
_LARGEST = 1e300


def number(value: float) -> float | None:
    """Return a number with five digits, None if it is not finite or beyond `_LARGEST`."""
    value = float(value)
    return float(f'{value:.{_DIGITS}g}') if abs(value) <= _LARGEST else None


def numbers(values: Iterable[float]) -> list[float | None]:
    """Return what `number` makes of each."""
    return [number(value) for value in values]


def text(value: object) -> str:
    """Return a text without control characters, cut where it is too long."""
    shown = ''.join(sign if sign.isprintable() else ' ' for sign in str(value)[: LONGEST_TEXT + 1])
    return shown if len(shown) <= LONGEST_TEXT else f'{shown[:LONGEST_TEXT]} …'


OK, QUIET, SILENT, NEVER = 'ok', 'quiet', 'silent', 'never'
# Seconds over which a rate is counted.
_SPAN = 3.0


class Publisher(NamedTuple):
    """A publisher of a topic: the name of its node, the type of its messages."""

    node: str
    type_name: str


class Topic:
    """Counts what comes on a topic and tells what is wrong with it.

    Parameters
    ----------
    name, type_name : str
        Of the topic.
    longest_silence : float
        Silence after which it counts as silent [s]; infinite where silence says nothing.
    seldom : bool
        Whether it may come at any period, and is silent after three of them then.
    """

    def __init__(
        self, name: str, type_name: str, longest_silence: float, seldom: bool = False
    ) -> None:
        self.name, self.type_name, self._seldom = name, type_name, seldom
        self.count = 0
        self.refused = ''
        self._longest_silence = longest_silence
        # None before the graph was looked at
        self.publishers: Sequence[Publisher] | None = None
        # when it was heard, and the last two distances [s]
        self._heard = self._apart = self._before = 0.0
        # when it came, how many there were then, and the stamp of the newest
        self._recent: deque[tuple[float, int, int]] = deque()

    def heard(self, count: int, now: float, stamp_ns: int = 0) -> None:
        """Note messages that have come at `now` [s], the newest of them stamped `stamp_ns`."""
        if count:
            self._apart, self._before = now - self._heard, self._apart
            self.count += count
            self._heard = now
            self._recent.append((now, self.count, stamp_ns))
        while self._recent and self._recent[0][0] < now - _SPAN:
            self._recent.popleft()

    def rate(self, now: float) -> float:
        """Return messages a second [Hz] by their stamps, by their arrival if those stand still."""
        if len(self._recent) < 2 or self.state(now) != OK:
            return 0.0
        (came, before, stamp_ns), (newest, count, newest_ns) = self._recent[0], self._recent[-1]
        span = (newest_ns - stamp_ns) * 1e-9 if newest_ns > stamp_ns else newest - came
        return (count - before) / span if span > 0.0 else 0.0

    def age(self, now: float) -> float:
        """Return how long nothing has come [s]."""
        return now - self._heard

    def state(self, now: float) -> str:
        """Return `OK`, `QUIET`, `SILENT` or `NEVER`."""
        if not self.count:
            return NEVER
        if self.age(now) <= min(self._longest_silence, _SPAN):
            return OK
        longest = max(self._longest_silence, 3.0 * min(self._apart, self._before) * self._seldom)
        return SILENT if self.age(now) > longest else QUIET

    def view(self, now: float) -> dict[str, Any]:
        """Return what the page shows."""
        return {
            'name': text(self.name),
            'state': self.state(now),
            'count': self.count,
            'refused': bool(self.refused),
            'rate': number(round(self.rate(now), 1)),
            'text': text('; '.join(self._words(now))),
        }

    def _words(self, now: float) -> list[str]:
        state = self.state(now)
        words = [self._why_never()] if state == NEVER else []
        publishers = self.publishers or ()
        if what := {SILENT: 'silent', QUIET: 'nothing'}.get(state):
            words.append(f'{what} for {self.age(now):.0f} s')
            if self.publishers is not None and not publishers:
                words.append('nobody publishes it any more')
        if self.refused:
            words.append(f'not shown: {self.refused}')
        if len(publishers) > 1:
            names = ', '.join(sorted(one.node for one in publishers))
            words.append(f'{len(publishers)} publishers: {names}')
        return words

    def _why_never(self) -> str:
        if others := {one.type_name for one in self.publishers or ()} - {self.type_name}:
            return f'expected type {self.type_name}, got {", ".join(sorted(others))}'
        if not self.publishers:
            return f'nobody publishes it; expected type {self.type_name}'
        return f'{counted(len(self.publishers), "publisher")}, but nothing has come yet'
