# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The page on many recordings: what it counts, compares and draws, and that it stays one page."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rpms_ros.report.group import group_document, half_width
from rpms_ros.report.page import as_group_page, embedded

DAY_NS = 86_400_000_000_000
START_NS = 1_700_000_000_000_000_000
HOSTILE = '</script><script>alert(1)</script>$x$'


def row(number: int, **change: Any) -> dict[str, Any]:
    """A row of a study, one day after the one before."""
    return {
        'recording': f'ada/visit{number}',
        'status': 'ok',
        'reason': None,
        'verdict': 'good',
        'reasons': 'explains 99 %',
        'session_hash': f'hash {number}',
        'start_ns': START_NS + number * DAY_NS,
        'confidence': 0.95,
        'u_thr': 0.4,
        'u_thr_lower': 0.39,
        'u_thr_upper': 0.41,
        'steady_force_50': 4.0,
        'steady_force_50_lower': 3.9,
        'steady_force_50_upper': 4.1,
        'steady_force_100': 10.0 + number,
        'steady_force_100_lower': 9.9 + number,
        'steady_force_100_upper': 10.1 + number,
        'twitch_time_constant_s': 0.04,
        'twitch_time_constant_s_lower': None,
        'twitch_time_constant_s_upper': None,
        **change,
    }


def changes(document: dict[str, Any]) -> dict[str, Any]:
    columns = (one['column'] for one in document['quantities'])
    return dict(zip(columns, document['changes'], strict=True))


def test_sessions_are_ordered_by_their_dates_and_compared() -> None:
    rows = [row(5), row(1), row(2)]
    document = group_document(rows, 'Ada', one_person=True)
    assert [one['name'] for one in document['recordings']] == ['visit1', 'visit2', 'visit5']
    assert [one['day'] for one in document['recordings']] == [0.0, 1.0, 4.0]
    told = changes(document)
    force = told['steady_force_100']
    assert force['now']['value'] == 15.0
    assert force['last']['change']['value'] == pytest.approx(3.0)
    # two intervals of 0.1 N either way
    assert force['last']['change']['lower'] == pytest.approx(3.0 - 0.1 * np.sqrt(2.0))
    assert (force['last']['beyond'], force['first']['beyond']) == (True, True)
    assert force['first']['session'] == 1
    assert told['u_thr']['last']['beyond'] is False
    assert told['twitch_time_constant_s']['last']['beyond'] is None
    assert document['remarks'] == []


def test_doubtful_recordings_in_the_means_are_named(tmp_path: Path) -> None:
    rows = [row(1), row(2, verdict='doubtful'), row(3, verdict='no'), row(4, verdict='doubtful')]
    document = group_document(rows, 'Ada', one_person=False)
    assert document['doubtful'] == ['visit2', 'visit4']
    page = as_group_page(document, tmp_path)
    assert 'The means include 2 doubtful recordings: visit2, visit4.' in page
    page = as_group_page(group_document(rows[:2], 'Ada', one_person=False), tmp_path)
    assert 'The means include 1 doubtful recording: visit2.' in page
    page = as_group_page(group_document(rows[:1], 'Ada', one_person=False), tmp_path)
    assert 'The means include' not in page


def test_a_study_of_torques_is_in_newton_metres() -> None:
    document = group_document([row(1, unit='N m'), row(2, unit='N m')], 'Ada', one_person=True)
    units = {one['label']: one['unit'] for one in document['quantities']}
    assert units == {
        'Threshold': '%',
        'Torque at 50 %': 'N m',
        'Torque at 100 %': 'N m',
        'T_a': 'ms',
    }
    assert 'Torque at 100 % / N m' in as_group_page(document, Path())


def test_what_must_not_be_used_is_not_there() -> None:
    bad = row(3, verdict='no', reasons='wrong sign', steady_force_100=-99.0)
    failed = {'recording': 'ada/x', 'status': 'failed', 'reason': 'nothing', 'verdict': None}
    document = group_document([row(1), bad, failed], 'Ada', one_person=True)
    assert document['verdicts'] == {'good': 1, 'doubtful': 0, 'no': 1, 'failed': 1}
    assert '-99' not in json.dumps(document)
    assert document['recordings'][1]['measured']['steady_force_100'] is None
    assert changes(document)['steady_force_100']['now']['value'] == 11.0
    assert changes(document)['steady_force_100']['last'] is None
    assert [one['reasons'] for one in document['recordings'][1:]] == ['wrong sign', 'nothing']


def test_a_recording_that_is_given_twice_and_a_missing_date_are_named() -> None:
    rows = [row(1), row(2, session_hash='hash 1', start_ns=5)]
    document = group_document(rows, 'Ada', one_person=True)
    first, second = document['remarks']
    assert first.startswith('ada/visit1, ada/visit2 hold the same pulses and forces')
    assert second.startswith('Not every session has a date')
    assert document['recordings'][1]['date'] is None


def test_time_constants_of_different_models_are_not_compared_without_a_word() -> None:
    law, equal = {'train_model': 'history law'}, {'train_model': 'equal pulses'}
    (remark,) = group_document([row(1), row(2, **law), row(3, **law)], 'x', False)['remarks']
    assert 'of different models (history law, response to one pulse)' in remark
    assert group_document([row(1, **law), row(2, **law)], 'x', False)['remarks'] == []
    # what must not be used is not in the means
    rows = [row(1, **law), row(2, **equal, verdict='no')]
    assert group_document(rows, 'x', False)['remarks'] == []


def test_the_spread_of_several_recordings() -> None:
    rows = [row(number, twitch_time_constant_s=None) for number in (1, 2, 3)]
    document = group_document([*rows, row(9, verdict='no')], 'legs', one_person=False)
    found = dict(
        zip([one['column'] for one in document['quantities']], document['spread'], strict=True)
    )
    assert found['steady_force_100'] == pytest.approx(
        {'count': 3, 'mean': 12.0, 'median': 12.0, 'lowest': 11.0, 'highest': 13.0, 'deviation': 1}
    )
    (single, *_) = group_document([row(1)], 'leg', one_person=False)['spread']
    assert (single['count'], single['deviation']) == (1, None)


def page(rows: list[dict[str, Any]], one_person: bool = False) -> str:
    return as_group_page(group_document(rows, HOSTILE, one_person), Path('out/study'))


@pytest.mark.parametrize('one_person', [False, True])
def test_hostile_names_stay_text(one_person: bool) -> None:
    rows = [
        row(1, recording=f'a/{HOSTILE}', reasons=HOSTILE),
        row(2, recording='javascript:alert(1)'),
    ]
    text = page(rows, one_person)
    assert 'alert(1)</script>' not in text.replace('\\u003c/script\\u003e', '')
    assert text.count('<script') == 1
    assert 'href="javascript' not in text
    assert embedded(text, 'group')['title'] == HOSTILE


@pytest.mark.parametrize('count', [0, 1, 200])
@pytest.mark.parametrize('one_person', [False, True])
def test_any_number_of_recordings_is_a_page_below_the_limit(count: int, one_person: bool) -> None:
    text = page([row(number) for number in range(count)], one_person)
    assert len(text.encode()) < 1.5e6
    assert text.count('class="grade good"') == count
    assert re.findall(r'(?:src|href)="(?!data:|#|\./)', text) == []


@pytest.mark.long
def test_a_browser_shows_it_on_a_phone(beside: Callable[[str], Any], tmp_path: Path) -> None:
    (tmp_path / 'index.html').write_text(page([row(1), row(2)], one_person=True))
    with beside('devtools').Browser(tmp_path / 'profile') as browser:
        for dark in (False, True):
            browser.screen(390, dark=dark)
            browser.open(f'file://{tmp_path}/index.html')
            assert browser.complaints() == []
            # tables scroll in themselves, the page does not
            assert browser.evaluate('document.documentElement.scrollWidth <= innerWidth')
            assert browser.evaluate('document.images[0].naturalWidth > 0')
            assert browser.evaluate('document.images[0].alt.length > 20')
            for width in (390, 1100):
                browser.screen(width, dark=dark)
                browser.evaluate(
                    'document.querySelectorAll("details").forEach((one) => { one.open = true; })'
                )
                assert browser.accessibility_faults() == [], (width, dark)
                assert browser.beyond_the_keyboard() == [], (width, dark)
        browser.open(f'file://{tmp_path}/index.html')
        asked = [one for one in browser.requested() if not one.startswith(('file:', 'data:'))]
        assert asked == []
        assert browser.evaluate('document.querySelectorAll("details[open]").length') == 0
        browser.evaluate('document.querySelector("a[href=\\"#r2\\"]").click()')
        browser.wait_for('document.querySelectorAll("details[open]").length === 1')


def test_what_no_recording_has_is_left_out() -> None:
    none = dict.fromkeys(name for name in row(1) if name.startswith(('u_', 'steady')))
    rows = [row(number, **none, train_peak_force=3.0 + number) for number in (1, 2, 3)]
    document = group_document(rows, 'rats', one_person=True)
    columns = [one['column'] for one in document['quantities']]
    assert columns == ['twitch_time_constant_s', 'train_peak_force']
    assert changes(document)['train_peak_force']['first']['change']['value'] == 2.0
    for one_person in (False, True):
        assert 'Peak of trains' in page(rows, one_person)
        assert 'Force at 50 %' not in page(rows, one_person).split('<figure>')[0]


def test_intervals_are_scaled_with_their_numbers() -> None:
    document = group_document([row(1)], 'Ada', one_person=False)
    found = document['recordings'][0]['measured']['u_thr']
    assert found == pytest.approx({'value': 40.0, 'lower': 39.0, 'upper': 41.0})
    assert half_width(found) == pytest.approx(1.0)
