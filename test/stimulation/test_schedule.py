# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Schedules: segments and what they add up to, protocols, and any text whatever."""

import os

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from rpms_ros.errors import StimulationError
from rpms_ros.identification.analysis.responses import Kind, groups_of
from rpms_ros.stimulation import (
    Constant,
    DescriptionError,
    Doublet,
    Pause,
    PulseBurst,
    Ramp,
    Repeat,
    Schedule,
    Single,
    Staircase,
    UniformRandom,
    load_schedule,
    paper_random,
    paper_sinusoid,
    schedule_from_mapping,
    schedule_from_text,
    schedule_to_text,
)
from rpms_ros.stimulation.limits.device_specification import load_device_specification
from rpms_ros.stimulation.limits.patient import load_patient
from rpms_ros.stimulation.schedule.fields import LONGEST_NAME
from rpms_ros.stimulation.schedule.protocols import (
    FIELD_LEVELS,
    FIELD_RATES_HZ,
    TRAIN_RATES_HZ,
    TWITCH_INTENSITIES,
    recruitment,
    trains,
    twitches,
)

RATE, LENGTH, SHARE = st.floats(1.0, 50.0), st.floats(0.1, 3.0), st.floats(0.0, 1.0)
SIMPLE = st.one_of(
    st.builds(Constant, RATE, LENGTH, final_rate_hz=st.none() | RATE, intensity=SHARE),
    st.builds(UniformRandom, RATE, LENGTH),
    st.builds(Pause, LENGTH),
    st.builds(Single, intensity=SHARE),
)
RATES = st.floats(0.5, 200.0)
DURATIONS = st.floats(0.01, 20.0)
# set by bench/hostile_texts.py for the full count
COUNT = int(os.environ.get('RPMS_HOSTILE_TEXTS', '150'))


def some(items, most):
    return st.lists(items, min_size=1, max_size=most).map(tuple)


ITEMS = st.recursive(
    SIMPLE, lambda inner: st.builds(Repeat, some(inner, 3), st.integers(1, 3)), max_leaves=6
)
SCHEDULES = st.builds(Schedule, some(ITEMS, 4), seed=st.integers(0, 99))


def repeated(segment, times, depth):
    repeat = f'{{kind: repeat, times: {times}, segments: ['
    return f'segments: [{repeat * depth}{segment}{"]}" * depth}]'


def intensities(segment, seed=0):
    return Schedule((segment,), seed=seed).plan.intensity


def check(text):
    """Read a text; what comes of it has to be good or refused with a reason."""
    try:
        schedule = schedule_from_text(text)
        plan = schedule.plan if schedule.pulse_count < 5000 else None
    except StimulationError as fault:
        said = str(fault)
        assert 'expected' in said
        assert said.isprintable()
        assert len(said) < 1500
        return
    assert schedule.name.isprintable()
    assert 0 < len(schedule.name) <= LONGEST_NAME
    assert schedule_from_text(schedule_to_text(schedule)) == schedule
    if plan is not None:
        assert np.all(np.diff(plan.onset_ns) >= 0)
        assert np.all((plan.intensity >= 0.0) & (plan.intensity <= 1.0))


@given(SCHEDULES)
def test_text_and_back_is_the_same_schedule_whose_totals_are_known_before_the_pulses(schedule):
    assert schedule_from_text(schedule_to_text(schedule)) == schedule
    plan = schedule.plan
    pieces = sum(item.pieces if isinstance(item, Repeat) else 1 for item in schedule.segments)
    assert len(plan) == schedule.pulse_count
    # every piece is rounded to a whole nanosecond
    assert plan.duration_ns == pytest.approx(schedule.length_s * 1e9, abs=pieces + 1)
    assert np.all(np.diff(plan.onset_ns) >= 0)
    assert np.all(np.diff(plan.segment) >= 0)
    assert np.all((plan.intensity >= 0.0) & (plan.intensity <= 1.0))


def test_segments_follow_one_another_to_the_nanosecond():
    schedule = Schedule(
        (
            Constant(rate_hz=30.0, duration_s=0.1, intensity=0.5),
            Pause(duration_s=0.25),
            Repeat((Single(intensity=0.7, duration_s=0.5),), times=2),
        )
    )
    train = schedule.pulses(start_ns=1_000)
    assert train.onset_ns.tolist() == [
        1_000, 33_334_333, 66_667_667, 350_001_000, 850_001_000,
    ]  # fmt: skip
    assert train.intensity.tolist() == [0.5, 0.5, 0.5, 0.7, 0.7]
    assert train.sequence.tolist() == [0, 1, 2, 3, 4]
    assert train.width.tolist() == [100e-6] * 5
    assert schedule.plan.segment.tolist() == [0, 0, 0, 2, 2]
    assert schedule.plan.highest_rate_hz == pytest.approx(30.0, rel=1e-6)


def test_the_paper_excitations():
    random, sinusoid = paper_random(seed=3), paper_sinusoid()
    assert np.array_equal(random.plan.intensity, np.random.default_rng(3).uniform(0, 1, 1800))
    assert (random.length_s, sinusoid.length_s) == (90.0, 90.0)
    # from zero to the top in the middle of 9 s
    assert sinusoid.plan.intensity[[0, 90]].tolist() == [0.0, 1.0]
    assert np.argmax(sinusoid.plan.intensity) == 90
    assert np.mean(sinusoid.plan.intensity**2) == pytest.approx(3 / 8, abs=1e-12)


def test_catch_pulses_are_of_the_course_and_at_random_places():
    course = paper_sinusoid().plan.intensity
    mixed = paper_sinusoid(catch_share=0.1, seed=3)
    assert schedule_from_text(schedule_to_text(mixed)) == mixed
    caught = mixed.plan.intensity != course
    # 1800 draws with probability 0.1, four standard deviations
    assert caught.mean() == pytest.approx(0.1, abs=0.03)
    assert np.isin(mixed.plan.intensity, course).all()
    assert (mixed.plan.onset_ns == paper_sinusoid().plan.onset_ns).all()
    assert abs(np.corrcoef(mixed.plan.intensity[caught], course[caught])[0, 1]) < 0.3
    with pytest.raises(StimulationError, match=r'expected a number in \(0, 1\], got 1\.5'):
        paper_sinusoid(catch_share=1.5)


@pytest.mark.parametrize(
    ('text', 'fault'),
    [
        ('', 'expected a YAML document, got an empty one'),
        ('[1, 2]', 'expected a mapping of names to values, got'),
        ('name: x', r'line 1, segments: expected a list of segments, got None'),
        ('segments: []', r'line 1, segments: expected a list of segments, got \[\]'),
        ('name: 3\nsegments: [{kind: single, intensity: 1}]',
         r'line 1, name: expected a text of 1 to 64 printable characters, got 3'),
        ('segments: [{kind: single, intensity: 1}]\nspeed: 3',
         r'line 2, speed: expected one of .*, got'),
        ('segments: [{kind: blast}]', r'segments\[0\]\.kind: expected one of .* got .blast'),
        ('segments:\n- {kind: pause}', r'line 2, segments\[0\]\.duration_s: expected .* nothing'),
        # it was the highest
        *(
            (
                f'segments:\n- {{kind: {kind}}}',
                r'segments\[0\]\.intensity: expected a number in \[0, 1\], got nothing',
            )
            for kind in ('constant, rate_hz: 20, duration_s: 1', 'single', 'doublet', 'n_let')
        ),
        (('segments:\n- {kind: single, intensity: 1}\n'
         '- kind: constant\n  rate_hz: 0\n  duration_s: 1.0\n  intensity: 1'),
         r'line 4, segments\[1\]\.rate_hz: expected a number in \[0\.001, 1000\] Hz, got 0'),
        ('segments:\n- kind: repeat\n  segments:\n  - {kind: pause, duration_s: -1.0}',
         r'line 4, segments\[0\]\.segments\[0\]\.duration_s: expected .* got -1'),
        ('segments:\n- {kind: staircase, rate_hz: 20.0, duration_s: 1.0, levels: [0.5, 2.0]}',
         r'line 2, segments\[0\]\.levels\[1\]: expected a number in \[0, 1\], got 2'),
        ('segments:\n- {kind: single, intensity: 0.1, intensty: 0.1}',
         r'line 2, segments\[0\]\.intensty: expected one of'),
        ('segments:\n- {kind: sinusoid, rate_hz: 20.0, duration_s: 9.0, low: 0.5, high: 0.1}',
         r'line 2, segments\[0\]: expected low <= high, got 0.5 and'),
        ('seed: -1\nsegments: [{kind: single, intensity: 1}]',
         r'line 1, seed: expected a whole number'),
        (repeated('{kind: single, intensity: 1}', 1, 9),
         'expected at most 8 repeats in one another'),
        (repeated('{kind: single, intensity: 1}', 100_000, 2), 'expected at most 500000 pulses'),
        (repeated('{kind: pause, duration_s: 1.0e-6}', 100_000, 2),
         'expected at most 500000 segments after unrolling'),
        (repeated('{kind: pause, duration_s: 86400.0}', 3, 1), 'expected at most 86400 seconds'),
    ],
)  # fmt: skip
def test_malformed_text_is_refused_with_its_place(text, fault):
    with pytest.raises(StimulationError, match=fault) as caught:
        schedule_from_text(text)
    if isinstance(caught.value, DescriptionError):
        assert str(caught.value) == f'{caught.value.place}: {caught.value.fault}'


def test_file_is_named_in_its_fault(tmp_path):
    path = tmp_path / 'schedule.yaml'
    path.write_text('segments:\n- {kind: pause}\n')
    with pytest.raises(StimulationError, match=r'schedule\.yaml: line 2, segments\[0\]'):
        load_schedule(path)
    with pytest.raises(StimulationError, match=r'expected a readable schedule file, got .*absent'):
        load_schedule(tmp_path / 'absent.yaml')
    path.write_text(schedule_to_text(paper_random()))
    assert load_schedule(path) == paper_random()


@given(rate=RATES, final=RATES, duration=DURATIONS)
def test_sweep_fires_when_its_phase_is_whole_from_zero_to_its_end(rate, final, duration):
    onset_ns = Constant(rate, duration, 1.0, final_rate_hz=final).onsets_ns()
    assert onset_ns[0] == 0
    assert np.all(np.diff(onset_ns) > 0)
    assert onset_ns[-1] < round(duration * 1e9) or len(onset_ns) == 1
    onset = onset_ns / 1e9
    phase = rate * onset + (final - rate) * onset**2 / (2 * duration)
    # onsets are rounded to 1 ns: at 200 Hz that is 1e-7 of a period
    assert phase == pytest.approx(np.arange(len(onset)), abs=1e-6)


def test_ramp_meets_its_ends():
    values = intensities(Ramp(rate_hz=100.0, duration_s=1.0, start=0.2, end=0.7))
    assert values[0] == 0.2
    assert values == pytest.approx(0.2 + 0.5 * np.arange(100) / 100, abs=1e-12)


@pytest.mark.parametrize('rate', [3.0, 7.0, 20.0, 30.0])
def test_staircase_gives_every_level_as_often(rate):
    levels = (0.1, 0.5, 0.3)
    values = intensities(Staircase(rate_hz=rate, duration_s=9.0, levels=levels))
    assert np.array_equal(values, np.repeat(levels, round(3 * rate)))


def test_own_seed_wins_over_the_schedule():
    fixed = UniformRandom(rate_hz=20.0, duration_s=1.0, seed=5)
    free = UniformRandom(rate_hz=20.0, duration_s=1.0)
    assert np.array_equal(intensities(fixed, 1), intensities(fixed, 2))
    assert not np.array_equal(intensities(free, 1), intensities(free, 2))
    assert np.array_equal(intensities(free, 1), intensities(free, 1))


def test_volleys():
    assert Single(intensity=0.3).onsets_ns().tolist() == [0]
    assert Doublet(1.0, interval_s=0.005).onsets_ns().tolist() == [0, 5_000_000]
    assert PulseBurst(1.0, count=4, interval_s=0.02).onsets_ns().tolist() == [
        0, 20_000_000, 40_000_000, 60_000_000,
    ]  # fmt: skip
    assert intensities(PulseBurst(0.3, count=4)).tolist() == [0.3] * 4


@pytest.mark.parametrize(
    ('build', 'fault'),
    [
        (lambda: Constant(20.0, 1.0, intensity=1.01), r'intensity: expected .* got 1.01'),
        (lambda: Staircase(20.0, 1.0, levels=()), r'levels: expected a list, each .* got \(\)'),
        (lambda: UniformRandom(20.0, 1.0, low=0.5, high=0.2), 'expected low <= high, got 0.5 a'),
        (lambda: Doublet(1.0, count=3), r'count: expected a whole number in \[2, 2\], got 3'),
        (lambda: PulseBurst(1.0, count=1.5), r'count: expected a whole number .* got 1.5'),
        (
            lambda: PulseBurst(1.0, count=5, interval_s=0.25),
            r'expected a duration above 1 s, .* got 1',
        ),
        (lambda: Pause(True), r'duration_s: expected a number .* got True'),
        (lambda: Schedule(()), 'expected at least one segment, got none'),
        (lambda: Repeat(()), 'at least one segment to repeat, got none'),
        (lambda: twitches(intensities=()), 'intensities and repetitions, got 0 and 10'),
    ],
)
def test_impossible_segments_are_refused(build, fault):
    with pytest.raises(StimulationError, match=fault):
        build()


def test_twitches_come_at_every_intensity_equally_often_and_shuffled():
    schedule = twitches(repetitions=4)
    intensity = schedule.pulses().intensity
    values, counts = np.unique(intensity, return_counts=True)
    assert values.tolist() == sorted(TWITCH_INTENSITIES)
    assert set(counts) == {4}
    assert (np.diff(intensity) < 0).any()
    assert [group.kind for group in groups_of(schedule.pulses())] == [Kind.SINGLE] * 24


def test_trains_have_their_rates():
    groups = groups_of(trains().pulses())
    rates = [round(group.levels[0].rate_hz) for group in groups if group.last - group.first > 4]
    assert rates == [round(rate) for rate in TRAIN_RATES_HZ]
    assert [group.kind for group in groups[:3]] == [Kind.SINGLE] * 3


def test_the_staircase_has_the_number_of_data_sets_of_the_paper():
    groups = groups_of(recruitment().pulses())
    assert [group.kind for group in groups] == [Kind.STAIRCASE] * len(FIELD_RATES_HZ)
    levels = [level for group in groups for level in group.levels]
    # 882 data sets of 7 subjects
    assert len(levels) == 126
    assert [level.intensity for level in levels[:21]] == list(FIELD_LEVELS)


def test_the_texts_that_broke_something_once(hostile_texts):
    for text in hostile_texts.KNOWN:
        check(text)
    assert any(len(text) > 1_000_000 for text in hostile_texts.KNOWN)


@given(st.randoms(use_true_random=False))
@settings(max_examples=COUNT)
def test_texts_from_a_grammar_and_from_bytes(hostile_texts, random):
    check(hostile_texts.hostile_text(random))


@given(st.text(st.characters(), max_size=60))
@settings(max_examples=COUNT)
def test_any_name(name):
    content = {'name': name, 'segments': [{'kind': 'single', 'intensity': 1.0}]}
    # white space is taken for one blank each
    plain = ' '.join(name.split())
    if not plain or not plain.isprintable():
        with pytest.raises(StimulationError, match='name: expected a text of 1 to 64') as caught:
            schedule_from_mapping(content)
        assert str(caught.value).isprintable()
        return
    schedule = schedule_from_mapping(content)
    assert schedule_from_text(schedule_to_text(schedule)) == schedule


@pytest.mark.parametrize('key', ['\ud800', 'a\nb', '', 'x' * 10_000])
def test_any_key_of_a_mapping(key):
    with pytest.raises(StimulationError, match='expected one of') as caught:
        schedule_from_mapping({'segments': [{'kind': 'single', 'intensity': 1.0}], key: 10**5000})
    assert str(caught.value).isprintable()


def test_hostile_files_of_devices_and_patients(hostile_texts, tmp_path):
    path = tmp_path / 'hostile.yaml'
    for text in hostile_texts.hostile_texts(150, seed=3):
        path.write_bytes(text.encode('utf-8', 'surrogatepass'))
        for load in (load_patient, lambda path: load_device_specification(str(path))):
            with pytest.raises(StimulationError, match=r'hostile\.yaml: '):
                load(path)
