# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Table 3, Figs. 9 and 10: the recruitment field of seven subjects, and of their average.

Every subject has a threshold, a saturation, slopes and a twitch of its own around Table 3; 21
intensities at 6 rates are 126 levels a subject, 882 in all, as in the paper.  The average field,
normalised by each subject's force at 100 % and 20 Hz, is fitted as the paper's was.

    python docs/reproduction/section2_recruitment.py [--out DIR] [--seed N]
"""

import argparse
from pathlib import Path

import numpy as np
from tqdm import tqdm

from rpms_ros.identification.analysis import SteadyPoint, analyze, fit_field
from rpms_ros.muscle import IntensityRecruitment, RateRecruitment, Subject
from rpms_ros.muscle.simulation import simulated_force
from rpms_ros.stimulation.schedule.protocols import recruitment

SUBJECTS = 7
TABLE_3 = (
    ('u_thr [%]', 48.0), ('u_sat [%]', 98.0), ('alpha_thr', 5.0), ('alpha_sat', 4.0),
    ('beta_1', 0.738), ('beta_2', 0.539),
    ('f_sat [Hz]', 25.0), ('gamma_sat', 0.05), ('delta_1', 0.0597), ('delta_2', -0.321),
)  # fmt: skip


def subject_like_table_3(random):
    """Return a subject whose recruitment lies around the average."""
    shape = IntensityRecruitment(
        threshold=0.48 + 0.03 * random.standard_normal(),
        saturation=0.98 + 0.03 * random.standard_normal(),
        threshold_slope=5.0 * np.exp(0.1 * random.standard_normal()),
        saturation_slope=4.0 * np.exp(0.1 * random.standard_normal()),
    )
    return Subject(
        time_constant=1e-3 * random.uniform(26.71, 49.81),
        latency=1e-3 * random.uniform(6.28, 14.63),
        recruitment=shape.normalised(),
        maximum_force=random.uniform(5.0, 50.0),
    )


def numbers(found):
    """Return the ten numbers of Table 3."""
    by_intensity, by_rate = found.recruitment.by_intensity, found.recruitment.by_rate
    return (
        100 * by_intensity.threshold, 100 * by_intensity.saturation,
        by_intensity.threshold_slope, by_intensity.saturation_slope,
        by_intensity.gain, by_intensity.offset,
        by_rate.saturation, by_rate.slope, by_rate.gain, by_rate.offset,
    )  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--out', type=Path, help='folder for the figures')
    arguments = parser.parse_args()
    random = np.random.default_rng(arguments.seed)
    schedule = recruitment()
    pulses = schedule.pulses()
    u, f = np.meshgrid(np.linspace(0, 1, 101), np.linspace(15, 35, 41))
    shares, errors, intervals = [], [], []
    for seed in tqdm(range(SUBJECTS), desc='subjects', leave=False, disable=None):
        subject = subject_like_table_3(random)
        analysis = analyze(pulses, simulated_force(subject, pulses, schedule.length_s, seed=seed))
        found = analysis.recruitment
        true = subject.steady_force(u, f)
        ours = found.recruitment(u, f) * found.maximum_force.value
        errors.append(100 * np.abs(ours - true).max() / true.max())
        intervals.append(100 * found.worst_interval)
        shares.append([point.force / found.maximum_force.value for point in found.points])
    points = [
        SteadyPoint(point.intensity, point.rate_hz, float(share), 0.0, 0)
        for point, share in zip(found.points, np.mean(shares, axis=0), strict=True)
    ]
    average = fit_field(points)
    print(f'{SUBJECTS} subjects, {SUBJECTS * len(points)} levels, 1 % noise, artifacts')
    print('\nTable 3: average recruitment')
    print(f'  {"":<12}{"paper":>10}{"ours":>10}')
    for (name, paper), ours in zip(TABLE_3, numbers(average), strict=True):
        print(f'  {name:<12}{paper:>10.4g}{ours:>10.4g}')
    printed = IntensityRecruitment()(u) * RateRecruitment()(f)
    worst = 100 * np.abs(average.recruitment(u, f) - printed).max() / printed.max()
    print(f'\n  average field, ours against Table 3: worst {worst:.1f} % of the maximum')
    print(f'  each subject against its own truth: worst {max(errors):.2f} %, '
          f'median {np.median(errors):.2f} % of the maximum')  # fmt: skip
    print(f'  greatest 95 % interval of a field: {max(intervals):.2f} %')
    print(f'  residual: {100 * average.residual:.2f} % of the greatest force')
    print('\nFig. 9 and 10: average field at some intensities and rates, measured / fitted')
    shown = (0.25, 0.5, 0.75, 1.0)
    print('  ' + f'{"":<8}' + ''.join(f'{f"{level:.0%}":>16}' for level in shown))
    for rate in (15.0, 23.0, 35.0):
        cells = []
        for level in shown:
            (point,) = [p for p in points
                        if abs(p.rate_hz - rate) < 0.1 and p.intensity == level]  # fmt: skip
            fitted = float(average.recruitment(level, rate))
            cells.append(f'{f"{point.force:.3f} / {fitted:.3f}":>16}')
        print(f'  {rate:>5.0f} Hz' + ''.join(cells))
    if arguments.out:
        from rpms_ros.report.analysis_figures import draw_field

        arguments.out.mkdir(parents=True, exist_ok=True)
        draw_field(average, 'average of seven subjects (Figs. 9 and 10)').savefig(
            arguments.out / 'recruitment.png'
        )


if __name__ == '__main__':
    main()
