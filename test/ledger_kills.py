# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A process that reserves pulses and fires them, and is killed at random moments, many times.

What it fired it notes in a file, one line a pulse, right when it would trigger the device; that
the kill cannot take back.  Whatever happens, the fired pulses of all processes together must stay
within the dose, and the ledger must count at least what was fired.
"""

import os
import random
import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from rpms_ros.stimulation.limits.limiter import BookedPulse, DoseExceeded, DoseLimits
from rpms_ros.stimulation.records.dose_ledger import DoseLedger

EXHAUSTED = 7


class Tally(NamedTuple):
    """What came of it.

    Attributes
    ----------
    kills, exhausted : int
        Processes that were killed, and that ended because the dose was given.
    fired, counted : int
        Pulses fired by all of them, and counted by the ledger at the end.
    fired_j, counted_j : float
        Their energy [J].
    """

    kills: int
    exhausted: int
    fired: int
    counted: int
    fired_j: float
    counted_j: float


def dose_of(pulses: int) -> DoseLimits:
    """Return a dose that some kills do not use up, by pulses or by energy."""
    return DoseLimits(pulses, 6.0 * pulses, 24.0)


def stimulate(folder: Path, pulses: int, seed: int) -> int:
    """Reserve, fire and give back at random until the dose is given."""
    chance = random.Random(seed)
    fired = os.open(folder / 'fired', os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    with closing(DoseLedger(folder / 'ledgers', 'coil', 'P01', dose_of(pulses))) as ledger:
        print('open', flush=True)
        while True:
            count = chance.randrange(1, 12)
            now = time.monotonic_ns()
            plan = [BookedPulse(now, 0.5, float(chance.randrange(1, 10))) for _ in range(count)]
            try:
                numbers = ledger.reserve(plan)
            except DoseExceeded:
                return EXHAUSTED
            given = chance.randrange(count + 1)
            for number, pulse in zip(numbers[:given], plan[:given], strict=True):
                ledger.take(number)
                os.write(fired, f'{pulse.energy_j:g}\n'.encode())
            if chance.random() < 0.7:
                ledger.settle()


def kill_repeatedly(folder: Path, kills: int, pulses: int, seed: int = 0) -> Tally:
    """Start the process above and kill it, ``kills`` times; return what came of it."""
    chance = random.Random(seed)
    folder.mkdir(parents=True, exist_ok=True)
    killed = exhausted = 0
    while killed < kills:
        command = [
            sys.executable,
            __file__,
            str(folder),
            str(pulses),
            str(chance.randrange(2**31)),
        ]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            if chance.random() < 0.8:
                # most kills while it fires, some while it starts and reads its ledgers
                process.stdout.readline()
                time.sleep(chance.uniform(0.0, 0.1))
            else:
                time.sleep(chance.uniform(0.0, 0.5))
            process.send_signal(signal.SIGKILL)
        exhausted += process.returncode == EXHAUSTED
        killed += process.returncode == -signal.SIGKILL
        assert process.returncode in (EXHAUSTED, -signal.SIGKILL)
    notes = folder / 'fired'
    energies = [float(line) for line in notes.read_text().split()] if notes.exists() else []
    with closing(DoseLedger(folder / 'ledgers', 'coil', 'P01', dose_of(pulses))) as ledger:
        counted = ledger.totals()
    return Tally(killed, exhausted, len(energies), counted.pulses, sum(energies), counted.energy_j)


if __name__ == '__main__':
    sys.exit(stimulate(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])))
