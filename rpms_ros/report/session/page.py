"""A report as one HTML page that needs nothing else: style, script, figures and data inside."""

import json
from datetime import UTC
from datetime import datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment
from jinja2 import FileSystemLoader
from jinja2 import StrictUndefined
from markupsafe import Markup

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.report.session.analysis import SessionAnalysis
from rpms_ros.report.session.dose import TRAIN_GAP
from rpms_ros.report.session.figures import as_svg
from rpms_ros.report.session.traces import force_traces

UNKNOWN = 'not known'
_HERE = Path(__file__).parent
# What need not be escaped in a data URL; base64 would be longer.
_KEPT = " !$&'()*+,/:;=?@\n"
# In the order of the page.
SECTIONS = {
    'summary': 'Summary',
    'recruitment': 'Recruitment',
    'response': 'Impulse response and physiology',
    'parameters': 'Parameter paths',
    'force': 'Force, measured and modelled',
    'residuals': 'Residuals',
    'held-out': 'Held-out fit',
    'faults': 'Faults',
    'schedule': 'Schedule and energy',
    'session': 'Session',
    'checklist': 'rPMS reporting checklist',
}


def as_page(analysis: SessionAnalysis, document: dict[str, Any]) -> str:
    """Return the page.

    Parameters
    ----------
    analysis : SessionAnalysis
        What the figures show.
    document : dict
        What the tables show, as `as_document` makes it; it is inside the page as JSON too.
    """
    environment = Environment(
        loader=FileSystemLoader(_HERE),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies['json.dumps_kwargs'] = {'allow_nan': False}
    environment.filters |= {'number': number, 'percent': percent}
    start = datetime.fromtimestamp(document['session']['start_ns'] // NANOSECONDS_PER_SECOND, UTC)
    return environment.get_template('page.html').render(
        document,
        document=document,
        sections=SECTIONS,
        unknown=UNKNOWN,
        train_gap=TRAIN_GAP,
        start=f'{start:%Y-%m-%d %H:%M:%S}',
        traces=force_traces(analysis.session),
        image=lambda name: f'data:image/svg+xml,{quote(as_svg(name, analysis), safe=_KEPT)}',
        file=lambda name: Markup((_HERE / name).read_text(encoding='utf-8')),
    )


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
