# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The audit log of a driver: what a train depends on is written first, the rest beside it.

Arming and schedules are on the disk before anything follows from them.  Refusals, stops and
resets are written by a thread of their own, so that nobody can hold the executor up with goals
that are refused; of too many at once some are counted only.
"""

import queue
import threading
from collections.abc import Callable
from pathlib import Path

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.audit_log import AuditLog

_WAITING = 500
_JOIN_S = 5.0
# how often the file is looked at while there is nothing to write
_LOOK_S = 0.2

Entry = tuple[str, dict[str, object]]


class DriverAudit:
    """Writes for one driver; does nothing where no file is named.

    Parameters
    ----------
    path : str
        Of the log; empty for none.
    failed : callable
        Told once why the log cannot be written any more.

    Raises
    ------
    StimulationError
        If the log cannot be opened.
    """

    def __init__(self, path: str, failed: Callable[[str], None]) -> None:
        self._log = AuditLog(Path(path).expanduser()) if path else None
        self._failed = failed
        self._lock = threading.Lock()
        self._broken = ''
        self._left_out = 0
        self._entries: queue.Queue[Entry | None] = queue.Queue(_WAITING)
        self._thread = threading.Thread(target=self._run, name='audit', daemon=True)
        if self._log is not None:
            self._thread.start()

    def require(self, kind: str, **fields: object) -> None:
        """Write an entry before this returns.

        Raises
        ------
        StimulationError
            If it cannot be written.
        """
        if self._broken:
            raise StimulationError(self._broken)
        self._append(kind, fields)

    def note(self, kind: str, **fields: object) -> None:
        """Have an entry written soon."""
        if self._log is None:
            return
        try:
            self._entries.put_nowait((kind, fields))
        except queue.Full:
            self._left_out += 1

    def close(self) -> None:
        """Write what is left, and close the file."""
        if self._log is None:
            return
        if self._thread.is_alive():
            self._entries.put(None)
            self._thread.join(_JOIN_S)
        self._log.close()

    def _run(self) -> None:
        try:
            while self._step():
                pass
        except StimulationError as error:
            self._broken = f'expected an audit log that can be written, got {error}'
            self._failed(self._broken)

    def _step(self) -> bool:
        """Write what comes next, or look at the file; return whether there is more to come."""
        try:
            entry = self._entries.get(timeout=_LOOK_S)
        except queue.Empty:
            if self._log is not None:
                self._log.look()
            return True
        if entry is not None:
            kind, fields = entry
            left_out, self._left_out = self._left_out, 0
            self._append(kind, {**fields, **({'left_out': left_out} if left_out else {})})
        return entry is not None

    def _append(self, kind: str, fields: dict[str, object]) -> None:
        if self._log is not None:
            with self._lock:
                self._log.append(kind, **fields)
