# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that are only appended to: records in a chain, on the disk before `append` returns.

One process at a time has such a file open.  A line that a killed process left cut off stays where
it is, and a record behind it says so.
"""

import fcntl
import os
import threading
from collections.abc import Callable
from collections.abc import Mapping
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.clocks import Clocks
from rpms_ros.stimulation.record_chain import BEGIN
from rpms_ros.stimulation.record_chain import LONGEST_LINE
from rpms_ros.stimulation.record_chain import TORN
from rpms_ros.stimulation.record_chain import Chain
from rpms_ros.stimulation.record_chain import Record
from rpms_ros.stimulation.record_chain import decoded
from rpms_ros.stimulation.record_chain import encoded
from rpms_ros.stimulation.record_chain import explanation
from rpms_ros.stimulation.record_chain import utc


class ChainedFile:
    """An open file of records, locked: nobody else can open it for writing meanwhile.

    Parameters
    ----------
    path : Path
        Of the file; made if it is not there, together with its folder.
    purpose : str
        What it is for; a file for something else is refused.
    key : bytes, optional
        Secret of the hashes, so that nobody without it can forge a chain.
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
        key: bytes | None = None,
        clocks: Clocks | None = None,
        read: Callable[[Record], object] = bool,
        begin: Mapping[str, Any] | None = None,
    ) -> None:
        self.path = path
        self.torn = b''
        self._key = key
        self._clocks = clocks if clocks is not None else Clocks()
        self._boot_id = self._clocks.boot_id()
        self._lock = threading.Lock()
        self._broken: str | None = None
        self._file = _locked(path)
        try:
            chain = Chain(path, purpose, key)
            for record in chain.records():
                read(record)
            self._hash, self._count = chain.hash, chain.count
            self._size = os.fstat(self._file).st_size
            self._mend(chain, read)
            if self._count == 0:
                first = {'kind': BEGIN, 'purpose': purpose, **(begin or {})}
                self.append([{**first, **explanation(self.torn)}])
                _sync_folder(path.parent)
            elif self.torn:
                self.append([{'kind': TORN, **explanation(self.torn)}])
        except BaseException:
            self.close()
            raise

    def append(self, contents: Sequence[Mapping[str, Any]], sync: bool = True) -> None:
        """Add records; with ``sync`` they are on the disk when this returns.

        Raises
        ------
        StimulationError
            If they cannot be written, or the file is not what was written so far (removed,
            replaced, cut short, added to); nothing more is written then until it is opened anew.
        """
        with self._lock:
            if self._broken is not None:
                raise StimulationError(f'expected a writable {self.path}, got {self._broken}')
            lines = []
            previous, number = self._hash, self._count
            for content in contents:
                line, previous = encoded(self._stamped(content, number), previous, self._key)
                if len(line) >= LONGEST_LINE:
                    raise StimulationError(
                        f'expected a record of less than {LONGEST_LINE} bytes, got {len(line)}'
                    )
                lines.append(line)
                number += 1
            self._write(b''.join(lines), sync)
            self._hash, self._count = previous, number

    def close(self) -> None:
        """Close the file; may be called again."""
        with self._lock:
            self._broken = self._broken or 'a closed file'
            if self._file >= 0:
                os.close(self._file)
                self._file = -1

    def _stamped(self, content: Mapping[str, Any], number: int) -> dict[str, Any]:
        return {
            'number': number,
            'kind': content['kind'],
            'time': utc(self._clocks.wall_ns()),
            'boot_id': self._boot_id,
            'boot_ns': self._clocks.boot_ns(),
            **content,
        }

    def _write(self, data: bytes, sync: bool) -> None:
        # what was written in part, or not synced, may or may not be there: no second try
        try:
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
            disk = os.fstatvfs(self._file)
            if disk.f_blocks and disk.f_bavail * disk.f_frsize < LONGEST_LINE:
                raise OSError(f'a disk with less than {LONGEST_LINE} bytes left')
        except OSError as fault:
            self._broken = str(fault)
            raise StimulationError(f'expected a writable {self.path}, got {fault}') from fault

    def _mend(self, chain: Chain, read: Callable[[Record], object]) -> None:
        """Append behind a line that was cut off."""
        if not chain.torn:
            return
        self._write(b'\n', sync=False)
        content = decoded(chain.torn, self._hash, self._key)
        if content is not None and content.get('number') == self._count:
            # whole but for the end of its line
            self._hash, self._count = content['hash'], self._count + 1
            read(Record(chain.lines + 1, content))
            return
        self.torn = chain.torn


def _locked(path: Path) -> int:
    """Return the descriptor of a file that nobody else has locked."""
    file = -1
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o600)
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
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


def _sync_folder(folder: Path) -> None:
    """Put the name of a new file on the disk."""
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
    except OSError as fault:
        raise StimulationError(f'expected a folder to write, got {folder}: {fault}') from fault
