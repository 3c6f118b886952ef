# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Who may arm a driver and start a schedule: one operator, by a token, in two steps.

The operator asks for a token, shows with heartbeats that carry it that a process of theirs is
there and that the enable is held, and confirms.  From then on token, heartbeat and schedules
belong to this operator, and end together.

A token keeps strangers from acting by mistake.  Whoever can listen on the network can read it:
against intent there is only a secured network (SROS2).

Heartbeats: one counts if its stamp has moved on and does not lag.

The sender's clock and the driver's need not agree and may be set while they run: what counts is
that stamps move on, and that the way of a message takes hardly longer than the shortest so far.

The end of another process on this machine, which the kernel reports at once.

A heartbeat tells that a process has ended only after the longest silence that is allowed to it.
"""

import contextlib
import hmac
import os
import secrets
import select
import threading
from pathlib import Path
from typing import NamedTuple

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, nanoseconds
from rpms_ros.stimulation.limits.limiter import Refused
from rpms_ros.stimulation.records.clocks import read_boot_id
from rpms_ros.stimulation.schedule.fields import LONGEST_NAME

AUTHORITY = 'authority'


class Beat(NamedTuple):
    """One heartbeat of an operator.

    Attributes
    ----------
    token : str
        What the driver gave the operator.
    stamp_ns : int
        When it was sent, on the sender's clock [ns].
    enable : bool
        Whether the operator holds the enable.
    source : bytes
        Identity of the publisher.
    """

    token: str
    stamp_ns: int
    enable: bool
    source: bytes


def operator_name(text: str) -> str:
    """Return the name of an operator; raise Refused if it is none."""
    name = text.strip(' ')
    if not name or len(name) > LONGEST_NAME or not name.isprintable():
        raise Refused(
            AUTHORITY, f'expected a name of 1 to {LONGEST_NAME} printable characters, got {text!r}'
        )
    return name


class Authority:
    """Holds the one operator; any thread may call it.

    Parameters
    ----------
    timeout_s : float
        Longest silence of the heartbeat [s].
    valid_s : float
        From the request of a token to its confirmation [s].

    Attributes
    ----------
    generation : int
        Number of this token, or of the time without one: another one after each change.
    operator : str
        Who has asked for a token or has armed; empty if nobody.
    confirmed : bool
        Whether an operator has armed.
    enabled : bool
        Whether the operator holds the enable, as the last heartbeat said.
    """

    def __init__(self, timeout_s: float, valid_s: float = 10.0) -> None:
        self.valid_s, self._timeout_s = valid_s, timeout_s
        self._lock = threading.RLock()
        self.generation = self._until_ns = self._quickest_ns = 0
        self.operator = self._token = self._doubt = ''
        self.confirmed = self.enabled = False
        self._last: Beat | None = None
        self._seen_ns: int | None = None
        self._forget_beats()

    def request(self, operator: str, now_ns: int) -> str:
        """Return a new token for an operator.

        Raises
        ------
        Refused
            If somebody else has armed or has asked just before, or the name is none.
        """
        name = operator_name(operator)
        with self._lock:
            pending = bool(self._token) and now_ns <= self._until_ns
            if self.confirmed or (pending and name != self.operator):
                raise Refused(AUTHORITY, f'expected no other operator, got {self.operator}')
            self.operator, self._token = name, secrets.token_hex(16)
            self._until_ns = now_ns + nanoseconds(self.valid_s)
            self._forget_beats()
            return self._token

    def beat(self, beat: Beat, now_ns: int) -> str | None:
        """Take a heartbeat; return why it does not count, None if it does."""
        with self._lock:
            if not self._is_token(beat.token):
                return 'expected a heartbeat with the token of the operator, got another one'
            if self._last is not None and beat.source != self._last.source:
                self._doubt = 'expected one process with this token, got heartbeats of two'
                return self._doubt
            if self._last is not None and beat.stamp_ns <= self._last.stamp_ns:
                return 'expected a heartbeat after the last one, got one that repeats or goes back'
            took_ns = now_ns - beat.stamp_ns
            if self._last is None or took_ns < self._quickest_ns:
                self._quickest_ns = took_ns
            late_s = (took_ns - self._quickest_ns) / NANOSECONDS_PER_SECOND
            if late_s > self._timeout_s:
                most = f'expected a heartbeat of at most {self._timeout_s:g} s ago'
                return f'{most}, got one of {late_s:.3g} s'
            self._last = beat
            # whoever has armed and lets go arms again, also if it was for one heartbeat only
            held = self.enabled or not self.confirmed
            self._seen_ns, self.enabled = now_ns, beat.enable and held
            return None

    def confirm(self, operator: str, token: str, now_ns: int) -> None:
        """Note that this operator has armed.

        Raises
        ------
        Refused
            If the token is not the one that was given, or too old, or the heartbeat or the
            enable is missing.
        """
        with self._lock:
            self._require_token(operator, token)
            if not self.confirmed and now_ns > self._until_ns:
                raise Refused(
                    AUTHORITY,
                    f'expected the confirmation within {self.valid_s:g} s of the request, '
                    'got it later',
                )
            if (problem := self.problem(now_ns)) is not None:
                raise Refused(AUTHORITY, problem)
            self.confirmed = True

    def require(self, operator: str, token: str) -> None:
        """Raise Refused unless this is the operator who has armed."""
        with self._lock:
            self._require_token(operator, token)
            if not self.confirmed:
                raise Refused(AUTHORITY, f'expected {operator} to have armed, got no confirmation')

    def problem(self, now_ns: int) -> str | None:
        """Return why the operator does not keep the driver armed, None if they do."""
        with self._lock:
            silence = self._silence(now_ns)
            if silence is None and not self.enabled:
                return f'expected {self.operator} to hold the enable, got it released'
            return silence

    def _silence(self, now_ns: int) -> str | None:
        """Return why the operator counts as gone, None if they are there; the lock is held."""
        if self._doubt:
            return self._doubt
        if self._seen_ns is None:
            return f'expected a heartbeat of {self.operator or "an operator"}, got none yet'
        if now_ns - self._seen_ns > nanoseconds(self._timeout_s):
            return (
                f'expected a heartbeat of {self.operator} within {self._timeout_s:g} s, '
                f'got none for {(now_ns - self._seen_ns) / 1e9:.3g} s'
            )
        return None

    def released_enable(self, now_ns: int) -> bool:
        """Return whether nothing is wrong except that the operator has released the enable."""
        with self._lock:
            return self._silence(now_ns) is None and not self.enabled

    def release(self) -> None:
        """Release the operator: the token is no longer accepted."""
        with self._lock:
            self.operator = self._token = ''
            self.confirmed = False
            self._forget_beats()

    def _forget_beats(self) -> None:
        self.generation += 1
        # the newest that counts, when it came, and how long the quickest one took
        self._last = self._seen_ns = None
        self._quickest_ns = 0
        self.enabled = False
        self._doubt = ''

    def _require_token(self, operator: str, token: str) -> None:
        if not self._is_token(token) or operator.strip(' ') != self.operator:
            held = f'that of {self.operator}' if self.operator else 'one that was asked for'
            raise Refused(AUTHORITY, f'expected operator and token: {held}, got another one')

    def _is_token(self, token: str) -> bool:
        # an unpaired surrogate cannot be encoded, and is in no token
        given = token.encode('utf-8', 'replace')
        return bool(self._token) and hmac.compare_digest(given, self._token.encode())


def host_identity() -> str:
    """Return what is the same for two processes that can name each other by process id."""
    try:
        return f'{read_boot_id()} {Path("/proc/self/ns/pid").readlink()}'
    except (StimulationError, OSError):
        return ''


class ProcessLife:
    """Watches one process; used by one thread at a time; use `close` in the end.

    Parameters
    ----------
    host : str
        What `host_identity` is there.
    process : int
        Its id there.
    """

    def __init__(self, host: str, process: int) -> None:
        self.known, self._descriptor = False, -1
        if process > 0 and host and host == host_identity():
            self.known = True
            # a process that is gone already stays at -1
            with contextlib.suppress(OSError):
                self._descriptor = os.pidfd_open(process)

    @property
    def ended(self) -> bool:
        """Whether the process is known to have ended."""
        if not self.known or self._descriptor < 0:
            return self.known
        poll = select.poll()
        poll.register(self._descriptor, select.POLLIN)
        return bool(poll.poll(0))

    def close(self) -> None:
        """Stop watching; afterwards no end is seen."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self.known, self._descriptor = False, -1
