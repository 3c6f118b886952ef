# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables 1 and 2: latency and time constant of as many subjects and data sets as in the paper.

Every subject has a mean latency and a mean time constant within the ranges of the tables, drawn
so that the means over subjects are those of the tables, and every data set its own, with the
spread that the tables give within a subject.  1 % noise (of a twitch at full intensity) and an
artifact as high as the twitch; pulses lie anywhere between two samples.

    python docs/reproduction/section2_population.py [--out DIR] [--seed N]
"""

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from rpms_ros.identification.analysis import MuscleAnalysis, analyze
from rpms_ros.identification.analysis.twitch_fits import CONSTANT, ONSET
from rpms_ros.muscle import Disturbances, Sensor, average_subject, twitch
from rpms_ros.pulses import ForceTrace, PulseTrain

INTENSITIES = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
NOISE, ARTIFACT = 0.01, 1.0


@dataclass(frozen=True)
class Range:
    """Lowest and highest subject, mean over subjects, spread within a subject [ms]."""

    low: float
    high: float
    mean: float
    spreads: tuple[float, float]

    def subjects(self, count, random):
        """Draw means of subjects within the range whose expectation is the mean."""
        place = (self.mean - self.low) / (self.high - self.low)
        return self.low + (self.high - self.low) * random.beta(2 * place, 2 * (1 - place), count)


TABLE_1 = {
    'electrical': Range(20.83, 28.24, 24.4, (3.05, 3.05)),
    'magnetic': Range(6.28, 14.63, 9.45, (1.12, 1.12)),
}
TABLE_2 = {
    'electrical': Range(22.58, 53.22, 36.62, (1.04, 5.21)),
    'magnetic': Range(26.71, 49.81, 38.44, (0.99, 5.88)),
}


@dataclass(frozen=True)
class Study:
    """One subject: what was drawn [ms] and what was found."""

    latency: np.ndarray
    constant: np.ndarray
    onset_ns: np.ndarray
    found: MuscleAnalysis


def subject_study(latency_ms, spread_ms, constant_ms, constant_spread_ms, count, seed, shift):
    """Return the analysis of one subject with `count` twitches, a second apart."""
    random = np.random.default_rng(seed)
    latency = np.maximum(random.normal(latency_ms, spread_ms, count), 5.0)
    constant = np.maximum(random.normal(constant_ms, constant_spread_ms, count), 15.0)
    onset = (np.arange(count) + 1) * 1_000_000_000 + random.integers(0, 1_000_000, count)
    intensity = random.permutation(np.resize(INTENSITIES, count))
    peak = average_subject().recruitment(intensity)
    stamps = np.arange(1000 * (count + 2), dtype=np.int64) * 1_000_000
    force = np.zeros(len(stamps))
    for index in range(count):
        part = slice(1000 * (index + 1), 1000 * (index + 2))
        lag = (stamps[part] - onset[index]) / 1e9 - 1e-3 * latency[index]
        force[part] += peak[index] * twitch(lag, 1e-3 * constant[index])
    sensor = Sensor(Disturbances(noise=NOISE, artifact=ARTIFACT), seed)
    shown = ForceTrace(stamps, sensor.measure(stamps, force, onset, intensity))
    pulses = PulseTrain(onset + shift, intensity, np.arange(count), np.full(count, 1e-4))
    return Study(latency, constant, onset, analyze(pulses, shown))


def population(modality, subjects, data_sets, seed):
    """Return the studies of a population."""
    random = np.random.default_rng(seed)
    first, second = TABLE_1[modality], TABLE_2[modality]
    latency, constant = first.subjects(subjects, random), second.subjects(subjects, random)
    shares = np.array_split(np.arange(data_sets), subjects)
    bar = tqdm(total=data_sets, unit=' twitches', desc=modality, disable=None, leave=False)
    studies = []
    with bar:
        for index, share in enumerate(shares):
            spreads = (random.uniform(*first.spreads), random.uniform(*second.spreads))
            studies.append(
                subject_study(
                    latency[index], spreads[0], constant[index], spreads[1],
                    len(share), seed + index + 1, 0,
                )
            )  # fmt: skip
            bar.update(len(share))
    return studies


def matched(study, column):
    """Return fitted values [ms] and the true ones of the same twitches."""
    twitches = study.found.twitches
    fits = twitches.fits
    values = 1e3 * fits.column(column, twitches.choice.order)
    truth = study.latency if column == ONSET else study.constant
    # twitches that did not qualify are missing in the fits: find each by its closest truth
    both = np.stack((1e3 * fits.column(ONSET, 3), 1e3 * fits.column(CONSTANT, 3)), axis=1)
    known = np.stack((study.latency, study.constant), axis=1)
    place = [int(np.argmin(((known - row) ** 2).sum(axis=1))) for row in both]
    return values, truth[place]


def line(label, *cells):
    print(f'  {label:<44}' + ''.join(f'{cell:>16}' for cell in cells))


def summary(values):
    """Return range and mean over subjects and mean spread within them, as the tables do."""
    means = np.array([np.mean(value) for value in values])
    spreads = np.array([np.std(value, ddof=1) for value in values])
    return means, spreads


def print_table_1(studies_of, printed):
    print('\nTable 1: time delay T_l [ms]')
    line('', *studies_of)
    for part, show in (
        ('range of subjects', lambda means, _: f'{means.min():.2f}-{means.max():.2f}'),
        ('mean', lambda means, _: f'{means.mean():.2f}'),
        ('mean standard deviation', lambda _, spreads: f'{spreads.mean():.2f}'),
    ):
        line(part, *('' for _ in studies_of))
        paper = {
            'range of subjects': lambda r: f'{r.low:.2f}-{r.high:.2f}',
            'mean': lambda r: f'{r.mean:.2f}',
            'mean standard deviation': lambda r: f'{r.spreads[0]:.2f}',
        }[part]
        line('  paper', *(paper(printed[name]) for name in studies_of))
        for label, values in (
            ('  drawn (the truth)', lambda study: study.latency),
            ('  joint fit', lambda study: matched(study, ONSET)[0]),
        ):
            line(label, *(show(*summary([values(study) for study in studies]))
                          for studies in studies_of.values()))  # fmt: skip
        if part == 'mean':
            line('  zero crossing, from the artifact', *(
                f'{np.mean([1e3 * study.found.twitches.crossing_latency.mean for study in s]):.2f}'
                for s in studies_of.values()
            ))  # fmt: skip


def print_table_2(studies_of, printed):
    print('\nTable 2: time constant T_a [ms]')
    line('', *studies_of)
    found = {
        name: summary([matched(study, CONSTANT)[0] for study in studies])
        for name, studies in studies_of.items()
    }
    true = {
        name: summary([study.constant for study in studies])
        for name, studies in studies_of.items()
    }
    line('paper, subjects', *(f'{r.low:.2f}-{r.high:.2f}' for r in printed.values()))
    line('drawn', *(f'{m.min():.2f}-{m.max():.2f}' for m, _ in true.values()))
    line('ours', *(f'{m.min():.2f}-{m.max():.2f}' for m, _ in found.values()))
    line('paper, spread within subjects', *(f'{r.spreads[0]:.2f}-{r.spreads[1]:.2f}'
                                            for r in printed.values()))  # fmt: skip
    line('drawn', *(f'{s.min():.2f}-{s.max():.2f}' for _, s in true.values()))
    line('ours', *(f'{s.min():.2f}-{s.max():.2f}' for _, s in found.values()))
    line('paper, mean of all', *(f'{r.mean:.2f}' for r in printed.values()))
    line('drawn', *(f'{m.mean():.2f}' for m, _ in true.values()))
    line('ours', *(f'{m.mean():.2f}' for m, _ in found.values()))


def print_errors(studies_of):
    print('\nErrors against the truth, every twitch')
    line('', *studies_of)
    for label, column, relative in (
        ('latency: bias [ms]', ONSET, False),
        ('latency: standard deviation [ms]', ONSET, False),
        ('T_a: bias [%]', CONSTANT, True),
        ('T_a: standard deviation [%]', CONSTANT, True),
    ):
        cells = []
        for studies in studies_of.values():
            pairs = [matched(study, column) for study in studies]
            error = np.concatenate([a / b - 1 if relative else a - b for a, b in pairs])
            error = 100 * error if relative else error
            cells.append(f'{error.mean() if "bias" in label else error.std():.3f}')
        line(label, *cells)
    line('order chosen, by subject', *(
        ','.join(str(study.found.twitches.choice.order) for study in studies)
        if len(studies) < 10
        else f'3 in {sum(s.found.twitches.choice.order == 3 for s in studies)} of {len(studies)}'
        for studies in studies_of.values()
    ))  # fmt: skip
    line('twitches that qualify', *(
        f'{sum(len(s.found.twitches.fits) for s in studies)} of '
        f'{sum(len(s.latency) for s in studies)}'
        for studies in studies_of.values()
    ))  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--out', type=Path, help='folder for figures of one subject a modality')
    arguments = parser.parse_args()
    begun = time.perf_counter()
    first = {name: population(name, 8, 3698, arguments.seed) for name in TABLE_1}
    print(
        f'8 subjects, 3698 data sets each way of stimulation, {time.perf_counter() - begun:.0f} s'
    )
    print_table_1(first, TABLE_1)
    print_errors(first)
    second = {name: population(name, 20, 2984, arguments.seed + 100) for name in TABLE_2}
    print('\n20 subjects, 2984 data sets each way of stimulation')
    print_table_2(second, TABLE_2)
    print_errors(second)
    if arguments.out:
        from rpms_ros.report.analysis_figures import draw_analysis

        for name, studies in second.items():
            folder = arguments.out / name
            folder.mkdir(parents=True, exist_ok=True)
            draw_analysis(folder, studies[0].found, f'{name} stimulation, one subject (Fig. 5)')


if __name__ == '__main__':
    main()
