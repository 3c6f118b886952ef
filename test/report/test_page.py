# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The page without a browser: well formed, self-contained, complete, true to its document."""

import json
import re
from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser
from urllib.parse import unquote

import numpy as np
import pytest
from matplotlib.image import imread

from rpms_ros.muscle import twitch
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import write_recording
from rpms_ros.report.figures import FIGURES, write_figures
from rpms_ros.report.page import SECTIONS, as_page


def embedded(page):
    """The document that a page carries."""
    return json.loads(re.search(r'id="report">(.*?)</script>', page, re.DOTALL)[1])


VOID = {'meta', 'link', 'br', 'hr', 'img', 'input', 'col', 'area', 'base', 'source', 'wbr'}
FETCHING = {'src', 'srcset', 'data', 'poster', 'action', 'formaction', 'background', 'ping'}


class Checker(HTMLParser):
    """Follows the nesting, collects ids, references and what would be fetched."""

    def __init__(self):
        super().__init__()
        self.open, self.faults, self.fetched, self.images = [], [], [], []
        self.ids, self.tags, self.references = Counter(), Counter(), set()

    def handle_starttag(self, tag, attrs):
        self.tags[tag] += 1
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            text = value or ''
            if name == 'src' and tag == 'img':
                self.images.append(text)
            elif name in ('href', 'xlink:href') and text.startswith('#'):
                self.references.add(text)
            elif name in FETCHING or name in ('href', 'xlink:href'):
                self.fetched.append(text)
            self.ids.update([text] if name == 'id' else [])
            self.references.update([f'#{text}'] if name == 'aria-labelledby' else [])

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.faults.append(f'</{tag}>')


@pytest.fixture(scope='module')
def checked(page):
    checker = Checker()
    checker.feed(page)
    checker.close()
    return checker


def test_the_page_is_well_formed(page, checked):
    assert page.startswith('<!DOCTYPE html>\n<html lang="en">')
    assert checked.faults == []
    assert checked.open == []
    assert [name for name, count in checked.ids.items() if count > 1] == []
    assert checked.references <= {f'#{name}' for name in checked.ids}
    assert (checked.tags['title'], checked.tags['h1'], checked.tags['main']) == (1, 1, 1)


def test_the_page_fetches_nothing(page, checked):
    assert checked.fetched == []
    assert "default-src 'none'" in page
    assert all(image.startswith('data:image/svg+xml,') for image in checked.images)
    assert '<script>' not in page
    code = page[page.index('<style>') : page.index('</style>')]
    assert not re.search(r'https?:|//[a-z]|@import|url\(|fetch|XMLHttp|import\(', code)
    assert len(page) < 1.5e6


def test_every_section_is_there_and_linked(page, checked):
    for key, heading in SECTIONS.items():
        assert checked.ids[key] == 1
        assert f'<a href="#{key}">{heading}</a>' in page
    assert len(SECTIONS) == 10
    assert checked.tags['img'] == len(FIGURES)


def test_the_page_carries_the_document_and_names_out_of_a_recording_are_text(
    page, document, checked
):
    assert embedded(page) == json.loads(json.dumps(document))
    assert document['session']['notes']['operator'] == '</script><b>'
    assert '<h1>leg &amp; &lt;arm&gt;</h1>' in page
    assert 'round &lt;90 mm&gt; &amp; &#34;flat&#34;' in page
    assert checked.tags['b'] == checked.tags['arm'] == 0


def test_figures_are_written_as_pixels_and_vectors(tmp_path, report):
    folder = tmp_path / 'new' / 'folder'
    write_figures(folder, report)
    assert {path.name for path in folder.iterdir()} == {
        f'{name}.{ending}' for name in FIGURES for ending in ('png', 'svg')
    }
    for path in folder.iterdir():
        if path.suffix == '.png':
            # lines, ticks and letters: far from blank
            assert np.mean(imread(path)[..., :3].min(axis=2) < 0.6) > 0.005
        else:
            assert '<svg' in path.read_text()


def test_one_intensity_is_said_and_not_drawn(constant_report):
    page = as_page(constant_report)
    assert 'there is no curve to show' in page
    assert 'cannot be told apart' in page
    assert embedded(page)['result']['curve'] is None


def test_intervals_and_physiology_are_shown_where_an_estimator_has_them(report, page, with_last):
    assert 'has no intervals' in page
    assert 'fits no twitch to it' in page
    last = report.identified.last
    size = len(last.nonlinear)
    richer = with_last(
        confidence=0.95,
        curve_lower=last.curve_force - 1.0,
        curve_upper=last.curve_force + 1.0,
        response_lower=last.response_force - 0.1,
        response_upper=last.response_force + 0.1,
        nonlinear_covariance=np.diag(np.full(size, 0.0625)),
        nonlinear_identifiability=np.array([2, 1, 0, 2])[:size],
        physiology_names=('latency_s', 'order'),
        physiology=np.array([0.00945, 3.0]),
        physiology_lower=np.array([0.009, 2.75]),
        physiology_upper=np.array([0.0102, 3.25]),
    )
    text = unquote(as_page(richer))
    assert 'states no' not in text
    for shown in ('95 % band', 'latency_s', '2.75 to 3.25', '0.25', 'converged', 'not informed'):
        assert shown in text
    assert embedded(text)['result']['confidence'] == 0.95


def test_trains_of_one_intensity_have_a_report_of_their_own(make_report, tmp_path):
    onset = np.concatenate([begin + np.arange(8) / 50 for begin in (1.0, 3.0, 5.0)])
    time = np.arange(12_000) / 2000
    force = 2.0 * twitch(time[:, None] - onset - 9e-3, 15e-3, 3).sum(axis=1)
    force += 1e-3 * np.random.default_rng(1).standard_normal(len(force))
    pulses = PulseTrain.numbered(np.round(1e9 * onset).astype(np.int64), 0.7)
    write_recording(tmp_path / 'trains', pulses, ForceTrace(500_000 * np.arange(12_000), force))
    trains_page = as_page(make_report(tmp_path / 'trains'))
    assert 'good</strong> <span>dynamics only' in trains_page
    assert 'Use onset, T_a and latency.' in trains_page
    # `tracking` would tell no more of them
    assert '</strong> Pulses of nearly one intensity do not tell.' in trains_page
    assert 'Use the curve' not in trains_page
    assert '<q>Dynamics were identified' in trains_page
    # nothing of the estimator, which takes the pulses for equal ones at 20 Hz
    for absent in ('Error of prediction', 'id="residuals"', 'id="parameters"'):
        assert absent not in trains_page
    assert trains_page.count('<section ') == trains_page.count('</section>') == len(SECTIONS) - 2
    assert len(re.findall(r'<img [^>]*>', trains_page)) == 4
    twitch_peak = embedded(trains_page)['twitch']['peak_force']
    # 2 N at the time grid of the response, 5 ms beside a maximum that is flat over 5 ms
    assert twitch_peak == pytest.approx(2.0, abs=0.02)


@pytest.mark.usefixtures('without_figures')
def test_one_estimate_of_all_has_no_time_courses(report, with_session):
    session = replace(report.identified, estimates=report.identified.estimates[-1:])
    text = as_page(with_session(report, session))
    assert 'Time courses' not in text
    assert text.count('<img ') == len(FIGURES) - 1
