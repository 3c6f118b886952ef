# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that are only appended to, the audit log and the dose ledgers: records in a chain.

One JSON object a line, each with the hash of the one before it, on the disk before `append`
returns; nothing is ever removed.  One process at a time has such a file open.  A process that is
killed can leave one line cut off; it stays where it is, and the record after it says so, with the
hash of what was cut.  Anything else that does not fit the chain (a flipped bit, a line changed,
removed or put in) is refused with the line where it was found.
"""

import fcntl
import hashlib
import json
import os
import re
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.records.clocks import Clocks

AUDIT_LOG = 'audit log'
"""Purpose of a log of who did what, with which limits, what was refused, what was reset."""
FIRST = '0' * 64
"""What stands for the hash before the first record."""
BEGIN, TORN = 'begin', 'torn'
LONGEST_LINE = 1_000_000
_TAIL = re.compile(rb',"previous":"([0-9a-f]{64})","hash":"([0-9a-f]{64})"\}\Z')


class ChainError(StimulationError):
    """A file does not hold the chain that it should, at a line from 1 or, with 0, as a whole."""

    def __init__(self, path: Path, line: int, fault: str) -> None:
        super().__init__(f'{path}: line {line}: {fault}' if line else f'{path}: {fault}')


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
    hash : str
        Of the newest record: written down elsewhere, it shows whether the end was removed.
    count : int
        Number of records.
    lines : int
        Number of lines, those cut off included.
    torn : bytes
        What stands behind the last whole line.
    """

    path: Path
    purpose: str | None = None
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
            cut = line if found is None else None
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
        content = decoded(line, self.hash)
        if content is None or content.get('number') != self.count:
            return None
        begins = content.get('kind') == BEGIN and self.purpose in (None, content.get('purpose'))
        if self.count == 0 and not begins:
            raise self._fault(self.lines, f'expected a file of kind {self.purpose}')
        self.count += 1
        self.hash = content['hash']
        return content

    def _fault(self, line: int, said: str) -> ChainError:
        return ChainError(self.path, line, f'{said}, got a line that is not record {self.count}')


def encoded(content: Mapping[str, Any], previous: str) -> tuple[bytes, str]:
    """Return the line of a record, and its hash.

    Raises
    ------
    StimulationError
        If the content cannot be written as JSON.
    """
    try:
        raw = json.dumps({**content, 'previous': previous}, separators=(',', ':'), allow_nan=False)
    except (TypeError, ValueError, RecursionError) as fault:
        raise StimulationError(f'expected a record that JSON can hold, got {fault}') from fault
    body = raw.encode('ascii')
    digest = hashlib.sha256(body).hexdigest()
    return body[:-1] + f',"hash":"{digest}"}}\n'.encode('ascii'), digest


def decoded(line: bytes, previous: str) -> dict[str, Any] | None:
    """Return the record of a line if it is whole and follows ``previous``, None if not."""
    tail = _TAIL.search(line)
    if tail is None or tail[1].decode('ascii') != previous:
        return None
    if hashlib.sha256(line[: tail.end(1) + 1] + b'}').hexdigest() != tail[2].decode('ascii'):
        return None
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def _explains(found: Mapping[str, Any] | None, cut: bytes) -> bool:
    """Return whether a record says that the line before it was cut off just so."""
    if not cut or found is None or found.get('kind') not in (BEGIN, TORN):
        return False
    return all(found.get(name) == value for name, value in explanation(cut).items())


def utc(wall_ns: int) -> str:
    """Return a time of the wall clock [ns] as text, to the microsecond."""
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=wall_ns // 1000)
    return moment.isoformat(timespec='microseconds').replace('+00:00', 'Z')


def wall_ns_of(text: str) -> int:
    """Return the time of the wall clock [ns] that `utc` wrote."""
    since = datetime.fromisoformat(text) - datetime(1970, 1, 1, tzinfo=UTC)
    return since // timedelta(microseconds=1) * 1000


def explanation(torn: bytes) -> dict[str, Any]:
    """Return what a record says of the line before it that was cut off; empty for none."""
    return {'bytes': len(torn), 'sha256': hashlib.sha256(torn).hexdigest()} if torn else {}


class ChainedFile:
    """An open file of records, locked: nobody else can open it for writing meanwhile.

    Parameters
    ----------
    path : Path
        Of the file; made if it is not there, together with its folder.
    purpose : str
        What it is for; a file for something else is refused.
    clocks : Clocks
        Whose time the records carry.
    read : callable, optional
        Told every record that is there already.
    begin : mapping, optional
        What the first record of a new file says besides its purpose.

    Raises
    ------
    StimulationError
        If somebody else has it open, if it cannot be written, or (ChainError) if it is damaged.
    """

    def __init__(
        self,
        path: Path,
        purpose: str,
        clocks: Clocks | None = None,
        read: Callable[[Record], object] = bool,
        begin: Mapping[str, Any] | None = None,
    ) -> None:
        self.path, self.torn, self._cut_end = path, b'', b''
        self._clocks = clocks if clocks is not None else Clocks()
        self._boot_id = self._clocks.boot_id()
        self._lock = threading.Lock()
        self._broken: str | None = None
        self._file = _locked(path)
        try:
            chain = Chain(path, purpose)
            for record in chain.records():
                read(record)
            self._hash, self._count = chain.hash, chain.count
            self._size = os.fstat(self._file).st_size
            self._end_the_last(chain, read)
            if self._count == 0:
                self.append(BEGIN, {'purpose': purpose, **(begin or {}), **explanation(self.torn)})
            elif self.torn:
                self.append(TORN, explanation(self.torn))
        except BaseException:
            self.close()
            raise

    def append(self, kind: str, fields: Mapping[str, Any], sync: bool = True) -> None:
        """Add a record; with ``sync`` it is on the disk when this returns.

        Parameters
        ----------
        kind : str
            What happened, in a word: ``session``, ``arm``, ``refusal``, ``reset`` ...
        fields : mapping
            What belongs to it, as JSON can hold it.
        sync : bool
            Whether to wait for the disk.

        Raises
        ------
        StimulationError
            If it cannot be written, or the file is not what was written so far (removed,
            replaced, cut short, added to); nothing more is written then until it is opened anew.
        """
        with self._lock:
            stamped = {
                'number': self._count,
                'kind': kind,
                'time': utc(self._clocks.wall_ns()),
                'boot_id': self._boot_id,
                'boot_ns': self._clocks.boot_ns(),
                **fields,
            }
            line, digest = encoded(stamped, self._hash)
            if len(line) >= LONGEST_LINE:
                fault = f'expected a record of less than {LONGEST_LINE} bytes, got {len(line)}'
                raise StimulationError(fault)
            # in one write: a line that was cut off and ended, but not explained, is damage
            self._write(self._cut_end + line, sync, (digest, self._count + 1, b''))

    def look(self) -> None:
        """Raise what `append` would raise now: of a file that was removed, or a full disk."""
        with self._lock:
            self._write(b'', False, (self._hash, self._count, self._cut_end))

    def close(self) -> None:
        """Close the file; may be called again."""
        with self._lock:
            self._broken = self._broken or 'a closed file'
            if self._file >= 0:
                os.close(self._file)
                self._file = -1

    def _write(self, data: bytes, sync: bool, after: tuple[str, int, bytes]) -> None:
        if self._broken is not None:
            raise StimulationError(f'expected a writable {self.path}, got {self._broken}')
        # what was written in part, or not synced, may or may not be there: no second try
        try:
            disk = os.fstatvfs(self._file)
            if disk.f_blocks and disk.f_bavail * disk.f_frsize < LONGEST_LINE:
                raise OSError(f'a disk with less than {LONGEST_LINE} bytes left')
            self._size += len(data)
            os.write(self._file, data)
            if sync:
                os.fsync(self._file)
            # after it: what is written now is known to be where the next opener reads it
            here, there = os.fstat(self._file), os.lstat(self.path)
            if (here.st_dev, here.st_ino) != (there.st_dev, there.st_ino):
                raise OSError('another file of that name')
            if here.st_size != self._size:
                raise OSError(f'{here.st_size} bytes in place of {self._size}')
            self._hash, self._count, self._cut_end = after
        except BaseException as fault:
            self._broken = str(fault) or repr(fault)
            if not isinstance(fault, OSError):
                raise
            raise StimulationError(f'expected a writable {self.path}, got {fault}') from fault

    def _end_the_last(self, chain: Chain, read: Callable[[Record], object]) -> None:
        """Have a line that was cut off end before the next record."""
        self._cut_end = b'\n' if chain.torn else b''
        content = decoded(chain.torn, self._hash)
        if content is not None and content.get('number') == self._count:
            # whole but for its end
            self._hash, self._count = content['hash'], self._count + 1
            read(Record(chain.lines + 1, content))
        else:
            self.torn = chain.torn


def _locked(path: Path) -> int:
    """Return the descriptor of a file that nobody else has locked."""
    file = -1
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o600)
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # the name of a new file has to be on the disk too
        folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
        if os.fstat(file).st_ino == path.stat().st_ino:
            return file
        fault = 'another file of that name meanwhile'
    except BlockingIOError:
        fault = 'it in use by another process'
    except OSError as error:
        fault = str(error)
    if file >= 0:
        os.close(file)
    raise StimulationError(f'expected {path} to write and lock, got {fault}')


class Audit(NamedTuple):
    """Records of a file, and what is wrong with them.

    Attributes
    ----------
    records : tuple of Record
        All of them up to the first broken one.
    fault : str
        What is wrong with the first broken record, and in which line; empty if the chain holds.
    torn : int
        Bytes behind the last whole line.
    hash : str
        Of the newest record.
    """

    records: tuple[Record, ...]
    fault: str
    torn: int
    hash: str


def verify_log(path: Path, purpose: str | None = AUDIT_LOG) -> Audit:
    """Return what a file of records holds, as far as its chain can be trusted.

    Parameters
    ----------
    path : Path
        Of an audit log, or of a dose ledger if ``purpose`` says so.
    purpose : str or None
        What it has to be for; None for either.
    """
    chain = Chain(path, purpose)
    found: list[Record] = []
    try:
        found.extend(chain.records())
        fault = '' if found else f'{path}: expected at least one record, got none'
    except ChainError as error:
        fault = str(error)
    return Audit(tuple(found), fault, len(chain.torn), chain.hash)
