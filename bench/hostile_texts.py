# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Hostile texts against the reading of schedules: 10,000 from a grammar and from bytes.

Every one has to give a schedule or a StimulationError.  Prints how many of each, the slowest text
and the memory that was needed; exit code 1 if anything else was raised.
"""

import argparse
import resource
import sys
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from hostile_texts import hostile_texts

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import schedule_from_text


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--count', type=int, default=10_000)
    parser.add_argument('--seed', type=int, default=0)
    arguments = parser.parse_args()
    came: Counter[str] = Counter()
    slowest, longest = 0.0, ''
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for text in hostile_texts(arguments.count, arguments.seed):
        begun = time.perf_counter()
        try:
            schedule_from_text(text)
            came['accepted'] += 1
        except StimulationError:
            came['refused'] += 1
        except Exception as error:  # noqa: BLE001 - this is what is looked for
            came['broken'] += 1
            print(f'{type(error).__name__}: {text[:200]!r}')
        took = time.perf_counter() - begun
        if took > slowest:
            slowest, longest = took, text[:40]
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    print(
        f'{arguments.count} hostile texts: {came["refused"]} refused with a reason, '
        f'{came["accepted"]} accepted, {came["broken"]} broken; '
        f'slowest {slowest:.2f} s ({longest!r}...), memory +{grown:.0f} MiB'
    )
    return 1 if came['broken'] else 0


if __name__ == '__main__':
    sys.exit(main())
