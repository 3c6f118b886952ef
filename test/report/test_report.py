# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a report tells: residuals, dose, first screen."""

from dataclasses import replace

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from rpms_msgs.msg import DriverStatus
from rpms_ros.errors import ReportError
from rpms_ros.identification.quality.verdict import Verdict
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import FurtherTopic, read_recording, write_recording
from rpms_ros.report.dose import dose_of
from rpms_ros.report.figures import draw
from rpms_ros.report.page import as_page
from rpms_ros.report.recorded import RecordedMessages, recorded_messages
from rpms_ros.report.residuals import analyse_residuals, stimulation_at
from rpms_ros.report.session_report import headline_of, report_of
from rpms_ros.schema import plain

START_NS = 1_700_000_000_000_000_000
SECOND = 1_000_000_000


def test_trains_rates_and_energy_are_those_of_the_pulses():
    train = PulseTrain.joined(
        [
            PulseTrain.regular([0.5, 1.0, 1.0], 10.0, START_NS + 4 * SECOND),
            PulseTrain.regular([1.0, 0.5], 20.0, START_NS + SECOND),
            PulseTrain.regular([7.0, np.nan], 20.0, START_NS),
        ]
    )
    found = dose_of(train, START_NS)
    assert found.onset_s.tolist() == pytest.approx([1.0, 1.05, 4.0, 4.1, 4.2])
    assert (found.pulses, found.trains) == (5, 2)
    assert found.stimulated_s == pytest.approx(0.25)
    assert found.rate_hz == pytest.approx({'lowest': 10.0, 'median': 10.0, 'highest': 20.0})
    assert found.full_intensity_pulses == pytest.approx(3.5)


def test_a_pulse_that_was_recorded_twice_was_given_once():
    train = PulseTrain.regular([0.5, 1.0, 1.0], 10.0, START_NS)
    once, twice = dose_of(train, START_NS), dose_of(PulseTrain.joined([train, train]), START_NS)
    assert (twice.pulses, twice.rate_hz) == (3, once.rate_hz)
    assert twice.full_intensity_pulses == once.full_intensity_pulses == 2.25


def test_the_driver_of_another_muscle_is_none_of_the_report(tmp_path):
    status = {
        name: serialize_message(DriverStatus(schedule=name, pulses_delivered=count))
        for name, count in (('left', 3), ('right', 5))
    }
    further = [
        FurtherTopic(topic, 'rpms_msgs/msg/DriverStatus', [START_NS], [status[name]])
        for topic, name in (('/driver_status', 'left'), ('/right/driver_status', 'right'))
    ]
    stamps = START_NS + np.arange(100) * 1_000_000
    forces, pulses = ForceTrace(stamps, np.sin(stamps)), PulseTrain.regular([0.5], 10.0, START_NS)
    write_recording(tmp_path / 'both', pulses, forces, further=further)
    driver = recorded_messages(read_recording(tmp_path / 'both')).driver
    assert (driver.schedule, driver.pulses_delivered) == ('left', 3)


def test_a_dead_force_still_gives_a_report(tmp_path, report, make_report):
    pulses, forces = report.recording.pulses, report.recording.forces
    write_recording(tmp_path / 'dead', pulses, replace(forces, force=np.zeros(len(forces))))
    document = plain(make_report(tmp_path / 'dead'))
    assert document['residuals'] is None
    assert document['result']['output_error_of_range'] is None
    assert any('no residual analysis' in remark for remark in document['remarks'])


def test_the_first_section_is_the_verdict_with_its_reasons(report, page):
    verdict = report.result.verdict
    place = page.index(f'<strong>{verdict.grade}</strong>')
    assert place < page.index('<h2 id="recruitment-title">')
    assert verdict.reasons[0] in page
    for text in ('Steady force at 50 % intensity', 'Steady force at 100 %', 'What to do next'):
        assert page.index(text) < page.index('<h2 id="recruitment-title">')


def test_the_methods_can_be_copied_and_done_again(document, page):
    sentence = document['methods']['sentence']
    assert 'estimator recursive' in sentence
    assert '200 pulses and 10000 samples' in sentence
    assert set(document['methods']['versions']) >= {'rpms_ros', 'python', 'numpy', 'scipy'}
    assert sentence in page


@pytest.mark.usefixtures('without_figures')
def test_rates_are_told_with_their_intervals(report, with_last):
    assert report.result.rates is None
    bands = {'rate_lower': np.array([-32.0, -1.0]), 'rate_upper': np.array([-28.0, 1.0])}
    names = ('force_percent', 'time_constant_percent')
    page = as_page(with_last(rate_names=names, rate=np.array([-30.0, 0.25]), **bands))
    assert 'steady force, % a minute</th><td>-30</td><td>-32 to -28</td>' in page
    assert 'T_a of the twitch, % a minute</th><td>+0.25</td><td>-1 to +1</td>' in page


def test_sudden_changes_are_told_once_and_marked(report, with_session):
    kinds = {'changes': 1, 'change_kinds': ('thresholds',)}
    estimates = [
        replace(one, **kinds, change_ago=np.array([0.1 * index]))
        for index, one in enumerate(report.identified.estimates[-5:])
    ]
    every = [*report.identified.estimates[:-5], *estimates]
    marked = with_session(report, replace(report.identified, estimates=every))
    (change,) = marked.result.changes
    assert change.kind == 'thresholds'
    # the fifth to last estimate of ten seconds; the last one comes at the last sample
    assert change.time_s == pytest.approx(9.6, abs=0.11)
    assert marked.headline.steadiness.startswith('The coil probably moved at 9.')
    assert 'the coil after 10 s' in marked.headline.next_steps[0]
    figure = draw('parameters', marked)
    assert 'thresholds' in [text.get_text() for text in figure.axes[0].texts]
    assert change.reason in as_page(marked)


def test_effort_is_told_where_it_is_sure(report, with_last):
    assert report.headline.effort is None
    pushed = with_last(disturbance=2.5, disturbance_deviation=0.1).headline.effort
    assert pushed.startswith('Up to 2.5 N came from something else than the stimulation')
    assert with_last(disturbance=2.5, disturbance_deviation=2.0).headline.effort is None


@pytest.mark.parametrize(
    ('reason', 'step'),
    [
        ('the force comes out negative, -3 N: sign or axis of the sensor is wrong', '--sign'),
        ('the force spans 900 N: are these grams or millinewtons', '--force-unit'),
        ('something that has no advice', 'record again'),
    ],
)
def test_what_to_do_follows_from_the_reason(report, reason, step):
    doubted = replace(report.result, verdict=Verdict(grade='no', reasons=(reason,)))
    assert step in ' '.join(headline_of(doubted, report.identified).next_steps)


def test_nothing_is_claimed_where_the_verdict_is_no(report):
    verdict = Verdict(grade='no', reasons=('the identified muscle explains 3 % of the force',))
    result = replace(report.result, verdict=verdict, estimator='batch')
    found = headline_of(result, report.identified)
    assert found.steadiness == 'Not known.'
    assert found.next_steps == [
        'Look at the force below, and whether the intensity of each pulse was recorded.'
    ]
    made = report_of('it', report.recording, RecordedMessages(), report.identified, result)
    assert made.methods['sentence'] == (
        'No muscle was identified: the identified muscle explains 3 % of the force.'
    )


def test_a_recruitment_curve_is_claimed_only_where_there_is_one(report):
    verdict = Verdict(grade='good', reasons=('dynamics only',))
    result = replace(report.result, verdict=verdict, curve=None)
    made = report_of('it', report.recording, RecordedMessages(), report.identified, result)
    said = made.methods['sentence']
    assert said.startswith('The response to a pulse and its latency were identified with')
    assert 'recruitment' not in said


@pytest.mark.usefixtures('without_figures')
def test_the_first_screen_has_no_numbers_that_must_not_be_used(report):
    verdict = Verdict(grade='no', reasons=('the force comes out negative',))
    result = replace(report.result, verdict=verdict)
    page = as_page(replace(report, result=result))
    first = page[page.index('id="summary"') : page.index('<h2 id="recruitment-title">')]
    assert 'What to do next' in first
    assert 'The numbers are not shown here: the verdict is no.' in first
    for absent in ('Steady force at', 'Threshold', 'Error of prediction'):
        assert absent not in first


SAMPLES = 6000
STAMPS = np.arange(SAMPLES, dtype=np.int64) * 1_000_000
PULSES = PulseTrain.regular(np.random.default_rng(3).uniform(0.0, 1.0, 120), 20.0)


def noise(seed):
    return np.random.default_rng(seed).standard_normal(SAMPLES)


def test_white_residuals_look_white_as_often_as_the_band_says():
    found = [analyse_residuals(STAMPS, noise(seed), PULSES) for seed in range(40)]
    # 5 % of 400 lags in 40 runs: its standard deviation is 0.2 %, the tolerance is five of them
    for name in ('autocorrelation_outside', 'cross_correlation_outside'):
        outside = np.mean([getattr(one, name) for one in found])
        assert outside == pytest.approx(0.05, abs=0.01)


def test_a_coloured_residual_is_found():
    coloured = np.convolve(noise(1), [1.0, 0.5], mode='same')
    found = analyse_residuals(STAMPS, coloured, PULSES)
    # r(1) of that filter is 0.5 / 1.25; its deviation over 6000 samples is 0.01
    assert found.autocorrelation[1] == pytest.approx(0.4, abs=0.05)


def test_muscle_that_the_model_lacks_shows_after_its_delay():
    echo = np.zeros(SAMPLES)
    index = np.searchsorted(STAMPS, PULSES.onset_ns) + 40
    inside = index < SAMPLES
    echo[index[inside]] = PULSES.intensity[inside] - 0.5
    found = analyse_residuals(STAMPS, 0.02 * noise(4) + echo, PULSES)
    peak = int(np.argmax(found.cross_correlation))
    assert found.cross_lag_s[peak] == pytest.approx(0.04)
    assert found.cross_correlation[peak] > 3 * found.cross_correlation_band


def test_a_pulse_counts_for_the_first_sample_that_it_can_act_on():
    train = PulseTrain(
        np.array([-1, 0, 1, 2_000_000, 9_000_000_000]),
        np.array([0.1, 0.2, 0.3, np.nan, 0.5]),
        np.arange(5),
        np.full(5, 1e-4),
    )
    assert stimulation_at(STAMPS, train)[:4].tolist() == [0.2, 0.3, 0.0, 0.0]


@pytest.mark.parametrize(
    ('stamps', 'residual', 'expected'),
    [
        (STAMPS[:49], noise(0)[:49], 'at least 50 residuals, got 49'),
        (STAMPS, np.zeros(SAMPLES), 'residuals that differ, got 0.0 only'),
        (STAMPS[::-1], noise(0), 'ascending stamps, got a clock that jumped'),
    ],
)
def test_residuals_that_tell_nothing_are_refused(stamps, residual, expected):
    with pytest.raises(ReportError, match=expected):
        analyse_residuals(stamps, residual, PULSES)
