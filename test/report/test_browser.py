# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser without a window: it draws, zooms, and asks nobody for anything."""

import html
import json
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

from rpms_ros.report import page as traces
from rpms_ros.report.figures import FIGURES
from rpms_ros.report.page import SECTIONS, as_page
from rpms_ros.report.session import SessionReport

pytestmark = pytest.mark.long

FLAGS = (
    '--hide-scrollbars',
    '--force-device-scale-factor=1',
    '--window-size=1100,1600',
    '--virtual-time-budget=2000',
)
LISTEN = """<script>
const noted = { errors: [], refused: [] };
const written = [];
const fillText = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (text, ...place) {
  written.push([this.canvas, text]);
  fillText.call(this, text, ...place);
};
addEventListener('error', (event) => noted.errors.push(event.message));
addEventListener('securitypolicyviolation', (event) => noted.refused.push(event.blockedURI));
</script>"""
# What a person does with the page; `view` is the span of time that the canvas shows.
PROBE = """<script>
const plots = document.getElementById('plots');
const canvas = plots.querySelector('canvas');
const view = () => plots.dataset.view.split(' ').map(Number);
const press = (label) => [...document.querySelectorAll('.tools button')]
  .find((one) => one.textContent === label || one.getAttribute('aria-label') === label).click();
const key = (name) => plots.dispatchEvent(new KeyboardEvent('keydown', { key: name }));
const pixels = () => {
  const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
  let black = 0, grey = 0;
  for (let i = 0; i < data.length; i += 4) {
    if (data[i + 3] === 255 && data[i] < 110) { black += 1; }
    if (data[i + 3] === 255 && data[i] > 150 && data[i] < 170) { grey += 1; }
  }
  return { black, grey };
};
const low = plots.querySelectorAll('canvas')[1];
noted.residual = written.filter(([place]) => place === low).map(([, text]) => text);
noted.viewer = !document.getElementById('viewer').hidden;
noted.still = !document.getElementById('still').hidden;
noted.labels = [...document.querySelectorAll('.tools button')].map((one) => one.textContent);
noted.all = view();
noted.shownAll = document.getElementById('shown').textContent;
press('zoom in'); noted.zoomed = view();
press('later'); noted.later = view();
key('0'); noted.reset = view();
key('+'); key('ArrowLeft'); noted.keys = view();
key('0');
const box = plots.querySelector('.u-over').getBoundingClientRect();
const at = (share) => ({ clientX: box.left + share * box.width, clientY: box.top + 20,
  bubbles: true, cancelable: true });
const scroll = new WheelEvent('wheel', { deltaY: -1000, ...at(0.5) });
canvas.dispatchEvent(scroll);
noted.scrolled = view();
noted.caught = scroll.defaultPrevented;
canvas.dispatchEvent(new WheelEvent('wheel', { deltaY: -1000, ctrlKey: true, ...at(0.5) }));
noted.wheel = view();
canvas.dispatchEvent(new PointerEvent('pointerdown', at(0.5)));
canvas.dispatchEvent(new PointerEvent('pointermove', at(0.25)));
canvas.dispatchEvent(new PointerEvent('pointerup', at(0.25)));
noted.dragged = view();
const last = noted.labels.find((label) => label === 'end' || label === 'last 2 s');
press(last); noted.last = view();
noted.shownLast = document.getElementById('shown').textContent;
noted.pixels = pixels();
noted.resources = performance.getEntriesByType('resource').map((one) => one.name);
noted.headings = [...document.querySelectorAll('h2')].map((one) => one.innerText);
noted.figures = [...document.querySelectorAll('figure img')]
  .map((one) => one.getBoundingClientRect().width);
noted.overflow = document.documentElement.scrollWidth - innerWidth;
noted.report = JSON.parse(document.getElementById('report').textContent).title;
const element = document.createElement('pre');
element.id = 'noted';
element.textContent = JSON.stringify(noted);
document.body.append(element);
</script>"""


Open = Callable[..., str]


@pytest.fixture(scope='module')
def opened(beside: Callable[[str], ModuleType]) -> Open:
    """Open a page with a fresh profile; return what the browser prints."""
    devtools = beside('devtools')
    command = [devtools.browser_program(), *devtools.FLAGS, *FLAGS]

    def open_page(path: Path, *flags: str) -> str:
        done = subprocess.run(
            [*command, f'--user-data-dir={path.parent / "profile"}', *flags, path.as_uri()],
            capture_output=True,
            text=True,
            timeout=250,
            check=True,
            stdin=subprocess.DEVNULL,
        )
        return done.stdout

    return open_page


def probed(opened: Open, folder: Path, page: str) -> dict[str, Any]:
    """Return what the probe notes on a page."""
    path = folder / 'report.html'
    page = page.replace('<head>', f'<head>{LISTEN}', 1).replace('</body>', f'{PROBE}</body>')
    path.write_text(page, encoding='utf-8')
    found = re.search(r'<pre id="noted">(.*?)</pre>', opened(path, '--dump-dom'), re.DOTALL)
    assert found, 'the probe did not come to its end'
    noted = json.loads(html.unescape(found.group(1)))
    assert isinstance(noted, dict)
    return noted


@pytest.fixture(scope='module')
def noted(opened: Open, tmp_path_factory: pytest.TempPathFactory, page: str) -> dict[str, Any]:
    return probed(opened, tmp_path_factory.mktemp('browser'), page)


def test_nothing_fails_and_nothing_is_fetched(noted: dict[str, Any]) -> None:
    assert noted['errors'] == []
    assert noted['refused'] == []
    assert noted['resources'] == []
    assert noted['report'] == 'leg & <arm>'


def test_all_sections_and_figures_show(noted: dict[str, Any]) -> None:
    assert noted['headings'] == list(SECTIONS.values())
    # the viewer takes the place of the still figure of the force
    assert (noted['viewer'], noted['still']) == (True, False)
    assert sorted(width > 300 for width in noted['figures']) == [False] + [True] * (
        len(FIGURES) - 1
    )
    assert noted['overflow'] <= 0


def test_the_force_can_be_zoomed_and_moved(noted: dict[str, Any]) -> None:
    end = noted['all'][1]
    # single precision of the times, of some ten seconds
    assert noted['all'] == pytest.approx([0.0, 9.999], abs=1e-5)
    assert noted['zoomed'] == pytest.approx([end / 4, 3 * end / 4])
    assert noted['later'] == pytest.approx([end / 2, end])
    assert noted['reset'] == noted['all']
    assert noted['keys'] == pytest.approx([end / 8, 5 * end / 8])
    # without Ctrl the wheel scrolls the page: the plot does not catch it
    assert noted['scrolled'] == noted['reset']
    assert noted['caught'] is False
    length = noted['wheel'][1] - noted['wheel'][0]
    assert length < end / 2
    assert noted['dragged'][0] - noted['wheel'][0] == pytest.approx(length / 4, rel=1e-6)
    assert noted['last'] == pytest.approx([end - 2.0, end])
    assert 'every sample' in noted['shownAll']


def test_both_lines_are_on_the_canvas(noted: dict[str, Any]) -> None:
    # a line across some thousand pixels, and one three times as thick behind it
    assert noted['pixels']['black'] > 500
    assert noted['pixels']['grey'] > 500


def test_the_scale_of_the_residual_can_be_read(
    opened: Open, tmp_path: Path, page: str, noted: dict[str, Any]
) -> None:
    # whichever the limit is, there are ticks on both sides of 0
    for limit in (None, 0.049, 0.0101, 0.26):
        if limit is not None:
            changed = re.sub(r'"residual_limit": ?[0-9.e-]+', f'"residual_limit": {limit}', page)
            assert changed != page
            noted = probed(opened, tmp_path, changed)
        ticks = {text for text in noted['residual'] if re.fullmatch(r'\D?0\.\d+', text)}
        below = {text for text in ticks if not text.startswith('0')}
        assert len(below) == len(ticks - below) > 0, (limit, noted['residual'])


@pytest.mark.parametrize('dark', [False, True])
def test_nobody_is_kept_from_reading_it(
    beside: Callable[[str], ModuleType], tmp_path: Path, page: str, dark: bool
) -> None:
    """Contrast, names, alternatives, headings, landmarks, tables, as axe-core finds them."""
    path = tmp_path / 'report.html'
    path.write_text(page, encoding='utf-8')
    with beside('devtools').Browser(tmp_path / 'profile') as shown:
        for width in (360, 1100):
            shown.screen(width, dark=dark)
            shown.open(path.as_uri())
            assert shown.accessibility_faults() == [], width
        # every control can be reached and is seen where it is
        assert shown.beyond_the_keyboard() == []
        assert shown.evaluate('controls.length') > 3


def test_a_long_session_shows_its_envelope_until_every_sample_fits(
    opened: Open,
    tmp_path: Path,
    report: SessionReport,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(traces, 'MOST_SAMPLES', 5000)
    monkeypatch.setattr(traces, 'ENVELOPE_BINS', 500)
    monkeypatch.setattr(traces, 'WINDOW', 2.0)
    noted = probed(opened, tmp_path, as_page(report))
    assert noted['errors'] == []
    assert noted['labels'][:4] == ['all', 'start', 'largest residual', 'end']
    assert noted['shownAll'].endswith('envelope')
    assert noted['shownLast'].endswith('every sample')
    assert noted['last'] == pytest.approx([8.0, 9.999], abs=2e-3)


def test_the_page_is_painted(opened: Open, tmp_path: Path, page: str) -> None:
    path, picture = tmp_path / 'report.html', tmp_path / 'page.png'
    path.write_text(page, encoding='utf-8')
    opened(path, f'--screenshot={picture}')
    light = imread(picture)[..., :3].min(axis=2)
    assert light.shape == (1600, 1100)
    # mostly paper, with letters and lines on it
    assert np.mean(light > 0.95) > 0.7
    assert np.mean(light < 0.4) > 0.005
