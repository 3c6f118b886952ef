# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Clocks of this machine for what has to outlive a process: monotonic, since boot, and wall time.

Only the time since boot survives a restart of the process without being set by anybody, and only
the wall clock survives a restart of the machine; ``boot_id`` tells the two apart.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from rpms_ros.errors import StimulationError

# Linux alone has it; elsewhere a sleep is not seen.
_BOOT_CLOCK = getattr(time, 'CLOCK_BOOTTIME', time.CLOCK_MONOTONIC)
_BOOT_ID, _MACHINE_ID = Path('/proc/sys/kernel/random/boot_id'), Path('/etc/machine-id')
# Before this software existed [ns since 1970]: a wall clock that says so has not been set.
EARLIEST_WALL_NS = 1_735_689_600 * 1_000_000_000


@cache
def read_boot_id() -> str:
    """Return ``machine/boot``: this boot of this machine, which no process outlives.

    Raises
    ------
    StimulationError
        If the operating system does not tell.
    """
    try:
        machine = _MACHINE_ID.read_text(encoding='ascii').strip() if _MACHINE_ID.exists() else ''
        return f'{machine}/{_BOOT_ID.read_text(encoding="ascii").strip()}'
    except (OSError, UnicodeDecodeError) as fault:
        raise StimulationError(f'expected a boot identifier in {_BOOT_ID}, got {fault}') from fault


def _since_boot_ns() -> int:
    return time.clock_gettime_ns(_BOOT_CLOCK)


def slept_ns() -> int:
    """Return for how long the machine has slept since its start [ns], at most.

    A thread that waits between the two readings makes it smaller, never larger.
    """
    return _since_boot_ns() - time.monotonic_ns()


@dataclass(frozen=True)
class Clocks:
    """Three clocks [ns] and the boot that they belong to.

    Attributes
    ----------
    monotonic_ns : callable
        Never set, stands still while the machine sleeps; the clock of pulses.
    boot_ns : callable
        Since the machine was started, sleep included.
    wall_ns : callable
        Since 1970, in UTC; may be set at any time.
    boot_id : callable
        Another text after every start of the machine, whose name is in front of a slash.
    """

    monotonic_ns: Callable[[], int] = time.monotonic_ns
    boot_ns: Callable[[], int] = _since_boot_ns
    wall_ns: Callable[[], int] = time.time_ns
    boot_id: Callable[[], str] = read_boot_id

    def age_ns(self, boot_id: str, boot_ns: int, wall_ns: int) -> int:
        """Return how long ago something was, at least [ns].

        Parameters
        ----------
        boot_id : str
            Boot in which it happened.
        boot_ns : int
            When, since that boot [ns].
        wall_ns : int
            When, on the wall clock [ns].

        Returns
        -------
        int
            Within one boot the time since boot decides, whatever was done to the wall clock.
            Across boots it is at least the time since this boot if the machine is the same; the
            wall clock may add to that only where it had been set both times.
        """
        if boot_id == (own := self.boot_id()):
            return max(0, self.boot_ns() - boot_ns)
        same, now = boot_id.rpartition('/')[0] == own.rpartition('/')[0], self.wall_ns()
        certain = self.boot_ns() if same else 0
        return certain if min(now, wall_ns) < EARLIEST_WALL_NS else max(certain, now - wall_ns)
