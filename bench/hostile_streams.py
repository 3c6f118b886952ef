# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Hostile streams into every estimator: wrong curves with an interval, and whether one is told.

Two publishers, spikes, sensors that are clipped, frozen or dead, gaps, clocks that are set, lost
and forged pulses: the kinds of `test/hostile_streams.py`, each with several seeds.  An estimate is
wrong if its interval excludes the true curve and the curve is off by more than 5 % of its height
there; it is doubted if it has `doubts`.  A clean stream goes first.  Estimates of the first ten
seconds do not count.

python bench/hostile_streams.py [--seeds 5] [--seconds 25] [--estimator NAME] [--kind TEXT]
"""

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

import hostile_streams as streams

from rpms_ros.identification import StreamSettings, estimator_by_name, identify
from rpms_ros.identification.catalogue import estimator_names

SETTLED_NS = 10 * streams.SECOND
CLEAN = 'nothing wrong'


def tried(name: str, kind: str, seed: int, arguments: argparse.Namespace) -> tuple[int, ...]:
    """Return estimates, wrong ones, wrong ones without a doubt, and whether the fault is missing.

    The last number is the largest error without a doubt, in thousandths.
    """
    own = streams.session(seed, arguments.seconds)
    if kind != CLEAN:
        own = streams.KINDS[kind].spoil(own, streams.session(seed + 1000, arguments.seconds, 0.5))
    settings = StreamSettings(estimate_period=arguments.period)
    estimator = estimator_by_name(name)
    found = identify(estimator, own.pulses, own.forces, settings, None, own.before)
    settled = [
        one for one in found.estimates[:-1] if one.stamp_ns - found.stamp_ns[0] >= SETTLED_NS
    ]
    errors = [
        (streams.wrong_by(one, streams.true_curve(one.curve_intensity)), bool(one.doubts))
        for one in (*settled, found.last)
    ]
    unnoticed = [error for error, doubted in errors if error > streams.WRONG and not doubted]
    missing = kind != CLEAN and not found.last.faults.get(streams.KINDS[kind].fault)
    return (
        len(errors),
        sum(error > streams.WRONG for error, _ in errors),
        len(unnoticed),
        int(missing),
        round(1000 * max(unnoticed, default=0.0)),
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=5)
    parser.add_argument('--first-seed', type=int, default=1)
    parser.add_argument('--seconds', type=int, default=25)
    parser.add_argument('--period', type=float, default=0.5, help='of the estimates [s]')
    parser.add_argument('--estimator', action='append', help='one of the catalogue; all')
    parser.add_argument('--kind', default='', help='those whose name has this text')
    arguments = parser.parse_args()
    names = arguments.estimator or estimator_names()
    kinds = [kind for kind in (CLEAN, *streams.KINDS) if arguments.kind in kind]
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    bad = 0
    print(f'{"":34}{"estimator":12}{"estimates":>10}{"wrong":>7}{"unnoticed":>10}{"worst":>8}')
    for name in names:
        begun = time.monotonic()
        totals = [0, 0, 0]
        for kind in kinds:
            rows = [tried(name, kind, seed, arguments) for seed in seeds]
            count, wrong, unnoticed, missing, _ = (
                sum(column) for column in zip(*rows, strict=True)
            )
            worst = max(row[-1] for row in rows) / 1000
            totals = [
                old + new for old, new in zip(totals, (count, wrong, unnoticed), strict=True)
            ]
            bad += unnoticed + missing
            if wrong or missing:
                unnamed = f'  {missing} without its fault' if missing else ''
                print(
                    f'{kind:34}{name:12}{count:10d}{wrong:7d}{unnoticed:10d}{worst:8.2f}{unnamed}',
                    flush=True,
                )
        print(
            f'{f"all {len(kinds)} kinds":34}{name:12}{totals[0]:10d}{totals[1]:7d}{totals[2]:10d}'
            f'{"":8}  {time.monotonic() - begun:.0f} s',
            flush=True,
        )
    return 1 if bad else 0


if __name__ == '__main__':
    sys.exit(main())
