# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether messages of a topic are received, and why not."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rpms_ros.live.numbers import number
from rpms_ros.live.numbers import text

OK, QUIET, SILENT, NEVER = 'ok', 'quiet', 'silent', 'never'
# Seconds over which a rate is counted.
_SPAN = 3.0


@dataclass(frozen=True)
class Endpoint:
    """A publisher or subscription of a topic, as the graph has it.

    Attributes
    ----------
    node : str
        Name of its node.
    type_name : str
        Type of its messages.
    publishes : bool
        Whether it is a publisher.
    reliable, transient_local : bool
        What it offers or asks for.
    """

    node: str
    type_name: str
    publishes: bool
    reliable: bool = True
    transient_local: bool = False


class Topic:
    """Counts what comes on a topic and tells what is wrong with it.

    Parameters
    ----------
    name, type_name : str
        Of the topic.
    longest_silence : float
        Silence after which it counts as silent [s]; infinite where silence says nothing.
    """

    def __init__(self, name: str, type_name: str, longest_silence: float) -> None:
        self.name = name
        self.type_name = type_name
        self.count = 0
        self.refused = ''
        self._longest_silence = longest_silence
        self._endpoints: tuple[Endpoint, ...] = ()
        self._looked = False
        self._heard = 0.0
        self._recent: deque[tuple[float, int]] = deque()

    def heard(self, count: int, now: float) -> None:
        """Note messages that have come at `now` [s]."""
        if count:
            self.count += count
            self._heard = now
            self._recent.append((now, count))
        while self._recent and self._recent[0][0] < now - _SPAN:
            self._recent.popleft()

    def endpoints(self, endpoints: Sequence[Endpoint]) -> None:
        """Take over who publishes and hears it."""
        self._endpoints = tuple(endpoints)
        self._looked = True

    def rate(self, now: float) -> float:
        """Return messages a second [Hz]."""
        if not self._recent:
            return 0.0
        span = min(_SPAN, max(now - self._recent[0][0], 0.5))
        return sum(count for _, count in self._recent) / span

    def state(self, now: float) -> str:
        """Return `OK`, `QUIET`, `SILENT` or `NEVER`."""
        if not self.count:
            return NEVER
        if now - self._heard <= min(self._longest_silence, _SPAN):
            return OK
        return SILENT if now - self._heard > self._longest_silence else QUIET

    def view(self, now: float) -> dict[str, Any]:
        """Return what the page shows."""
        return {
            'name': text(self.name),
            'type': self.type_name,
            'state': self.state(now),
            'count': self.count,
            'refused': bool(self.refused),
            'rate': number(round(self.rate(now), 1)),
            'text': text('; '.join(self._words(now))),
        }

    def _words(self, now: float) -> list[str]:
        state = self.state(now)
        words = []
        if state == NEVER:
            words.append(self._why_never())
        elif state == SILENT:
            words.append(f'silent for {now - self._heard:.0f} s')
        elif state == QUIET:
            words.append(f'nothing for {now - self._heard:.0f} s')
        if state in (SILENT, QUIET) and self._looked and not self._publishers:
            words.append('nobody publishes it any more')
        if self.refused:
            words.append(f'not shown: {self.refused}')
        if len(self._publishers) > 1:
            names = ', '.join(sorted(one.node for one in self._publishers))
            words.append(f'{len(self._publishers)} publishers: {names}')
        return words + mismatches(self._endpoints)

    @property
    def _publishers(self) -> list[Endpoint]:
        return [one for one in self._endpoints if one.publishes]

    def _why_never(self) -> str:
        others = {one.type_name for one in self._publishers} - {self.type_name}
        if others:
            return f'expected type {self.type_name}, got {", ".join(sorted(others))}'
        if not self._publishers:
            return f'nobody publishes it; expected type {self.type_name}'
        count = len(self._publishers)
        return f'{count} publisher{"s" * (count > 1)}, but nothing has come yet'


def mismatches(endpoints: Sequence[Endpoint]) -> list[str]:
    """Return, in words, which nodes do not hear a publisher because of the quality of service.

    A node that hears it through another subscription is not named.
    """
    publishers = [one for one in endpoints if one.publishes]
    listeners: dict[str, list[Endpoint]] = {}
    for one in endpoints:
        if not one.publishes:
            listeners.setdefault(one.node, []).append(one)
    words = []
    for publisher in publishers:
        for node, subscriptions in listeners.items():
            reasons = [_mismatch(publisher, one) for one in subscriptions]
            if reasons[0] and all(reasons):
                words.append(f'{node} does not hear {publisher.node}: it {reasons[0]}')
    return words


def _mismatch(publisher: Endpoint, subscription: Endpoint) -> str:
    if subscription.reliable and not publisher.reliable:
        return 'asks for reliable, best effort is offered'
    if subscription.transient_local and not publisher.transient_local:
        return 'asks for transient local, volatile is offered'
    return ''
