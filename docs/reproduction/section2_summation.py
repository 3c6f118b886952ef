# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Eqs. 6 and 7, Figs. 6 to 8: what a train adds up to, for both ways of stimulation.

The average subjects of the paper, RPMS and fES, go through the same protocol and the same
analysis; then, for each rate, mean and ripple of the steady force in peaks of a single twitch
beside what superposed equal twitches (Eqs. 6, 7) say.  The difference is the rate-dependent gain
that the paper puts into rho_f.

    python docs/reproduction/section2_summation.py [--out DIR]
"""

import argparse
from pathlib import Path

import numpy as np

from rpms_ros.identification.analysis import analyze
from rpms_ros.identification.analysis.twitch_fits import PEAK
from rpms_ros.muscle import Modality, average_subject, steady_mean, summed_twitches
from rpms_ros.muscle.simulation import simulated_force
from rpms_ros.report.analysis_report import analysis_text
from rpms_ros.stimulation.schedule.protocols import muscle


def predicted(rate, constant, order):
    """Return mean and ripple of superposed twitches of peak 1 (Eqs. 7 and 6)."""
    phase = np.linspace(0.0, 1.0, 10, endpoint=False) + 0.05
    late = 2.0 + phase / rate
    force = summed_twitches(late, rate, constant, order)
    return steady_mean(rate, constant, order), float(np.ptp(force))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--out', type=Path, help='folder for the figures')
    arguments = parser.parse_args()
    schedule = muscle()
    pulses = schedule.pulses()
    analyses = {}
    for modality in (Modality.MAGNETIC, Modality.ELECTRICAL):
        force = simulated_force(average_subject(modality), pulses, schedule.length_s)
        analyses[modality.name.lower()] = analyze(pulses, force)
    print('The average subjects of Tables 1 to 3, the same protocol and analysis\n')
    print(analysis_text(list(analyses.values()), list(analyses)))
    for name, found in analyses.items():
        twitches = found.twitches
        strong = twitches.fits.intensity > 0.999
        peak = float(np.median(twitches.fits.column(PEAK, 3)[strong]))
        print(f'\n{name}: steady force in peaks of a single twitch, at full intensity')
        print(f'  {"rate":>6}  {"mean":>7} {"Eq. 7":>7} {"gain":>6}  {"ripple":>7} {"Eq. 6":>7}')
        for point in sorted(found.steady, key=lambda p: p.rate_hz):
            if point.intensity < 0.999:
                continue
            mean, ripple = predicted(point.rate_hz, twitches.shared.time_constant, 3)
            measured = point.force / peak
            columns = (
                f'{point.rate_hz:>4.0f} Hz  {measured:>7.3f} {mean:>7.3f}',
                f'{measured / mean:>6.3f}  {point.ripple / peak:>7.3f} {ripple:>7.3f}',
            )
            print(' ', *columns)
    if arguments.out:
        from rpms_ros.report.analysis_figures import draw_analysis

        for name, found in analyses.items():
            folder = arguments.out / name
            folder.mkdir(parents=True, exist_ok=True)
            draw_analysis(folder, found, f'{name} stimulation, average subject')


if __name__ == '__main__':
    main()
