# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The first screen: verdict, forces, steadiness, what is different from last time, advice."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rpms_ros.errors import ReportError
from rpms_ros.identification.quality.verdict import Verdict
from rpms_ros.report.result import result_of
from rpms_ros.report.session import SessionAnalysis, as_document, as_page
from rpms_ros.report.session.analysis import headline_of
from rpms_ros.report.session.figures import draw
from rpms_ros.report.session.page import CAPTIONS


def with_last(analysis: SessionAnalysis, **fields: Any) -> SessionAnalysis:
    last = replace(analysis.session.last, **fields)
    session = replace(analysis.session, estimates=[*analysis.session.estimates[:-1], last])
    result = result_of(analysis.recording, session)
    return replace(analysis, session=session, result=result, headline=headline_of(result, session))


def test_the_first_section_is_the_verdict_with_its_reasons(
    analysis: SessionAnalysis, page: str
) -> None:
    verdict = analysis.result.verdict
    place = page.index(f'<strong>{verdict.grade}</strong>')
    assert place < page.index('<h2 id="recruitment-title">')
    assert verdict.reasons[0] in page
    for text in ('Steady force at 50 % intensity', 'Steady force at 100 %', 'What to do next'):
        assert page.index(text) < page.index('<h2 id="recruitment-title">')


def test_every_figure_has_a_sentence(page: str) -> None:
    for text in CAPTIONS.values():
        assert f'<figcaption>{text}</figcaption>' in page


def test_the_methods_can_be_copied_and_done_again(document: dict[str, Any], page: str) -> None:
    sentence = document['methods']['sentence']
    assert 'estimator recursive' in sentence
    assert '200 pulses and 10000 samples' in sentence
    assert set(document['methods']['versions']) >= {'rpms_ros', 'python', 'numpy', 'scipy'}
    assert sentence in page


def test_rates_are_told_with_their_intervals(analysis: SessionAnalysis) -> None:
    assert analysis.headline.rates == []
    bands = {'rate_lower': np.array([-32.0, -1.0]), 'rate_upper': np.array([-28.0, 1.0])}
    names = ('force_percent', 'time_constant_percent')
    changed = with_last(analysis, rate_names=names, rate=np.array([-30.0, 0.25]), **bands)
    page = as_page(changed, as_document(changed))
    assert 'steady force, % a minute</th><td>-30</td><td>-32 to -28</td>' in page
    assert 'T_a of the twitch, % a minute</th><td>+0.25</td><td>-1 to +1</td>' in page


def test_sudden_changes_are_told_once_and_marked(analysis: SessionAnalysis) -> None:
    kinds = {'changes': 1, 'change_kinds': ('thresholds',)}
    estimates = [
        replace(one, **kinds, change_ago=np.array([0.1 * index]))
        for index, one in enumerate(analysis.session.estimates[-5:])
    ]
    session = replace(analysis.session, estimates=[*analysis.session.estimates[:-5], *estimates])
    headline = headline_of(analysis.result, session)
    (change,) = headline.changes
    assert change.kind == 'thresholds'
    # the fifth to last estimate of ten seconds; the last one comes at the last sample
    assert change.time_s == pytest.approx(9.6, abs=0.11)
    assert headline.steadiness.startswith('The coil probably moved at 9.')
    assert 'the coil after 10 s' in headline.next_steps[0]
    marked = replace(analysis, session=session, headline=headline)
    figure = draw('parameters', marked)
    assert 'thresholds' in [text.get_text() for text in figure.axes[0].texts]
    assert change.reason in as_page(marked, as_document(marked))


def test_effort_is_told_where_it_is_sure(analysis: SessionAnalysis) -> None:
    assert analysis.headline.effort is None
    pushed = with_last(analysis, disturbance=2.5, disturbance_deviation=0.1).headline.effort
    assert pushed is not None
    assert pushed.startswith('Up to 2.5 N came from something else than the stimulation')
    assert with_last(analysis, disturbance=2.5, disturbance_deviation=2.0).headline.effort is None


def test_the_difference_from_the_last_session_is_told(analysis: SessionAnalysis) -> None:
    half = json.loads(json.dumps(as_document(analysis)))
    half['result']['curve']['force'] = [0.5 * f for f in half['result']['curve']['force']]
    first, second = headline_of(analysis.result, analysis.session, half).previous
    assert '(+100 %)' in first
    assert '(+100 %)' in second
    same = headline_of(analysis.result, analysis.session, as_document(analysis)['result']).previous
    assert all('hardly a difference' in text for text in same)


def test_intervals_decide_whether_there_is_a_difference(analysis: SessionAnalysis) -> None:
    force = analysis.session.last.curve_force
    bands = {'curve_lower': force - 0.5, 'curve_upper': force + 0.5, 'confidence': 0.95}
    known = with_last(analysis, **bands)
    for factor, words in ((1.0, 'no difference'), (0.3, 'more than the intervals allow for')):
        earlier = json.loads(json.dumps(as_document(known)))['result']
        for name in ('force', 'lower', 'upper'):
            earlier['curve'][name] = [factor * value for value in earlier['curve'][name]]
        text = headline_of(known.result, known.session, earlier).previous[-1]
        assert text.endswith(f'{words}.')


@pytest.mark.parametrize('previous', [{}, {'curve': {}, 'rate_hz': 20}, {'result': 3}])
def test_something_else_than_an_earlier_session_is_refused(
    analysis: SessionAnalysis, previous: dict[str, Any]
) -> None:
    with pytest.raises(ReportError, match='expected what `rpms identify --json` or'):
        headline_of(analysis.result, analysis.session, previous)


@pytest.mark.parametrize(
    ('reason', 'step'),
    [
        ('the force comes out negative, -3 N: sign or axis of the sensor is wrong', '--sign'),
        ('the force spans 900 N: are these grams or millinewtons', '--force-unit'),
        ('something that has no advice', 'record again'),
    ],
)
def test_what_to_do_follows_from_the_reason(
    analysis: SessionAnalysis, reason: str, step: str
) -> None:
    doubted = replace(analysis.result, verdict=Verdict(grade='no', reasons=(reason,)))
    assert step in ' '.join(headline_of(doubted, analysis.session).next_steps)


def test_the_first_screen_has_no_numbers_that_must_not_be_used(
    analysis: SessionAnalysis, document: dict[str, Any]
) -> None:
    refused = json.loads(json.dumps(document))
    refused['result']['verdict'] = {'grade': 'no', 'reasons': ['the force comes out negative']}
    refused['headline']['previous'] = ['Force at full intensity: 3 N more.']
    page = as_page(analysis, refused)
    first = page[page.index('id="summary"') : page.index('<h2 id="recruitment-title">')]
    assert 'What to do next' in first
    assert 'The numbers are not shown here: the verdict is no.' in first
    for absent in ('Steady force at', 'Threshold', 'Error of prediction', '3 N more'):
        assert absent not in first


def test_a_clock_without_a_date_is_not_taken_for_1970(
    analysis: SessionAnalysis, document: dict[str, Any]
) -> None:
    early = json.loads(json.dumps(document))
    early['session']['start_ns'] = 500_000_000
    page = as_page(analysis, early)
    assert '1970-01-01' not in page
    assert 'not known: the stamps begin at 0.5 s' in page


def test_errors_are_newtons_and_shares_of_the_range(analysis: SessionAnalysis, page: str) -> None:
    fit = analysis.held_out
    assert fit is not None
    assert fit.error_n == pytest.approx(np.sqrt(np.mean((fit.force - fit.prediction) ** 2)))
    assert 0.0 < fit.error_of_range < 0.1
    for text in ('explained variance', '|y - mean|'):
        assert text not in page
