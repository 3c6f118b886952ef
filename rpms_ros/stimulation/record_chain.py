# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Chains of records: one JSON object a line, each with the hash of the one before it.

A process that is killed can leave one line cut off; the record after it says so, with the hash of
what was cut.  Anything else that does not fit the chain (a flipped bit, a line changed, removed
or put in) is refused with the line where it was found.
"""

import hashlib
import hmac
import json
import re
from collections.abc import Iterator
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC
from datetime import datetime
from datetime import timedelta
from pathlib import Path
from typing import Any
from typing import NamedTuple

from rpms_ros.errors import StimulationError

FIRST = '0' * 64
"""What stands for the hash before the first record."""
BEGIN, TORN = 'begin', 'torn'
LONGEST_LINE = 1_000_000
_TAIL = re.compile(rb',"previous":"([0-9a-f]{64})","hash":"([0-9a-f]{64})"\}\Z')


class ChainError(StimulationError):
    """A file does not hold the chain that it should.

    Attributes
    ----------
    line : int
        Where, from 1; 0 for the file as a whole.
    """

    def __init__(self, path: Path, line: int, fault: str) -> None:
        super().__init__(f'{path}: line {line}: {fault}' if line else f'{path}: {fault}')
        self.line = line


class Record(NamedTuple):
    """One line.

    Attributes
    ----------
    line : int
        Where it stands, from 1.
    content : mapping
        ``number``, ``kind``, ``time`` (UTC), ``boot_id``, ``boot_ns`` and what was appended.
    """

    line: int
    content: Mapping[str, Any]


@dataclass
class Chain:
    """What a file of records holds, while it is read and after.

    Attributes
    ----------
    path : Path
        Of the file.
    purpose : str or None
        What its first record has to say that it is for; None for any.
    key : bytes or None
        Secret of the hashes; None for plain SHA-256.
    hash : str
        Of the newest record.
    count : int
        Number of records.
    lines : int
        Number of lines, those cut off included.
    torn : bytes
        What stands behind the last whole line.
    """

    path: Path
    purpose: str | None = None
    key: bytes | None = None
    hash: str = FIRST
    count: int = 0
    lines: int = 0
    torn: bytes = b''

    def records(self) -> Iterator[Record]:
        """Yield every record, oldest first.

        Raises
        ------
        ChainError
            At the first line that does not fit.
        """
        cut: bytes | None = None
        for line in self._lines():
            found = self._record(line)
            if cut is not None and not _explains(found, cut):
                raise self._fault(self.lines - 1, 'expected the next record of the chain')
            if found is None and cut is None:
                cut = line
                continue
            cut = None
            if found is not None:
                yield Record(self.lines, found)
        if cut is not None:
            raise self._fault(self.lines, 'expected the next record of the chain')

    def _lines(self) -> Iterator[bytes]:
        """Yield the whole lines; keep what is left behind the last."""
        try:
            with self.path.open('rb') as file:
                while line := file.readline(LONGEST_LINE):
                    if not line.endswith(b'\n'):
                        if len(line) == LONGEST_LINE:
                            raise self._fault(self.lines + 1, 'expected a shorter line')
                        self.torn = line
                        return
                    self.lines += 1
                    yield line[:-1]
        except OSError as fault:
            raise ChainError(self.path, 0, f'expected a readable file, got {fault}') from fault

    def _record(self, line: bytes) -> dict[str, Any] | None:
        """Return the record of a line if it is the next one, None if it is not."""
        content = decoded(line, self.hash, self.key)
        if content is None or content.get('number') != self.count:
            return None
        if self.count == 0 and not self._begins(content):
            raise self._fault(self.lines, f'expected a file of kind {self.purpose}')
        self.count += 1
        self.hash = content['hash']
        return content

    def _begins(self, content: Mapping[str, Any]) -> bool:
        return content.get('kind') == BEGIN and self.purpose in (None, content.get('purpose'))

    def _fault(self, line: int, expected: str) -> ChainError:
        hint = ' or was made with another key' if self.count == 0 else ''
        return ChainError(
            self.path, line, f'{expected}, got a line that is not record {self.count}{hint}'
        )


def encoded(content: Mapping[str, Any], previous: str, key: bytes | None) -> tuple[bytes, str]:
    """Return the line of a record, and its hash.

    Raises
    ------
    StimulationError
        If the content cannot be written as JSON.
    """
    try:
        text = json.dumps(
            {**content, 'previous': previous}, separators=(',', ':'), allow_nan=False
        )
    except (TypeError, ValueError, RecursionError) as fault:
        raise StimulationError(f'expected a record that JSON can hold, got {fault}') from fault
    body = text.encode('ascii')
    digest = _digest(body, key)
    return body[:-1] + f',"hash":"{digest}"}}\n'.encode('ascii'), digest


def decoded(line: bytes, previous: str, key: bytes | None) -> dict[str, Any] | None:
    """Return the record of a line if it is whole and follows ``previous``, None if not."""
    tail = _TAIL.search(line)
    if tail is None or tail[1].decode('ascii') != previous:
        return None
    body = line[: tail.end(1) + 1] + b'}'
    if not hmac.compare_digest(_digest(body, key), tail[2].decode('ascii')):
        return None
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def _digest(body: bytes, key: bytes | None) -> str:
    if key is None:
        return hashlib.sha256(body).hexdigest()
    return hmac.new(key, body, hashlib.sha256).hexdigest()


def _explains(found: Mapping[str, Any] | None, cut: bytes) -> bool:
    """Return whether a record says that the line before it was cut off just so."""
    if not cut or found is None or found.get('kind') not in (BEGIN, TORN):
        return False
    return all(found.get(name) == value for name, value in explanation(cut).items())


def utc(wall_ns: int) -> str:
    """Return a time of the wall clock [ns] as text, to the microsecond."""
    since = timedelta(microseconds=wall_ns // 1000)
    moment = datetime(1970, 1, 1, tzinfo=UTC) + since
    return moment.isoformat(timespec='microseconds').replace('+00:00', 'Z')


def wall_ns_of(text: str) -> int:
    """Return the time of the wall clock [ns] that `utc` wrote."""
    since = datetime.fromisoformat(text) - datetime(1970, 1, 1, tzinfo=UTC)
    return since // timedelta(microseconds=1) * 1000


def explanation(torn: bytes) -> dict[str, Any]:
    """Return what a record says of the line before it that was cut off; empty for none."""
    if not torn:
        return {}
    return {'bytes': len(torn), 'sha256': hashlib.sha256(torn).hexdigest()}
