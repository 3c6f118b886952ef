# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Time until the curve of a returning patient is right, with the last session and without it.

Pulses of random intensity at 20 Hz, 0.5 % noise, people drawn at random.  Last session: 20 s.
Today the threshold and saturation have moved by up to 0.01, the gain by up to 9 %, so that the
curve is within 10 % of the last one, and T_a by up to 3 %; or it is another person altogether (a
wrong prior).  Beside it the bound: an estimator that knows the muscle of last time, the model and
how much the four have changed at most, and has to find these four and a straight baseline.

python bench/warm_start.py [--people 20]
"""

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import rpms_ros
from rpms_ros.identification import (
    CURVE_INTENSITY,
    IdentificationStream,
    StreamSettings,
    estimator_by_name,
)
from rpms_ros.identification.estimation.prior import warm_start
from rpms_ros.muscle import Contraction, random_subject
from rpms_ros.pulses import ForceTrace, PulseTrain

RATE = 20.0
MILLISECOND = 1_000_000
NOISE = 0.005
GOOD = 0.01
ENOUGH = 0.02
LAST_TIME = 20.0
TODAY = 5.0
PULSES = 10
# How much threshold, saturation, gain and T_a change at most; a step to differentiate by them.
LARGEST = (0.01, 0.01, 0.09, 0.03)
STEP = 1e-4


def contraction(subject, pulses):
    """Return the stamps [ns] and the force [N] of a session without noise."""
    muscle = Contraction(subject)
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = MILLISECOND * np.arange(50 * len(pulses), dtype=np.int64)
    return stamps, muscle.force(stamps)


def drawn(subject, seconds, generator):
    """Return pulses, stamps [ns] and force with noise [N] of a session."""
    pulses = PulseTrain.regular(generator.uniform(size=int(seconds * RATE)), RATE)
    stamps, force = contraction(subject, pulses)
    noise = NOISE * subject.maximum_force * generator.standard_normal(len(force))
    return pulses, stamps, force + noise


def session(subject, seconds, generator, path=None):
    """Run a session; return the error of the curve every 50 ms (n,)."""
    pulses, stamps, force = drawn(subject, seconds, generator)
    estimator = estimator_by_name('tracking')
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
    return np.array(errors)


def first_below(errors, limit):
    """Return after how many pulses the error is below a limit for the first time."""
    below = np.flatnonzero(errors < limit)
    return float(below[0] + 1) if len(below) else np.inf


def stays_below(errors, limit):
    """Return after how many pulses the error stays below a limit; infinite if it never does."""
    above = np.flatnonzero(~(errors < limit))
    last = int(above[-1]) + 1 if len(above) else 0
    return float(last + 1) if last < len(errors) else np.inf


def on_another_day(subject, change):
    """Return the subject with threshold and saturation changed, gain and T_a relatively (4,)."""
    recruitment = subject.recruitment
    moved = replace(
        recruitment,
        threshold=recruitment.threshold + change[0],
        saturation=recruitment.saturation + change[1],
    ).normalised()
    return replace(
        subject,
        recruitment=moved,
        maximum_force=(1.0 + change[2]) * subject.maximum_force,
        time_constant=(1.0 + change[3]) * subject.time_constant,
    )


def bound(last_time, today, generator):
    """Return the error after ten pulses of an estimator that knows all but the changes."""
    pulses, _, force = drawn(today, TODAY, generator)
    seen = slice(50 * PULSES)
    noise = NOISE * today.maximum_force
    # standard deviations of the uniform distributions
    prior = np.concatenate((3.0 / np.square(LARGEST), np.zeros(2)))
    found = np.zeros(len(prior))
    baseline = np.stack((np.ones(50 * PULSES), np.linspace(-1.0, 1.0, 50 * PULSES)), axis=1)

    def model(change):
        return contraction(on_another_day(last_time, change), pulses)[1][seen]

    for _ in range(4):
        here = model(found[:4])
        slopes = [(model(found[:4] + step) - here) / STEP for step in STEP * np.eye(4)]
        columns = np.column_stack((*slopes, baseline)) / noise
        rest = (force[seen] - here - baseline @ found[4:]) / noise
        hessian = columns.T @ columns + np.diag(prior)
        found += np.linalg.solve(hessian, columns.T @ rest - prior * found)
    truth = today.steady_force(CURVE_INTENSITY, RATE)
    curve = on_another_day(last_time, found[:4]).steady_force(CURVE_INTENSITY, RATE)
    return np.abs(curve - truth).max() / truth.max()


def compared(person, path):
    """Return errors of a returning person, cold and warm, and of a stranger; change and bound."""
    generator = np.random.default_rng(person)
    subject, other = random_subject(generator), random_subject(generator)
    pulses, stamps, force = drawn(subject, LAST_TIME, generator)
    last_time = rpms_ros.from_arrays(
        1e-9 * stamps, force, 1e-9 * pulses.onset_ns, pulses.intensity
    )
    last_time.identify('tracking').to_json(path)
    today = on_another_day(subject, generator.uniform(-1.0, 1.0, size=4) * LARGEST)
    runs = [
        session(who, TODAY, np.random.default_rng(1000 + person), start)
        for who in (today, other)
        for start in (None, path)
    ]
    before, after = (one.steady_force(CURVE_INTENSITY, RATE) for one in (subject, today))
    least = bound(subject, today, np.random.default_rng(1000 + person))
    return runs, np.abs(after - before).max() / after.max(), least


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--people', type=int, default=20)
    arguments = parser.parse_args(argv)
    people = arguments.people
    with tempfile.TemporaryDirectory() as folder:
        found = [compared(person, Path(folder) / 'result.json') for person in range(people)]
    cold, warm, strange, wrong = zip(*(one[0] for one in found), strict=True)
    change, least = [one[1] for one in found], [one[2] for one in found]
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
    # The step that uses the last of their samples is taken when the next one comes.
    after = [one[PULSES] for one in warm]
    reached, possible = (float(np.mean(np.array(one) < GOOD)) for one in (after, least))
    print(
        f'after {PULSES} pulses: error median {np.median(after):.2%}, worst {max(after):.2%}, '
        f'below 1 % in {reached:.0%} of the returning (target: all)'
    )
    print(
        f'  the bound: median {np.median(least):.2%}, worst {max(least):.2%}, '
        f'below 1 % in {possible:.0%}'
    )
    later = [
        (stays_below(one, ENOUGH) - stays_below(other, ENOUGH)) / RATE
        for one, other in zip(wrong, strange, strict=True)
    ]
    print(
        f'a wrong prior costs {np.median(later):.2f} s until the error stays below 2 % '
        f'(median; worst {max(later):.2f} s; target 1 s)'
    )
    return 0 if reached >= possible and max(later) <= 1.0 else 1


if __name__ == '__main__':
    sys.exit(main())
