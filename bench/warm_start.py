# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Time until the curve of a returning patient is right, with the last session and without it.

Pulses of random intensity at 20 Hz, 0.5 % noise, people drawn at random.  Last session: 20 s.
Today the threshold and saturation have moved by up to 0.01, the gain by up to 9 %, so that the
curve is within 10 % of the last one; or it is another person altogether (a wrong prior).

python bench/warm_start.py [--people 20] [--estimator tracking]
"""

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from rpms_ros.identification import CURVE_INTENSITY
from rpms_ros.identification import IdentificationStream
from rpms_ros.identification import StreamSettings
from rpms_ros.identification import checkpoint
from rpms_ros.identification import estimator_by_name
from rpms_ros.identification.warm_start import warm_start
from rpms_ros.muscle import Contraction
from rpms_ros.muscle import random_subject
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import PulseTrain

RATE = 20.0
MILLISECOND = 1_000_000
NOISE = 0.005
GOOD = 0.01
ENOUGH = 0.02
LAST_TIME = 20.0
TODAY = 5.0
PULSES = 10
PRESETS = {'horizon': ('paper_table_5',)}


def session(subject, seconds, generator, name, path=None):
    """Run a session; return the error of the curve every 50 ms (n,), and the stream."""
    count = int(seconds * RATE)
    pulses = PulseTrain.regular(generator.uniform(size=count), RATE)
    muscle = Contraction(subject)
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = MILLISECOND * np.arange(50 * count, dtype=np.int64)
    force = muscle.force(stamps)
    force = force + NOISE * subject.maximum_force * generator.standard_normal(len(force))
    estimator = estimator_by_name(name, *PRESETS.get(name, ()))
    if path is not None:
        warm_start(estimator, path)
    stream = IdentificationStream(estimator, StreamSettings(estimate_period=0.05))
    stream.add_pulses(pulses)
    stream.add_forces(ForceTrace(stamps, force))
    truth = subject.steady_force(CURVE_INTENSITY, RATE)
    errors = []
    for estimate in [*stream.advance(), *stream.finish()]:
        known = estimate.curve_known
        error = np.abs(estimate.curve_force - truth).max() / truth.max() if known else np.inf
        errors.append(error)
    return np.array(errors), stream


def first_below(errors, limit):
    """Return after how many pulses the error is below a limit for the first time."""
    below = np.flatnonzero(errors < limit)
    return float(below[0] + 1) if len(below) else np.inf


def stays_below(errors, limit):
    """Return after how many pulses the error stays below a limit; infinite if it never does."""
    above = np.flatnonzero(~(errors < limit))
    last = int(above[-1]) + 1 if len(above) else 0
    return float(last + 1) if last < len(errors) else np.inf


def changed(subject, generator):
    """Return the subject of another day, the curve within 10 %."""
    recruitment = subject.recruitment
    moved = replace(
        recruitment,
        threshold=recruitment.threshold + generator.uniform(-0.01, 0.01),
        saturation=recruitment.saturation + generator.uniform(-0.01, 0.01),
    ).normalised()
    gain = 1.0 + generator.uniform(-0.09, 0.09)
    return replace(subject, recruitment=moved, maximum_force=gain * subject.maximum_force)


def compared(person, name, path):
    """Return errors of a returning person, cold and warm, and of a stranger; and the change."""
    generator = np.random.default_rng(person)
    subject, other = random_subject(generator), random_subject(generator)
    _, stream = session(subject, LAST_TIME, generator, name)
    checkpoint.save(path, stream)
    today = changed(subject, generator)
    runs = [
        session(who, TODAY, np.random.default_rng(1000 + person), name, start)[0]
        for who in (today, other)
        for start in (None, path)
    ]
    before, after = (one.steady_force(CURVE_INTENSITY, RATE) for one in (subject, today))
    return runs, np.abs(after - before).max() / after.max()


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--people', type=int, default=20)
    parser.add_argument('--estimator', choices=('horizon', 'tracking'), default='horizon')
    arguments = parser.parse_args(argv)
    people, name = arguments.people, arguments.estimator
    with tempfile.TemporaryDirectory() as folder:
        found = [compared(person, name, Path(folder) / 'state') for person in range(people)]
    cold, warm, strange, wrong = zip(*(runs for runs, _ in found), strict=True)
    change = [one for _, one in found]
    print(
        f'{people} people, curves {np.median(change):.1%} from last time (most {max(change):.1%})'
    )
    print('pulses until the error of the curve is below 1 % for the first time, and for good')
    for kind, errors in (('cold', cold), ('warm', warm)):
        first = [first_below(one, GOOD) for one in errors]
        good = [stays_below(one, GOOD) for one in errors]
        print(
            f'  {kind:<5} first: median {np.median(first):3.0f}, worst {max(first):3.0f}   '
            f'for good: median {np.median(good):3.0f}, worst {max(good):3.0f}'
        )
    within = float(np.mean([first_below(one, GOOD) <= PULSES for one in warm]))
    print(f'  below 1 % within {PULSES} pulses: {within:.0%} of the returning (target: all)')
    after = [one[PULSES] for one in warm]
    print(f'  error after {PULSES} pulses: median {np.median(after):.2%}, worst {max(after):.2%}')
    later = [
        (stays_below(one, ENOUGH) - stays_below(other, ENOUGH)) / RATE
        for one, other in zip(wrong, strange, strict=True)
    ]
    print(
        f'a wrong prior costs {np.median(later):.2f} s until the error stays below 2 % '
        f'(median; worst {max(later):.2f} s; target 1 s)'
    )
    return 0 if within == 1.0 and max(later) <= 1.0 else 1


if __name__ == '__main__':
    sys.exit(main())
