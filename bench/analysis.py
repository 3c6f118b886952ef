# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures that the muscle analysis has to reach, measured: twitches, order, field, trains, speed.

Simulated muscles with 1 % noise (of a twitch at full intensity) and artifacts as high as a twitch;
then real trains of rat gastrocnemius, if the folder of recordings is there (RPMS_RECORDINGS,
else ../shared/data beside the project).

python bench/analysis.py [--quick]
"""

import argparse
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

import rpms_ros
from rpms_ros.identification.analysis import analyze, analyze_trains
from rpms_ros.identification.analysis.responses import Response
from rpms_ros.identification.analysis.twitch_fits import CONSTANT, ONSET, choose_order
from rpms_ros.muscle import random_subject
from rpms_ros.muscle.simulation import simulated_force
from rpms_ros.pulses import PulseTrain
from rpms_ros.stimulation.schedule.protocols import recruitment

FOLDER = Path(os.environ.get('RPMS_RECORDINGS', Path(__file__).parents[2] / 'shared/data'))
INTENSITIES = (0.6, 0.7, 0.8, 0.9, 1.0)
VERDICT = {True: 'yes', False: 'NO', None: ''}


def say(label, value, target, reached):
    print(f'  {label:<58} {value:<26} {target:<22} {VERDICT[reached]}')


def singles(count, seed):
    """Return pulses a second apart, off the grid of the samples."""
    random = np.random.default_rng(seed)
    onset = (np.arange(count) + 1) * 1_000_000_000 + random.integers(0, 1_000_000, count)
    intensity = np.resize(INTENSITIES, count)
    return PulseTrain(onset, intensity, np.arange(count), np.full(count, 1e-4))


def twitch_errors(subjects):
    """Return errors of latency by both methods [ms], of T_a by twitch and by subject [%]."""
    random = np.random.default_rng(11)
    fit, crossing, constant, shared = [], [], [], []
    for seed in tqdm(range(subjects), desc='subjects', leave=False, disable=None):
        subject = random_subject(random)
        pulses = singles(20, seed)
        found = analyze(pulses, simulated_force(subject, pulses, 22.0, seed=seed)).twitches
        onset = found.fits.column(ONSET, found.choice.order)
        fit.append(1e3 * (onset - subject.latency))
        rows = found.crossing_latency.rows
        crossing += [1e3 * (row.mean - subject.latency) for row in rows]
        values = found.fits.column(CONSTANT, found.choice.order)
        constant.append(100 * (values / subject.time_constant - 1))
        shared.append(100 * (found.shared.time_constant / subject.time_constant - 1))
    return (
        np.concatenate(fit), np.array(crossing), np.concatenate(constant), np.array(shared)
    )  # fmt: skip


def twitches(subjects):
    fit, crossing, constant, shared = twitch_errors(subjects)
    print(f'twitches: {subjects} random subjects, 20 twitches each, intensities 60 to 100 %')
    say('latency, joint fit: standard deviation', f'{fit.std():.3f} ms', '<= 1 ms', fit.std() <= 1)
    bias = fit.mean()
    say('latency, joint fit: bias', f'{bias:+.3f} ms', '<= 0.5 ms', abs(bias) <= 0.5)
    spread, bias = crossing.std(), crossing.mean()
    say(
        'latency, zero crossing: standard deviation of levels',
        f'{spread:.3f} ms',
        '(no target)',
        None,
    )
    say('latency, zero crossing: bias', f'{bias:+.3f} ms', '(no target)', None)
    within = np.mean(np.abs(constant) <= 2)
    say('T_a: standard deviation', f'{constant.std():.3f} %', '', None)
    say('T_a: twitches within 2 %', f'{within:.2%}', '', None)
    worst = np.abs(constant).max()
    say('T_a: worst twitch', f'{worst:.2f} %', '<= 2 %', bool(worst <= 2))
    worst = np.abs(shared).max()
    say('T_a: worst subject, 20 twitches', f'{worst:.2f} %', '<= 2 %', worst <= 2)


def orders(draws):
    print(f'order out of one twitch at full intensity: {draws} draws each')
    for order in (2, 3, 4):
        random = np.random.default_rng(order)
        right = held_out = 0
        for seed in range(draws):
            subject = replace(random_subject(random), order=order)
            pulses = replace(singles(1, seed), intensity=np.ones(1))
            found = analyze(pulses, simulated_force(subject, pulses, 2.5, seed=seed)).twitches
            choice = choose_order(found.fits)
            right += choice.order == order
            held_out += choice.held_out_order == order
        value = f'{right} (held-out error: {held_out})'
        say(f'order {order} chosen', value, f'>= {0.95 * draws:.0f}', right >= 0.95 * draws)


def field(subjects):
    print(f'recruitment field: {subjects} random subjects, 21 intensities at 6 rates')
    random = np.random.default_rng(5)
    schedule = recruitment()
    pulses = schedule.pulses()
    u, f = np.meshgrid(np.linspace(0, 1, 101), np.linspace(15, 35, 41))
    errors = []
    for seed in tqdm(range(subjects), desc='fields', leave=False, disable=None):
        subject = random_subject(random)
        force = simulated_force(subject, pulses, schedule.length_s, seed=seed)
        found = analyze(pulses, force).recruitment
        true = subject.steady_force(u, f)
        ours = found.recruitment(u, f) * found.maximum_force.value
        errors.append(100 * np.abs(ours - true).max() / true.max())
    say('worst error of the field, median subject', f'{np.median(errors):.2f} %', '', None)
    say('worst error of the field, worst subject', f'{max(errors):.2f} %', '<= 2 % of maximum',
        max(errors) <= 2)  # fmt: skip


def speed(count):
    pulses = singles(count, 0)
    random = np.random.default_rng(1)
    force = simulated_force(random_subject(random), pulses, count + 2.0)
    analyze(singles(2, 0), simulated_force(random_subject(random), singles(2, 0), 4.0))
    begun, processor = time.perf_counter(), time.process_time()
    with tqdm(total=count, desc='twitches', unit=' twitches', leave=False) as bar:
        found = analyze(pulses, force, progress=lambda _, done, __: bar.update(done - bar.n))
    took, processor = time.perf_counter() - begun, time.process_time() - processor
    print(f'speed: {len(found.twitches.fits)} twitches, orders 2, 3, 4 and held out')
    say(f'{count} data sets', f'{took:.1f} s ({processor:.1f} s of CPU)', '< 30 s', took < 30)


def rat_response(path):
    """Return the response of a trial."""
    session = rpms_ros.load(path, time='Time [s]', force='fGM [N]', pulse='STIM [ ]')
    pulses, trace = session.pulses, session.force
    lag = (trace.stamp_ns - pulses.onset_ns[0]) / 1e9
    onset = (pulses.onset_ns - pulses.onset_ns[0]) / 1e9
    part = (lag >= -0.05) & (lag < onset[-1] + 0.5)
    usable = np.ones(int(part.sum()), dtype=np.bool_)
    return Response(onset, lag[part], trace.force[part], usable, np.nan, np.nan)


def rat():
    paths = sorted((FOLDER / 'rat_gastrocnemius').glob('*.csv'))
    if not paths:
        print(f'rat: no recordings in {FOLDER} (set RPMS_RECORDINGS)')
        return
    responses = [rat_response(path) for path in paths]
    print(f'rat gastrocnemius: {len(paths)} trains of 4, 7 and 10 pulses at 100 Hz')
    for order in (2, 3, 4):
        begun = time.perf_counter()
        found = analyze_trains(responses, order)
        took = time.perf_counter() - begun
        wanted = order == 3
        equal, gains = found.mean_fit('equal'), found.mean_fit('gains')
        unseen = found.mean_fit('law', held_out=True)
        say(f'order {order}: equal pulses', f'{equal:.1f} %', '>= 90 %' if wanted else '',
            not wanted or equal >= 90)  # fmt: skip
        say(f'order {order}: a gain a pulse', f'{gains:.1f} %', '>= 95 %' if wanted else '',
            not wanted or gains >= 95)  # fmt: skip
        say(f'order {order}: history law, 10 pulses, learned on 4 and 7', f'{unseen:.1f} %',
            '>= 94 %' if wanted else '', not wanted or unseen >= 94)  # fmt: skip
        print(f'    the same trains: equal pulses {found.mean_fit("equal", held_out=True):.1f} %, '
              f'a gain a pulse {found.mean_fit("gains", held_out=True):.1f} %')  # fmt: skip
        print(f'    worst of the 8: {min(t.law.fit for t in found.trains if t.held_out):.1f} %; '
              f'T_a {1e3 * found.time_constant:.2f} ms ({took:.1f} s)')  # fmt: skip
        print(f'    {found.law}')


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--quick', action='store_true', help='a tenth of the draws')
    quick = parser.parse_args().quick
    print(f'  {"":<58} {"measured":<26} {"target":<22} reached')
    twitches(5 if quick else 50)
    orders(10 if quick else 100)
    field(2 if quick else 20)
    speed(300 if quick else 3000)
    rat()


if __name__ == '__main__':
    main()
