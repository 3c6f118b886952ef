"""A report as one HTML page that needs nothing else: style, script, figures and data inside."""

import json
import re
from html import escape
from pathlib import Path
from typing import Any

from rpms_ros.report.session.analysis import SessionAnalysis
from rpms_ros.report.session.figures import as_svg
from rpms_ros.report.session.sections import SECTIONS
from rpms_ros.report.session.traces import force_traces

_HERE = Path(__file__).parent
_SVG_START = re.compile(r'^.*?(?=<svg )', re.DOTALL)
_METADATA = re.compile(r'\s*<metadata>.*?</metadata>', re.DOTALL)
_STYLE_ELEMENT = re.compile(r'\s*<style type="text/css">.*?</style>', re.DOTALL)
_ID_OR_REFERENCE = re.compile(r'(\bid="|"#|url\(#)')
# Nothing may be fetched, whatever a name in a recording tries.
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"


def as_page(analysis: SessionAnalysis, document: dict[str, Any]) -> str:
    """Return the page.

    Parameters
    ----------
    analysis : SessionAnalysis
        What the figures show.
    document : dict
        What the tables show, as `as_document` makes it; it is inside the page as JSON too.
    """

    def figure(name: str, description: str) -> str:
        return inline_svg(name, description, as_svg(name, analysis))

    title = escape(analysis.title)
    bodies = [
        f'<section id="{key}" aria-labelledby="{key}-title">\n'
        f'<h2 id="{key}-title">{heading}</h2>\n{write(document, figure)}\n</section>'
        for key, heading, write in SECTIONS
    ]
    links = ''.join(f'<li><a href="#{key}">{heading}</a></li>' for key, heading, _ in SECTIONS)
    return '\n'.join(
        (
            '<!DOCTYPE html>',
            '<html lang="en">',
            '<head>',
            '<meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f'<title>{title}: stimulated muscle, session report</title>',
            f'<style>\n{_text("page.css")}</style>',
            '</head>',
            '<body>',
            f'<header><h1>{title}</h1>{_subtitle(document)}</header>',
            f'<nav aria-label="Sections"><ul>{links}</ul></nav>',
            '<main>',
            *bodies,
            '</main>',
            _data('report', document),
            _data('traces', force_traces(analysis.session)),
            f'<script>\n{_text("page.js")}</script>',
            '</body>',
            '</html>',
            '',
        )
    )


def inline_svg(name: str, description: str, text: str) -> str:
    """Return a figure of matplotlib as an element of a page: named, described, no stray ids."""
    text = _STYLE_ELEMENT.sub('', _METADATA.sub('', _SVG_START.sub('', text)))
    text = _ID_OR_REFERENCE.sub(rf'\g<1>{name}-', text)
    label = escape(description, quote=True)
    return text.replace('<svg ', f'<svg role="img" aria-label="{label}" ', 1).strip()


def embedded(page: str, name: str) -> Any:
    """Return the JSON that a page carries under a name: ``report`` or ``traces``."""
    start = page.index('>', page.index(f'<script type="application/json" id="{name}"')) + 1
    return json.loads(page[start : page.index('</script>', start)])


def _data(name: str, value: Any) -> str:
    # Within a script element only "</" could end it; JSON allows the slash to be escaped.
    text = json.dumps(value, allow_nan=False).replace('<', '\\u003c')
    return f'<script type="application/json" id="{name}">{text}</script>'


def _text(name: str) -> str:
    return (_HERE / name).read_text(encoding='utf-8')


def _subtitle(document: dict[str, Any]) -> str:
    result = document['result']
    text = (
        f'{result["samples"]} force samples, {result["pulses"]} pulses, '
        f'{result["duration_s"]:.4g} s; estimator {result["estimator"]}'
    )
    return f'<p>{escape(text)}</p>'
