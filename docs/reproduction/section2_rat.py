# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Trains of a real muscle, trial by trial: rat gastrocnemius, three explanations (Figs. 6 to 8).

Prints latency, T_a and the three fits of every train, and how much trains of the same animal and
length differ.  The folder of recordings is RPMS_RECORDINGS, else ../shared/data.

    python docs/reproduction/section2_rat.py [--out DIR]
"""

import argparse
import os
from pathlib import Path

import numpy as np

import rpms_ros
from rpms_ros.identification.analysis import analyze_trains
from rpms_ros.identification.analysis.responses import Response

FOLDER = Path(os.environ.get('RPMS_RECORDINGS', Path(__file__).parents[3] / 'shared/data'))


def response(path):
    """Return the response of a trial."""
    session = rpms_ros.load(path, time='Time [s]', force='fGM [N]', pulse='STIM [ ]')
    pulses, trace = session.pulses, session.force
    lag = (trace.stamp_ns - pulses.onset_ns[0]) / 1e9
    onset = (pulses.onset_ns - pulses.onset_ns[0]) / 1e9
    part = (lag >= -0.05) & (lag < onset[-1] + 0.5)
    usable = np.ones(int(part.sum()), dtype=np.bool_)
    return Response(onset, lag[part], trace.force[part], usable, np.nan, np.nan)


def muscle_of(path):
    """Return animal and muscle length [mm], rounded to half a millimetre."""
    length = np.loadtxt(path, delimiter=',', skiprows=1, usecols=1, max_rows=400).mean()
    return path.name[:4], round(2e3 * float(length)) / 2


def half_fall(train):
    """Return the time from the last pulse until the force has fallen to half its peak [ms]."""
    force = train.response.force - train.response.baseline
    last = np.flatnonzero(force > 0.5 * force.max())[-1]
    return 1e3 * (train.response.lag[last] - train.response.onset[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--out', type=Path, help='folder for the figure')
    arguments = parser.parse_args()
    paths = sorted((FOLDER / 'rat_gastrocnemius').glob('*.csv'))
    if not paths:
        parser.exit(1, f'no recordings in {FOLDER} (set RPMS_RECORDINGS)\n')
    found = analyze_trains([response(path) for path in paths], 3)
    muscles = [muscle_of(path) for path in paths]
    rows = sorted(
        zip(muscles, found.trains, strict=True), key=lambda row: (row[0], len(row[1].gains.gains))
    )
    print('rat  length  pulses  latency     T_a  half fall   equal  gains    law  [ms, %]')
    for (rat, length), train in rows:
        print(
            f'{rat}  {length:>4.1f} {len(train.response.onset):>6}'
            f'{1e3 * train.equal.latency:>10.1f}{1e3 * train.equal.time_constant:>8.1f}'
            f'{half_fall(train):>10.1f}{train.equal.fit:>9.1f}{train.gains.fit:>7.1f}'
            f'{train.law.fit:>7.1f}{" unseen" if train.held_out else ""}'
        )
    print(f'\nmean fit: equal pulses {found.mean_fit("equal"):.1f} %, a gain a pulse '
          f'{found.mean_fit("gains"):.1f} %, law on unseen trains '
          f'{found.mean_fit("law", held_out=True):.1f} %')  # fmt: skip
    if arguments.out:
        from rpms_ros.report.analysis_figures import draw_trains

        arguments.out.mkdir(parents=True, exist_ok=True)
        draw_trains(found, 'rat gastrocnemius').savefig(arguments.out / 'trains.png')


if __name__ == '__main__':
    main()
