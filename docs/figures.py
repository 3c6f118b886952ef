# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The figures of the site: `python docs/figures.py`; `make docs` does it first.

Written into docs/figures, which is not kept in the repository.
"""

import shutil
import subprocess
import sys
import tempfile
from os import environ
from pathlib import Path

import matplotlib as mpl

mpl.use('agg')

from matplotlib.figure import Figure

import rpms_ros
from rpms_ros.cli import main as rpms

DOCS = Path(__file__).resolve().parent
SAMPLE = DOCS.parent / 'bags' / 'sample'
BROWSERS = ('chromium', 'chromium-browser', 'google-chrome-stable', 'google-chrome', 'chrome')
DURATIONS = (15.0, 30.0, 60.0)


def session(path: Path) -> None:
    """What `rpms identify --out` draws of the sample recording."""
    rpms_ros.load(SAMPLE).identify().plot().savefig(path, dpi=90)


def excitation(path: Path) -> None:
    """Width of the interval of the steady force by schedule and duration."""
    figure = Figure(figsize=(9.0, 3.4), layout='constrained')
    panels = figure.subplots(1, 2, sharey=True)
    styles = {'uniform_random': '-', 'sinusoid': '-.', 'staircase': ':'}
    for name, style in styles.items():
        sessions = [rpms_ros.simulate(name, duration=one, noise=0.05) for one in DURATIONS]
        found = [session.identify() for session in sessions]
        for panel, intensity in zip(panels, (0.5, 1.0), strict=True):
            stated = [one.force_at(intensity) for one in found]
            half = [(one.upper - one.lower) / 2 for one in stated]
            panel.plot(DURATIONS, half, style, color='black', marker='o', label=name)
            panel.set(title=f'intensity {intensity:g}', xlabel='length of the session [s]')
            panel.set(yscale='log')
    panels[0].set_ylabel('half width of the\n95 % interval [N]')
    panels[1].legend()
    figure.savefig(path, dpi=110)


def report(path: Path) -> None:
    """The first screen of the report in a browser; a note in its place where there is none."""
    given = environ.get('RPMS_BROWSER')
    browser = next(
        (found for name in ([given] if given else BROWSERS) if (found := shutil.which(name))), None
    )
    if browser is None:
        figure = Figure(figsize=(6.0, 1.0))
        figure.text(0.5, 0.5, 'made where a browser is installed (RPMS_BROWSER)', ha='center')
        figure.savefig(path)
        return
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder, 'report.html')
        options = ['--estimator', 'batch', '--quiet', '--out', str(page)]
        if rpms(['report', str(SAMPLE), *options]) != 0:
            raise SystemExit('expected a report on the sample recording, got none')
        command = [browser, '--headless=new', '--no-sandbox', '--disable-gpu', '--hide-scrollbars']
        command += [f'--user-data-dir={folder}/profile', '--window-size=1100,900']
        command += [f'--screenshot={path}', page.as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
    if not path.exists():
        raise SystemExit(f'expected a picture of the report at {path}, got none')


FIGURES = {'session': session, 'excitation': excitation, 'report': report}


def main() -> None:
    """Draw every figure."""
    folder = DOCS / 'figures'
    folder.mkdir(exist_ok=True)
    for name, draw in FIGURES.items():
        draw(folder / f'{name}.png')
        print(f'docs/figures/{name}.png', file=sys.stderr)


if __name__ == '__main__':
    main()
