# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sec. 3 of the paper, run again: Table 4, Figs. 13 to 17, Table 6 in silico, every claim.

`python docs/reproduction/section3.py [folder]` prints the tables and writes the figures.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import section3_figures as figures
from section3_plants import (
    PEOPLE,
    RATE,
    TABLE_6,
    in_silico,
    output_error,
    right_from,
    run,
    simulated,
)

from rpms_ros.identification import TABLE_4, TABLE_5, ModifiedRecursiveLM
from rpms_ros.identification.catalogue import estimator_by_name


def table_4(folder):
    """Sec. 3.3.3: the simulated identification."""
    print('Table 4: plant 48 %, 98 %, 4; start 40 %, 90 %, 3; 90 s, no noise')
    print('  claim: converges after about 36 s; the output error is then below 0.1 %')
    print(f'  {"estimator":<22}{"input":<10}{"u_thr":>7}{"u_sat":>7}{"a_sat":>7}', end='')
    print(f'{"curve < 1 % from":>18}{"output error":>14}')
    shown = {}
    for kind in ('random', 'sinusoid'):
        session = simulated(kind, seed=1)
        estimators = {
            'plain derivative': ModifiedRecursiveLM(replace(TABLE_4, projected=False)),
            'recursive, projected': ModifiedRecursiveLM(TABLE_4),
            'tracking': estimator_by_name('tracking', 'paper_table_4'),
        }
        for name, estimator in estimators.items():
            path = run(estimator, session)
            shown[kind, name] = path
            u_thr, u_sat, alpha_sat, _ = path.theta[-1]
            when = right_from(path, 0.01)
            since = 'never' if np.isnan(when) else f'{when:.1f} s'
            error = 100 * output_error(path, session, 36.0)
            print(
                f'  {name:<22}{kind:<10}{u_thr:7.3f}{u_sat:7.3f}{alpha_sat:7.2f}'
                f'{since:>18}{error:12.4f} %',
                flush=True,
            )
        if kind == 'random':
            figures.parameter_paths(folder / 'figure_13.png', shown, kind)
            figures.reconstruction(folder / 'figure_14.png', session, shown, kind)
    print('  With the 9 s sinusoid the claim holds.  With random intensities the truncated sines')
    print('  cannot represent the twitch better than 0.5 %: no algorithm reaches 0.1 % with them.')


def experiments(folder):
    """Sec. 3.3.4: eight sessions, in silico."""
    print('Table 5 and 6 in silico: the printed parameters of each first take are the plant;')
    print('  alpha_thr 5, latency left in, 0.5 % noise, 1 % drift, pulses off the grid')
    print('  claim: converges after about 80 s to 1 to 1.5 % output error')
    head = f'  {"session":<9}{"estimator":<22}{"u_thr":>7}{"u_sat":>7}{"a_sat":>7}{"a_thr":>7}'
    print(head + f'{"curve error":>13}{"at 15 s":>9}{"output error":>14}')
    results = {}
    for name in TABLE_6:
        for take in (0, 1):
            session = in_silico(name, take)
            estimators = {
                'recursive, Table 5': ModifiedRecursiveLM(TABLE_5),
                'tracking': estimator_by_name('tracking', 'paper_table_5'),
            }
            for label, estimator in estimators.items():
                path = run(estimator, session)
                results[name, take, label] = (session, path)
                _row(name, take, label, session, path)
    figures.experimental_paths(folder / 'figure_15.png', results)
    figures.curves(folder / 'figure_16.png', results)
    figures.responses(folder / 'figure_17.png', results)
    return results


def _row(name, take, label, session, path):
    plant = session.subject.recruitment
    if label.startswith('recursive'):
        print(
            f'  {name} {take + 1:<3}{"plant":<22}{plant.threshold:7.3f}{plant.saturation:7.3f}'
            f'{plant.saturation_slope:7.2f}{plant.threshold_slope:7.2f}'
        )
    u_thr, u_sat, alpha_sat, alpha_thr = path.theta[-1]
    early = path.curve_error[np.searchsorted(path.time, 15.0)]
    error = 100 * output_error(path, session, 80.0)
    print(
        f'  {"":<9}{label:<22}{u_thr:7.3f}{u_sat:7.3f}{alpha_sat:7.2f}{alpha_thr:7.2f}'
        f'{100 * path.curve_error[-1]:11.2f} %{100 * early:7.2f} %{error:12.2f} %',
        flush=True,
    )


def claims(results):
    """Print the claims of Sec. 3.3.4 and 3.4 that are about all sessions together."""
    print('Claims about the eight sessions')
    for label in ('recursive, Table 5', 'tracking'):
        spread, between = [], []
        for subject in PEOPLE:
            ends = {key: path.theta[-1][0] for key, (_, path) in results.items()}
            first = [ends[f'{subject} P1', take, label] for take in (0, 1)]
            second = [ends[f'{subject} P2', take, label] for take in (0, 1)]
            spread += [abs(first[0] - first[1]), abs(second[0] - second[1])]
            between.append(abs(np.mean(first) - np.mean(second)))
        print(
            f'  {label:<20} u_thr differs by {100 * np.mean(spread):.2f} % between takes and '
            f'{100 * np.mean(between):.2f} % between positions'
        )
    print('  (paper: 1.0 to 4.1 % between takes, whose means differ by 1.6 and 1.1 %)')
    session, path = results['S1 P1', 0, 'recursive, Table 5']
    lowest = float(np.min(path.last.response_force) / np.max(path.last.response_force))
    print('  "an impulse response that is unphysiological": lowest value over peak')
    print(f'    recursive, Table 5: {100 * lowest:.1f} %', end='; ')
    estimate = results['S1 P1', 0, 'tracking'][1].last
    lowest = float(np.min(estimate.response_force) / np.max(estimate.response_force))
    print(f'tracking: {100 * lowest:.1f} %')
    subject = session.subject
    rise = subject.pulse_weight(1.0, RATE) - subject.pulse_weight(0.0, RATE)
    truth = (subject.time_constant, subject.latency, 3.0, float(rise))
    print('  twitch read off the tracking estimate (95 %), and the plant')
    rows = zip(
        estimate.physiology_names,
        estimate.physiology,
        estimate.physiology_lower,
        estimate.physiology_upper,
        truth,
        strict=True,
    )
    for label, value, lower, upper, true in rows:
        print(f'    {label:<24}{value:8.4f}  [{lower:.4f}, {upper:.4f}]   {true:.4f}')


def main():
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    folder.mkdir(parents=True, exist_ok=True)
    table_4(folder)
    claims(experiments(folder))


if __name__ == '__main__':
    main()
