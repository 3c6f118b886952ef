# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The dose ledger: 100 random kills, how long a reservation takes, how long an old ledger is read.

Prints one line each; exit code 1 if more was fired than the dose, or less counted than was fired.
"""

import argparse
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

import numpy as np
from ledger_kills import dose_of, kill_repeatedly

from rpms_ros.stimulation.limits.limiter import BookedPulse
from rpms_ros.stimulation.records.dose_ledger import DoseLedger

BATCH = 20


def kills(count: int, pulses: int, folder: Path) -> bool:
    found = kill_repeatedly(folder, count, pulses)
    dose = dose_of(pulses)
    print(
        f'{found.kills} kills, {found.exhausted} ends by the dose: fired {found.fired} pulses and '
        f'{found.fired_j:.0f} J, counted {found.counted} and {found.counted_j:.0f} J, '
        f'dose {dose.pulses} and {dose.energy_j:.0f} J'
    )
    within = found.counted <= dose.pulses and found.counted_j <= dose.energy_j
    return within and found.fired <= found.counted and found.fired_j <= found.counted_j


def reservations(count: int, folder: Path) -> None:
    with closing(DoseLedger(folder, 'coil', 'P01')) as ledger:
        took = []
        for _ in range(count):
            plan = [BookedPulse(time.monotonic_ns(), 0.45, 51.03)] * BATCH
            begun = time.perf_counter()
            numbers = ledger.reserve(plan)
            took.append(time.perf_counter() - begun)
            for number in numbers:
                ledger.take(number)
    milliseconds = np.array(took) * 1e3
    print(
        f'{count} reservations of {BATCH} pulses: median {np.median(milliseconds):.2f} '
        f'p99 {np.percentile(milliseconds, 99):.2f} max {milliseconds.max():.2f} ms'
    )
    size = sum(path.stat().st_size for path in folder.iterdir()) / (count * BATCH)
    begun = time.perf_counter()
    DoseLedger(folder, 'coil', 'P01').close()
    rate = count * BATCH / (time.perf_counter() - begun)
    print(f'{size:.0f} bytes a pulse in both ledgers; {rate:,.0f} pulses read a second')


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--kills', type=int, default=100)
    parser.add_argument('--pulses', type=int, default=1500)
    parser.add_argument('--reservations', type=int, default=2000)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        good = kills(arguments.kills, arguments.pulses, Path(name) / 'kills')
        reservations(arguments.reservations, Path(name) / 'time')
    return 0 if good else 1


if __name__ == '__main__':
    sys.exit(main())
