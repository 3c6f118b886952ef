# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The HTML page of a session, with style, figures and data inside.

It is made of the templates of this package, by the extra rpms_ros[report].
"""

from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import quote

import numpy as np

from rpms_ros.axis import QUANTITIES
from rpms_ros.printable import counted
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.report.dose import TRAIN_GAP
from rpms_ros.report.figures import OF_THE_ESTIMATOR, as_svg, names_of
from rpms_ros.report.session_report import SHARES_SHOWN, SessionReport
from rpms_ros.report.text import RATE_WORDS, label, recruitment_shown, shown, with_interval
from rpms_ros.schema import plain

# What need not be escaped in a data URL; base64 would be longer.
_KEPT = " !$&'()*+,/:;=?@\n"
_TEMPLATES = Path(__file__).parent / 'templates'


UNKNOWN = 'not known'
# The year 2000: stamps before are those of a clock that began with the machine or the trial.
_EARLIEST_S = 946_684_800
# In the order of the page.
SECTIONS = {
    'summary': 'Verdict',
    'recruitment': 'Recruitment',
    'response': 'Impulse response and physiology',
    'parameters': 'Time courses',
    'force': 'Force, measured and modelled',
    'residuals': 'Residuals',
    'faults': 'Faults',
    'schedule': 'Schedule and energy',
    'session': 'Session',
    'methods': 'Methods, command and versions',
}


def as_page(report: SessionReport) -> str:
    """Return the page of a session, with its JSON inside; jinja2 escapes every text."""
    # figures are drawn without it
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies['json.dumps_kwargs'] = {'allow_nan': False}
    for one in (number, percent, with_interval, label, shown, recruitment_shown, counted):
        environment.filters[one.__name__] = one
    document = plain(report)
    figures, session, curve = names_of(report), report.identified, report.result.curve
    hidden = {name for name in OF_THE_ESTIMATOR if name not in figures}
    return environment.get_template('session.html').render(
        document,
        document=document,
        unknown=UNKNOWN,
        # styles and scripts of the package are not escaped
        file=lambda path: Markup((_TEMPLATES / path).read_text(encoding='utf-8')),
        sections={key: text for key, text in SECTIONS.items() if key not in hidden},
        dynamics=report.result.trains is not None,
        forces={share: plain(curve.at(share)) for share in SHARES_SHOWN} if curve else {},
        rate_words=RATE_WORDS,
        train_gap=TRAIN_GAP,
        start=_start(document['session']['start_ns']),
        what=QUANTITIES[report.result.unit],
        force_range=float(np.ptp(session.force[session.usable])),
        image=lambda name: f'data:image/svg+xml,{quote(as_svg(name, report), safe=_KEPT)}',
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
