# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a browser gets: everything once, in valid JSON, whatever was published."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.live.force_course import BIN_NS, ModelledForce
from rpms_ros.live.live_session import Cursor
from rpms_ros.live.topic_health import LONGEST_TEXT, MOST_NAMES, Publisher
from rpms_ros.muscle.recruitment import (
    RateRecruitment,
    RecruitmentParameters,
    identified_recruitment,
)
from rpms_ros.pulses import Pulse

MILLISECOND = 1_000_000


def feed(session, start_ns, first, last):
    index = np.arange(first, last)
    session.force(start_ns + index * MILLISECOND, 0.001 * index)
    session.advance(0.0)


def valid(frame):
    """What a browser makes of a frame."""
    return json.loads(json.dumps(frame, allow_nan=False))


def test_frames_one_after_another_are_the_whole_course(session, start_ns):
    cursor, low = Cursor(), []
    for step in range(40):
        feed(session, start_ns, 50 * step, 50 * step + 50)
        cursor, frame = session.frame(cursor)
        if frame is not None and 'force' in frame:
            assert frame['force']['first'] == len(low)
            low += frame['force']['low']
    # the last tenth of a second waits for pulses, the last bin for its end
    assert len(low) == 400 - 20 - 1
    assert low == pytest.approx([0.005 * index for index in range(len(low))])


def test_the_modelled_force_is_the_sum_of_the_responses(make_estimate, start_ns):
    model, estimate = ModelledForce(), make_estimate()
    stamps, unknown = start_ns + np.arange(200) * BIN_NS, np.full(200, np.nan)
    assert np.isnan(model.at(stamps, unknown)).all()
    model.estimate(estimate)
    pulses = [(0.1, 1.0), (0.15, 0.5), (5.0, 1.0)]
    for onset, intensity in pulses:
        model.pulse(start_ns + round(onset * 1e9), intensity)
    parameters = RecruitmentParameters(*estimate.nonlinear)
    rho = identified_recruitment(parameters, [1.0, 0.5])
    time = np.arange(200) * 0.005
    # the newest level of the baseline is 0.5 N
    expected = np.full(200, 0.5)
    response = estimate.response_time, estimate.response_force
    for (onset, _), share in zip(pulses[:2], rho / rho[0], strict=True):
        expected += share * np.interp(time - onset, *response, left=0.0, right=0.0)
    # the same sum in another order
    np.testing.assert_allclose(model.at(stamps, unknown), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize('by_rate', [True, False])
def test_pulses_at_another_rate_weigh_as_in_what_was_measured(make_estimate, start_ns, by_rate):
    """Without their weight the force of a good estimate was 1.7 times that of the sensor."""
    model, estimate = ModelledForce(), make_estimate()
    model.estimate(estimate)
    onset_ns = start_ns + np.arange(50) * 20_000_000
    for onset in onset_ns.tolist():
        model.pulse(onset, 1.0)
    stamps, time = start_ns + np.arange(200) * BIN_NS, np.arange(200) * 0.005
    weight = RateRecruitment().of_train(onset_ns, estimate.repetition_rate)
    assert abs(weight[-1] - 1.0) > 0.2
    lag = time[:, None] - 1e-9 * (onset_ns - start_ns)
    response = estimate.response_time, estimate.response_force
    caused = np.interp(lag, *response, left=0.0, right=0.0)
    measured = 0.5 + caused @ (weight if by_rate else np.ones(50))
    np.testing.assert_allclose(model.at(stamps, measured), measured, rtol=1e-9)
    # no number of anybody takes the force away
    model.estimate(replace(estimate, repetition_rate=math.nan))
    assert np.isfinite(model.at(stamps, measured)).all()


def test_after_a_jump_of_the_clock_earlier_pulses_do_not_act(session, make_estimate, start_ns):
    session.estimate(make_estimate())
    feed(session, start_ns, 0, 1000)
    for step in range(20):
        session.pulse(Pulse(start_ns + step * 50 * MILLISECOND, 1.0, step))
    feed(session, start_ns, -5000, -3000)
    feed(session, start_ns, -3000, 1000)
    # the baseline alone
    modelled = session.frame(Cursor())[1]['force']['modelled']
    assert modelled[-300:] == [0.5] * 300


def test_an_estimate_in_another_unit_is_an_alarm_and_no_force(session, make_estimate, start_ns):
    session.estimate(make_estimate(unit='N m'))
    feed(session, start_ns, 0, 1000)
    frame = session.frame(Cursor())[1]
    assert 'identifier tells N m, this page reads N' in frame['top']['alarms']
    assert set(frame['force']['modelled']) == {None}


def test_parameters_have_their_band_and_what_the_data_lack_is_not_printed(session, make_estimate):
    session.estimate(
        make_estimate(
            nonlinear_covariance=np.diag([0.01**2, 0.02**2, 1.0, 1.0]),
            nonlinear_identifiability=np.array([2, 1, 0, 7]),
            confidence=0.95,
        )
    )
    rows = valid(session.frame(Cursor())[1])['estimate']['parameters']
    # 1.96 standard deviations
    assert rows[0][:4] == ['threshold u_thr', 0.3, pytest.approx(0.2804), pytest.approx(0.3196)]
    assert [row[4] for row in rows] == ['settled', 'still moving', 'not in the data', '']
    assert rows[2][1:4] == [None, None, None]


def test_changes_rates_doubts_and_faults_are_there(session, make_estimate, start_ns):
    feed(session, start_ns, 0, 1500)
    session.estimate(
        make_estimate(
            changes=3,
            change_kinds=('gain', 'thresholds'),
            change_ago=np.array([0.75, 0.25]),
            rate_names=('force_percent',),
            rate=np.array([-2.0]),
            rate_lower=np.array([-3.0]),
            rate_upper=np.array([-1.0]),
            disturbance=0.1,
            disturbance_deviation=0.02,
            doubts=('force_spike',),
            reasons=('one intensity only',),
            faults={'force_spike': 3, 'of_somebody_else': 1},
        )
    )
    view = valid(session.frame(Cursor())[1])['estimate']
    assert view['marks'] == [['gain', 0.25], ['thresholds', 0.75]]
    assert view['rates'] == [['steady force, % a minute', -2.0, -3.0, -1.0]]
    assert (view['changes'], view['disturbance'], view['unit']) == (3, 0.1, 'N')
    assert view['doubts'][0][0] == 'force_spike'
    assert 'not learnt from' in view['doubts'][0][1]
    assert view['faults'][1] == ['of_somebody_else', 1, '']
    assert view['reasons'] == ['one intensity only']


def test_the_disturbance_is_a_course_of_its_own(session, make_estimate, start_ns):
    feed(session, start_ns, 0, 1500)

    def told(milliseconds, value, deviation=0.1):
        stamp_ns = start_ns + milliseconds * MILLISECOND
        session.estimate(
            make_estimate(stamp_ns=stamp_ns, disturbance=value, disturbance_deviation=deviation)
        )

    told(200, 1.0)
    told(400, math.nan)
    told(500, 5.0, 0.0)  # not known
    told(600, 2.0, 0.2)
    cursor, frame = session.frame(Cursor())
    assert valid(frame)['disturbance'] == [[0.2, 1.0, 0.1], [0.6, 2.0, 0.2]]
    told(800, 3.0)
    cursor, frame = session.frame(cursor)
    assert valid(frame)['disturbance'] == [[0.8, 3.0, 0.1]]
    # a stamp from before begins anew, so that times ascend
    told(700, 4.0)
    assert valid(session.frame(cursor)[1])['disturbance'] == [[0.7, 4.0, 0.1]]
    assert valid(session.frame(Cursor())[1])['disturbance'] == [[0.7, 4.0, 0.1]]


def test_numbers_that_are_not_finite_are_null(session, make_estimate, make_status, start_ns):
    bad = np.full(101, math.nan)
    session.estimate(
        make_estimate(
            curve_force=bad,
            curve_lower=bad,
            curve_upper=bad + math.inf,
            output_error=math.inf,
            nonlinear=np.array([math.nan, math.inf, 0.0, 1.0]),
            nonlinear_covariance=np.full((4, 4), -1.0),
            confidence=0.95,
            disturbance=math.nan,
        )
    )
    session.driver(make_status(coil_temperature=math.nan, time_left=math.inf))
    session.pulse(Pulse(start_ns, math.nan, 1, 1e-4))
    feed(session, start_ns, 0, 1000)
    frame = valid(session.frame(Cursor())[1])
    assert set(frame['estimate']['curve']['force']) == {None}
    assert frame['driver']['coil_temperature'] is None
    assert 'pulses' not in frame
    assert '1 pulse with an intensity outside 0..1' in frame['topics'][1]['text']


def test_an_estimate_of_any_size_makes_a_small_frame(session, make_estimate):
    many = 200_000
    along = np.linspace(0.0, 1.0, many)
    curve = ('curve_intensity', 'curve_force', 'curve_lower', 'curve_upper')
    lines = (*curve, 'response_time', 'response_force')
    session.estimate(
        make_estimate(
            estimator='x' * 10_000,
            **dict.fromkeys(lines, along),
            reasons=tuple('y' * 10_000 for _ in range(1000)),
            faults={f'fault {index}': 1 for index in range(1000)},
        )
    )
    frame = valid(session.frame(Cursor())[1])
    assert len(json.dumps(frame)) < 60_000
    assert len(frame['estimate']['reasons']) == len(frame['estimate']['faults']) == MOST_NAMES
    assert len(frame['estimate']['estimator']) <= LONGEST_TEXT + 2
    assert frame['estimate']['curve']['along'][0::100] == [0.0, 1.0]


def test_a_jump_of_the_clock_tells_the_browser_to_begin_anew(session, start_ns):
    feed(session, start_ns, 0, 1000)
    for index in range(20):
        session.pulse(Pulse(start_ns + 50 * index * MILLISECOND, 0.5, index))
    session.advance(0.0)
    cursor, first = session.frame(Cursor())
    assert len(first['pulses']) == 20
    session.pulse(Pulse(start_ns - 10**12 + 30 * MILLISECOND, 0.25, 20))
    feed(session, start_ns - 10**12, 0, 1000)
    _, again = session.frame(cursor)
    assert (first['force']['epoch'], again['force']['epoch']) == (0, 1)
    assert again['force']['first'] == 0
    # no pulse from before is sent again; the epoch begins with the fifth sample of the new clock
    assert again['pulses'] == [[pytest.approx(0.03, abs=0.005), 0.25]]


def test_the_driver_is_sent_when_it_changes(session, make_status):
    session.driver(make_status())
    cursor, frame = session.frame(Cursor())
    view = valid(frame)['driver']
    assert (view['state'], view['segment'], view['segments']) == ('running', 1, 2)
    assert view['buttons'] == [['/stop_button', 'released']]
    session.driver(make_status())
    assert session.frame(cursor)[1] is None
    session.driver(make_status(state=4, reason='emergency stop\n is pressed'))
    assert session.state == 'stopped'
    view = session.frame(cursor)[1]['driver']
    assert (view['state'], view['reason']) == ('stopped', 'emergency stop  is pressed')
    session.driver(make_status(state=9, button_states=[77]))
    view = session.frame(cursor)[1]['driver']
    assert (view['state'], view['buttons'][0][1]) == ('state 9', 'state 77')


def top_at(session, now):
    """What stands on top of the page at a time [s], for a browser that comes then."""
    session.advance(now)
    return valid(session.frame(Cursor())[1])['top']


def test_a_dead_identifier_is_an_alarm_on_top(session, make_estimate):
    session.estimate(make_estimate())
    session.topics['estimate'].heard(1, 0.0)
    assert (top_at(session, 1.0)['old'], top_at(session, 1.0)['alarms']) == (False, [])
    top = top_at(session, 12.0)
    assert top['old']
    assert top['alarms'] == ['identifier silent for 12 s: curve, parameters and doubts are old']
    session.topics['estimate'].heard(1, 20.0)
    session.topics['estimate'].refused = 'of another version'
    assert top_at(session, 20.5)['old']


def test_the_next_step_of_the_operator_is_on_top(session, make_status):
    assert top_at(session, 0.0)['next'] == ''
    words = 'Configure', 'Arm', 'Start', 'Watch', 'reset the stop', 'clean'
    for state, word in enumerate(words):
        session.driver(make_status(state=state))
        session.topics['driver_status'].heard(1, 1.0 + state)
        assert word in top_at(session, 1.0 + state)['next']
    assert 'switch of the stimulator' in top_at(session, 60.0)['next']


def test_before_the_first_curve_the_page_says_how_long_it_takes(session, make_estimate):
    assert top_at(session, 100.0)['waiting'] == 'compiling, first curve in about 60 s'
    assert top_at(session, 143.0)['waiting'] == 'compiling, first curve in about 20 s'
    assert top_at(session, 190.0)['waiting'].startswith('no identifier for 90 s')
    session.topics['estimate'].publishers = [Publisher('/identifier', '')]
    assert top_at(session, 191.0)['waiting'] == 'the identifier waits for force'
    session.estimate(make_estimate())
    assert top_at(session, 192.0)['waiting'] == ''


def test_a_button_is_called_by_its_node_and_the_page_by_itself(session, make_status):
    unnamed = '030f78fd' * 4
    told = []
    for name in ('/live_page', '/live_page_2', unnamed):
        reason = f'emergency stop is pressed ({name})'
        session.driver(make_status(state=4, reason=reason, button_names=[name]))
        view = session.frame(Cursor())[1]['driver']
        told.append((view['reason'], view['buttons'][0][0]))
    assert told == [
        ('emergency stop is pressed by this page', 'this page'),
        ('emergency stop is pressed (/live_page_2)', '/live_page_2'),
        ('emergency stop is pressed (a button not named yet)', 'a button not named yet'),
    ]
