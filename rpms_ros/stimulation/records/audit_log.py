# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Audit log: who did what, with which limits, what was refused, what was reset.

One JSON object a line, each with the hash of the one before it, on the disk before `append`
returns.  Nothing is ever removed from it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.records.append_only import Chain, ChainedFile, ChainError, Record

PURPOSE = 'audit log'
LONGEST_TEXT = 2000
MOST_ITEMS = 200
SHORTEST_KEY = 16
_DEEPEST = 6
_TAKEN = frozenset(
    {'number', 'kind', 'time', 'boot_id', 'boot_ns', 'previous', 'hash', 'bytes', 'sha256'}
)


class AuditLog:
    """An audit log that is open for writing; one process at a time.

    Parameters
    ----------
    path : Path
        Of the file; made if it is not there.
    key : bytes, optional
        Secret of the hashes (HMAC-SHA-256): without it nobody can forge a chain.

    Raises
    ------
    StimulationError
        If somebody else has it open, if it cannot be written, or if it is damaged.
    """

    def __init__(self, path: Path, key: bytes | None = None) -> None:
        self.path = path
        self._file = ChainedFile(path, PURPOSE, key)

    def append(self, kind: str, **fields: object) -> None:
        """Add a record; it is on the disk when this returns.

        Parameters
        ----------
        kind : str
            What happened, in a word: ``session``, ``arm``, ``refusal``, ``reset`` ...
        **fields
            What belongs to it: text, numbers, lists and mappings.  Text longer than 2000
            characters and lists longer than 200 are cut, and say so.

        Raises
        ------
        StimulationError
            If it cannot be written; nothing may be fired then.
        """
        wrong = sorted(_TAKEN.intersection(fields))
        if wrong:
            raise StimulationError(f'expected fields other than {", ".join(wrong)}')
        self._file.append([{'kind': kind, **{name: _plain(v) for name, v in fields.items()}}])

    def look(self) -> None:
        """Raise what `append` would raise now: of a file that was removed, or a full disk."""
        self._file.append([], sync=False)

    def close(self) -> None:
        """Close the file; may be called again."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _plain(value: object, depth: int = 0) -> Any:
    """Return a value as JSON can hold it, of bounded length: it may come from any sender."""
    if value is None or isinstance(value, bool | int):
        return value if not isinstance(value, int) or abs(value) < 2**63 else str(hex(value))[:80]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else str(value)
    if isinstance(value, str):
        more = len(value) - LONGEST_TEXT
        return value if more <= 0 else f'{value[:LONGEST_TEXT]} ... ({more} more characters)'
    if depth >= _DEEPEST:
        raise StimulationError(f'expected a field of at most {_DEEPEST} levels')
    if isinstance(value, Mapping):
        items = list(value.items())[:MOST_ITEMS]
        return {str(_plain(str(name))): _plain(item, depth + 1) for name, item in items}
    if isinstance(value, list | tuple | set | frozenset):
        ordered = sorted(value, key=str) if isinstance(value, set | frozenset) else list(value)
        cut = [_plain(item, depth + 1) for item in ordered[:MOST_ITEMS]]
        more = len(ordered) - MOST_ITEMS
        return cut if more <= 0 else [*cut, f'... ({more} more)']
    raise StimulationError(f'expected text, a number, a list or a mapping, got {value!r:.80}')


@dataclass(frozen=True)
class Audit:
    """Records of a file, and what is wrong with them.

    Attributes
    ----------
    records : tuple of Record
        All of them up to the first broken one.
    fault : str
        What is wrong with the first broken record; empty if the chain holds.
    line : int
        Where that is, from 1; 0 for none or the file as a whole.
    torn : int
        Bytes behind the last whole line.
    hash : str
        Of the newest record: written down elsewhere, it shows whether the end was removed.
    """

    records: tuple[Record, ...]
    fault: str
    line: int
    torn: int
    hash: str

    @property
    def intact(self) -> bool:
        """Whether every record fits."""
        return not self.fault


def read_key(path: Path) -> bytes:
    """Return the secret in a file, without the white space around it.

    Raises
    ------
    StimulationError
        If it cannot be read, is shorter than 16 bytes, or others may read it.
    """
    try:
        key = path.read_bytes().strip()
        mode = path.stat().st_mode
    except OSError as fault:
        raise StimulationError(f'expected a readable key file, got {path}: {fault}') from fault
    if len(key) < SHORTEST_KEY:
        raise StimulationError(f'expected a key of {SHORTEST_KEY} bytes or more, got {len(key)}')
    if mode & 0o077:
        raise StimulationError(f'expected a key file that only its owner can read, got {path}')
    return key


def verify_log(path: Path, key: bytes | None = None, purpose: str | None = PURPOSE) -> Audit:
    """Return what a file of records holds, as far as its chain can be trusted.

    Parameters
    ----------
    path : Path
        Of an audit log, or of a dose ledger if ``purpose`` says so.
    key : bytes, optional
        Secret of the hashes, if it was written with one.
    purpose : str or None
        What it has to be for; None for either.
    """
    chain = Chain(path, purpose, key)
    found: list[Record] = []
    try:
        found.extend(chain.records())
    except ChainError as fault:
        return Audit(tuple(found), str(fault), fault.line, len(chain.torn), chain.hash)
    if not found:
        empty = f'{path}: expected at least one record, got none'
        return Audit((), empty, 0, len(chain.torn), chain.hash)
    return Audit(tuple(found), '', 0, len(chain.torn), chain.hash)
