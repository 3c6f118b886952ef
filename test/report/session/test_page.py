# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The page without a browser: well formed, self-contained, complete, true to its document."""

import hashlib
import json
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from rpms_ros.errors import ReportError
from rpms_ros.report.result import result_of
from rpms_ros.report.session import FIGURES
from rpms_ros.report.session import SessionAnalysis
from rpms_ros.report.session import as_document
from rpms_ros.report.session import as_page
from rpms_ros.report.session import write_figures
from rpms_ros.report.session.figures import draw
from rpms_ros.report.session.page import SECTIONS
from rpms_ros.report.session.page import embedded

VOID = {'meta', 'link', 'br', 'hr', 'img', 'input', 'col', 'area', 'base', 'source', 'wbr'}
FETCHING = {'src', 'srcset', 'data', 'poster', 'action', 'formaction', 'background', 'ping'}


class Checker(HTMLParser):
    """Follows the nesting, collects ids, references and what would be fetched."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.faults: list[str] = []
        self.ids: Counter[str] = Counter()
        self.references: set[str] = set()
        self.fetched: list[str] = []
        self.images: list[str] = []
        self.tags: Counter[str] = Counter()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] += 1
        if tag not in VOID:
            self.open.append(tag)
        self._look(tag, attrs)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] += 1
        self._look(tag, attrs)

    def _look(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if repeated := [name for name, n in Counter(name for name, _ in attrs).items() if n > 1]:
            self.faults.append(f'{tag} with {repeated} twice')
        for name, value in attrs:
            text = value or ''
            if name == 'src' and tag == 'img':
                self.images.append(text)
                continue
            if name == 'id':
                self.ids[text] += 1
            if name in ('href', 'xlink:href'):
                (self.references.add if text.startswith('#') else self.fetched.append)(text)
            if name in FETCHING or (tag == 'link' and name == 'href'):
                self.fetched.append(text)
            self.references.update(f'#{one}' for one in re.findall(r'url\(#([^)]*)\)', text))
            if name == 'aria-labelledby':
                self.references.add(f'#{text}')

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open[-1] != tag:
            self.faults.append(f'</{tag}> within {self.open[-1:]}')
        else:
            self.open.pop()


@pytest.fixture(scope='module')
def checked(page: str) -> Checker:
    checker = Checker()
    checker.feed(page)
    checker.close()
    return checker


def test_the_page_is_well_formed(page: str, checked: Checker) -> None:
    assert page.startswith('<!DOCTYPE html>\n<html lang="en">')
    assert checked.faults == []
    assert checked.open == []
    assert [name for name, count in checked.ids.items() if count > 1] == []
    assert checked.references <= {f'#{name}' for name in checked.ids}
    assert (checked.tags['title'], checked.tags['h1'], checked.tags['main']) == (1, 1, 1)


def test_the_page_fetches_nothing(page: str, checked: Checker) -> None:
    assert checked.fetched == []
    assert "default-src 'none'" in page
    assert all(image.startswith('data:image/svg+xml,') for image in checked.images)
    code = page[page.rindex('<script>') :] + page[page.index('<style>') : page.index('</style>')]
    assert not re.search(r'https?:|//[a-z]|@import|url\(|fetch|XMLHttp|import\(', code)
    assert len(page) < 1.5e6


def test_the_plotting_library_is_the_published_one() -> None:
    folder = files('rpms_ros.report.session') / 'uplot'
    found = {
        name: hashlib.sha256((folder / name).read_bytes()).hexdigest()
        for name in ('uPlot.iife.min.js', 'uPlot.min.css')
    }
    # uPlot 1.6.32 on the npm registry
    assert found == {
        'uPlot.iife.min.js': '19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f',
        'uPlot.min.css': 'df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04',
    }


def test_every_section_is_there_and_linked(page: str, checked: Checker) -> None:
    for key, heading in SECTIONS.items():
        assert checked.ids[key] == 1
        assert f'<a href="#{key}">{heading}</a>' in page
    assert len(SECTIONS) == 12
    assert checked.tags['img'] == len(FIGURES)


def test_every_figure_is_named_for_those_who_cannot_see_it(page: str) -> None:
    images = re.findall(r'<img [^>]*>', page)
    assert len(images) == len(FIGURES)
    for image in images:
        assert re.search(r' alt="[A-Z][^"]{10,}"', image)


def test_the_page_carries_the_document(page: str, document: dict[str, Any]) -> None:
    assert embedded(page, 'report') == json.loads(json.dumps(document))
    assert document['session']['notes']['operator'] == '</script><b>'


def test_names_out_of_a_recording_are_text(page: str, checked: Checker) -> None:
    assert '<h1>leg &amp; &lt;arm&gt;</h1>' in page
    assert 'round &lt;90 mm&gt; &amp; &#34;flat&#34;' in page
    assert checked.tags['b'] == checked.tags['arm'] == 0


def test_the_same_session_gives_the_same_page(analysis: SessionAnalysis, page: str) -> None:
    assert as_page(analysis, as_document(analysis)) == page


def test_figures_are_written_as_pixels_and_vectors(
    tmp_path: Path, analysis: SessionAnalysis
) -> None:
    paths = write_figures(tmp_path / 'new' / 'folder', analysis)
    assert {path.name for path in paths} == {
        f'{name}.{ending}' for name in FIGURES for ending in ('png', 'svg')
    }
    for path in paths:
        if path.suffix == '.png':
            # lines, ticks and letters: far from blank
            assert np.mean(imread(path)[..., :3].min(axis=2) < 0.6) > 0.005
        else:
            assert '<svg' in path.read_text()


def test_a_folder_that_cannot_be_made_is_an_error(
    tmp_path: Path, analysis: SessionAnalysis
) -> None:
    (tmp_path / 'file').write_text('')
    with pytest.raises(ReportError, match='expected to write figures into'):
        write_figures(tmp_path / 'file' / 'folder', analysis)


@pytest.mark.parametrize('name', FIGURES)
def test_a_copy_in_black_and_white_loses_nothing(name: str, analysis: SessionAnalysis) -> None:
    for axes in draw(name, analysis).axes:
        looks = set()
        for line in axes.lines:
            red, green, blue = to_rgb(line.get_color())
            assert red == green == blue
            if not line.get_label().startswith('_'):
                looks.add((round(red, 1), line.get_linestyle(), line.get_linewidth()))
        labelled = [line for line in axes.lines if not line.get_label().startswith('_')]
        assert len(looks) == len(labelled)


def test_one_intensity_is_said_and_not_drawn(
    tmp_path: Path,
    make_recording: Callable[..., Path],
    make_analysis: Callable[..., SessionAnalysis],
) -> None:
    analysis = make_analysis(make_recording(tmp_path / 'constant', low=1.0))
    page = as_page(analysis, as_document(analysis))
    assert 'there is no curve to show' in page
    assert 'cannot be told apart' in page
    assert embedded(page, 'report')['result']['curve'] is None


def test_intervals_and_physiology_are_shown_where_an_estimator_has_them(
    analysis: SessionAnalysis, page: str
) -> None:
    assert 'has no intervals' in page
    assert 'fits no twitch to it' in page
    last = analysis.session.last
    size = len(last.nonlinear)
    richer = replace(
        last,
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
    session = replace(analysis.session, estimates=[*analysis.session.estimates[:-1], richer])
    result = result_of(analysis.recording, session)
    changed = replace(analysis, session=session, result=result)
    text = unquote(as_page(changed, as_document(changed)))
    assert 'states no' not in text
    for shown in ('95 % band', 'latency_s', '2.75 to 3.25', '0.25', 'converged', 'not informed'):
        assert shown in text
    assert embedded(text, 'report')['result']['confidence'] == 0.95
