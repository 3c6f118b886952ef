# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A report as one HTML page with style, script, figures and data inside."""

import json
from datetime import UTC
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from rpms_ros.axis import QUANTITIES
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.report.named import label
from rpms_ros.report.named import recruitment_shown
from rpms_ros.report.named import shown
from rpms_ros.report.session.analysis import SessionAnalysis
from rpms_ros.report.session.dose import TRAIN_GAP
from rpms_ros.report.session.figures import OF_THE_ESTIMATOR
from rpms_ros.report.session.figures import as_svg
from rpms_ros.report.session.figures import names_of
from rpms_ros.report.session.traces import force_traces
from rpms_ros.report.templates import image_url
from rpms_ros.report.templates import page_template
from rpms_ros.report.templates import shipped
from rpms_ros.report.text import with_interval

UNKNOWN = 'not known'
# The year 2000: stamps before are those of a clock that began with the machine or the trial.
_EARLIEST_S = 946_684_800
_HERE = Path(__file__).parent
CAPTIONS = {
    'recruitment': 'Steady force over intensity with its band; the bars below show which '
    'intensities were used.',
    'response': 'Force after one pulse, from the pulse on.',
    'parameters': 'Estimates over time, with 95 % bands; dotted lines are sudden changes, '
    'hatched spans have a doubt or a fault, dashed is the truth where the muscle was simulated.',
    'force': 'Measured and modelled force at the end of the stimulation, and their difference.',
    'residuals': 'Correlations of the residual: within the dashed lines it is white noise.',
    'held_out': 'Force that was not learnt from, and its prediction.',
    'schedule': 'The pulses that were delivered, and their energy.',
}
"""One sentence a figure."""
# In the order of the page.
SECTIONS = {
    'summary': 'Verdict',
    'recruitment': 'Recruitment',
    'response': 'Impulse response and physiology',
    'parameters': 'Time courses',
    'force': 'Force, measured and modelled',
    'residuals': 'Residuals and held-out fit',
    'faults': 'Faults',
    'schedule': 'Schedule and energy',
    'session': 'Session',
    'methods': 'Methods, command and versions',
    'checklist': 'rPMS reporting checklist',
}


def as_page(analysis: SessionAnalysis, document: dict[str, Any]) -> str:
    """Return the page.

    Parameters
    ----------
    analysis : SessionAnalysis
        Content of the figures.
    document : dict
        Content of the tables, from `as_document`; it is inside the page as JSON too.
    """
    dynamics = analysis.trains is not None
    figures = names_of(analysis)
    hidden = {name for name in OF_THE_ESTIMATOR if name not in figures}
    filters = {
        one.__name__: one
        for one in (number, percent, with_interval, label, shown, recruitment_shown)
    }
    template = page_template(_HERE, **filters)
    return template.render(
        document,
        document=document,
        sections={key: text for key, text in SECTIONS.items() if key not in hidden},
        dynamics=dynamics,
        unknown=UNKNOWN,
        train_gap=TRAIN_GAP,
        start=_start(document['session']['start_ns']),
        traces=force_traces(analysis.session),
        captions=CAPTIONS,
        what=QUANTITIES[analysis.result.unit],
        force_range=float(np.ptp(analysis.session.force[analysis.session.usable])),
        image=lambda name: image_url(as_svg(name, analysis)),
        file=lambda name: shipped(_HERE / name),
    )


def _start(stamp_ns: int) -> str:
    """Return when a session began, if its stamps are dates."""
    seconds = stamp_ns // NANOSECONDS_PER_SECOND
    if seconds < _EARLIEST_S:
        return f'not known: the stamps begin at {stamp_ns / NANOSECONDS_PER_SECOND:.4g} s'
    return f'{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S} UTC by its stamp'


def number(value: float | None, unit: str = '', scale: float = 1.0) -> str:
    """Return `scale` times a number with four digits and its unit; `UNKNOWN` for None."""
    if value is None:
        return UNKNOWN
    value *= scale
    text = f'{value:,.0f}' if 1e4 <= abs(value) < 1e9 else f'{value:.4g}'
    return f'{text} {unit}'.rstrip()


def percent(share: float | None) -> str:
    """Return a share as per cent; `UNKNOWN` for None."""
    return UNKNOWN if share is None else f'{100 * share:.3g} %'


def embedded(page: str, name: str) -> Any:
    """Return the JSON that a page carries under a name: ``report`` or ``traces``."""
    start = page.index('>', page.index(f'<script type="application/json" id="{name}"')) + 1
    return json.loads(page[start : page.index('</script>', start)])
