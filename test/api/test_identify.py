# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The result of an identification in Python is that of the command, with its truth inside."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import rpms_ros
from rpms_ros import RpmsError
from rpms_ros.cli import main
from rpms_ros.identification.quality.doubts import SLOW_INTENSITIES
from rpms_ros.stimulation import Schedule, Single

SAMPLE = Path(__file__).resolve().parents[2] / 'bags' / 'sample'


@pytest.mark.long
def test_it_is_what_the_command_prints(capsys):
    assert main(['identify', str(SAMPLE), '--estimator', 'batch', '--json', '--quiet']) == 0
    printed = json.loads(capsys.readouterr().out)
    result = rpms_ros.load(SAMPLE).identify()
    assert result.estimator == 'batch'
    assert result.to_dict() == printed
    assert json.loads(result.to_json()) == printed


def test_the_truth_of_a_simulated_muscle_is_found(found):
    subject = found.session.subject
    assert found.curve is not None
    for intensity in (0.5, 0.75, 1.0):
        stated = found.force_at(intensity)
        truth = float(subject.steady_force(intensity, 20.0))
        # 0.02 N of noise on 10 N; the interval is about 0.3 % of that
        assert stated.value == pytest.approx(truth, abs=0.05)
        assert stated.lower < stated.value < stated.upper
    assert found.parameters['u_thr'].value == pytest.approx(0.48, abs=0.01)
    assert found.parameters['u_sat'].value == pytest.approx(0.98, abs=0.01)
    assert found.parameters['twitch_peak_n'].unit == 'N'


def test_intervals_of_parameters_hold_their_values(found):
    for name, one in found.parameters.items():
        assert one.lower <= one.value < one.upper, name
    slope = found.parameters['alpha_sat']
    # symmetric in the logarithm
    assert slope.upper / slope.value == pytest.approx(slope.value / slope.lower, rel=1e-12)
    deviation = found.result.deviation
    width = found.parameters['u_thr'].upper - found.parameters['u_thr'].value
    assert width == pytest.approx(1.959964 * deviation['u_thr'], rel=1e-6)


def test_the_verdict_on_a_force_of_the_wrong_sign_is_no(simulated):
    force = replace(simulated.force, force=-simulated.force.force)
    wrong = replace(simulated, recording=replace(simulated.recording, forces=force))
    found = wrong.identify()
    assert found.verdict.grade == 'no'
    assert 'sign or axis of the sensor is wrong' in found.verdict.line
    # nor has its text numbers that could be used
    assert 'u_thr' not in str(found) + found._repr_html_()


def test_the_text_is_that_of_the_command(found, tmp_path, capsys):
    found.session.save(tmp_path / 'leg')
    assert main(['identify', str(tmp_path / 'leg'), '--quiet']) == 0
    assert capsys.readouterr().out.splitlines()[1:] == str(found).splitlines()[1:]
    assert str(found).startswith('simulated, uniform_random\n  verdict ')
    shown = replace(found, session=replace(found.session, name='<b>leg</b>'))._repr_html_()
    assert shown.startswith('<pre>&lt;b&gt;leg&lt;/b&gt;\n  verdict')
    assert repr(found) == (
        f"Identification('simulated, uniform_random', 'batch', {found.verdict.line!r})"
    )


def test_one_intensity_has_no_curve_but_a_response():
    result = rpms_ros.simulate('constant', duration=5.0, intensity=0.7).identify()
    assert result.curve is None
    assert len(result.response.force) == len(result.response.time_s) > 50
    assert any('one intensity' in note for note in result.result.notes)
    assert 'u_thr' not in result.parameters
    with pytest.raises(RpmsError, match='expected pulses of several intensities'):
        result.force_at(0.5)


@pytest.mark.parametrize('schedule', ['sinusoid', 'uniform_random'])
def test_slow_intensities_are_said_not_to_show_the_response(schedule):
    result = rpms_ros.simulate(schedule, duration=20.0, noise=0.02).identify().result
    assert (SLOW_INTENSITIES in result.notes) is (schedule == 'sinusoid')


def test_single_twitches_show_the_response_whatever_their_order():
    schedule = Schedule(tuple(Single(0.02 * k, duration_s=1.0) for k in range(51)))
    result = rpms_ros.simulate(schedule, noise=0.02).identify().result
    assert SLOW_INTENSITIES not in result.notes


def test_two_seconds_of_a_muscle_are_good():
    # predictions before all was learnt are of a basis that was searched for by then
    assert rpms_ros.simulate(duration=2.0).identify('batch').verdict.grade == 'good'


def test_no_curve_from_pulses_on_another_clock_is_not_called_one_intensity():
    session = rpms_ros.simulate(duration=5.0)
    pulses = session.pulses
    late = replace(pulses, onset_ns=pulses.onset_ns + 3_600_000_000_000)
    result = replace(session, recording=replace(session.recording, pulses=late)).identify()
    assert result.result.notes == []
    assert 'they do not overlap' in result.verdict.line
    with pytest.raises(RpmsError, match='recruitment curve, got no: clocks_differ: pulses are'):
        result.force_at(0.5)


@pytest.mark.parametrize('intensity', [-0.1, 1.1, float('nan'), '0.5', None])
def test_a_force_outside_the_curve_is_refused(found, intensity):
    with pytest.raises(RpmsError, match='expected an intensity from 0 to 1'):
        found.force_at(intensity)


def test_an_estimator_on_line_keeps_a_path_of_estimates(simulated):
    taken: list[int] = []
    result = simulated.identify('tracking', most_estimates=10, progress=taken.append)
    # fifteen seconds every 1.6 s, a power of two of the period on line, and the last one
    assert len(result.estimates.estimates) == 10
    assert sum(taken) == len(simulated.force)


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ({'estimator': 'magic'}, "expected an estimator of .*, got 'magic'"),
        ({'preset': 'table_7'}, 'expected .*table_7'),
        ({'most_estimates': 0}, 'expected most_estimates as a whole number from 1 on, got 0'),
        ({'most_estimates': -1}, 'expected most_estimates .*, got -1'),
        ({'most_estimates': 2.5}, 'expected most_estimates .*, got 2.5'),
        ({'seed': -1}, 'expected a seed, '),
        ({'rate_hz': 0.0}, 'expected .*rate.*0'),
        ({'rate_hz': '20'}, "expected a repetition rate from 0.1 to 1000 Hz, got '20'"),
    ],
)
def test_a_wrong_option_is_named(simulated, options, message):
    with pytest.raises(RpmsError, match=message):
        simulated.identify(**options)


def test_the_figure_can_be_shown_and_saved(found, tmp_path):
    figure = found.plot()
    try:
        assert plt.fignum_exists(figure.number)
        assert len(figure.axes) == 4
        assert figure.get_suptitle() == 'simulated, uniform_random'
    finally:
        plt.close(figure)
    own = Figure()
    assert found.plot(own) is own
    own.savefig(tmp_path / 'own.png')
    assert (tmp_path / 'own.png').stat().st_size > 10_000
