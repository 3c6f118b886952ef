# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The page of a study: one HTML file that needs nothing else."""

from collections.abc import Mapping
from os.path import relpath
from pathlib import Path
from typing import Any
from urllib.parse import quote

from rpms_ros.report.group.figures import group_figure
from rpms_ros.report.session.page import UNKNOWN
from rpms_ros.report.session.page import number

_HERE = Path(__file__).parent
# What need not be escaped in a data URL; base64 would be longer.
_KEPT = " !$&'()*+,/:;=?@\n"


def as_group_page(document: Mapping[str, Any], folder: Path) -> str:
    """Return the page.

    Parameters
    ----------
    document : mapping
        As `group_document` makes it.
    folder : Path
        Where the page goes: links are relative to it.
    """
    # the extra rpms_ros[report]
    from jinja2 import Environment
    from jinja2 import FileSystemLoader
    from jinja2 import StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=FileSystemLoader(_HERE),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies['json.dumps_kwargs'] = {'allow_nan': False}
    environment.filters |= {'number': number, 'stated': stated}
    css = (_HERE.parent / 'session' / 'page.css', _HERE / 'page.css')
    return environment.get_template('page.html').render(
        document,
        # all numbers stand in the details and in results.csv already
        compact={
            **document,
            'recordings': [
                {name: value for name, value in one.items() if name != 'all'}
                for one in document['recordings']
            ],
        },
        unknown=UNKNOWN,
        style=Markup('\n'.join(path.read_text(encoding='utf-8') for path in css)),
        image=f'data:image/svg+xml,{quote(group_figure(document), safe=_KEPT)}',
        link=lambda path: link(path, folder),
    )


def link(path: str, folder: Path) -> str:
    """Return a link from the page in a folder to a path; never another scheme."""
    return f'./{quote(relpath(Path(path).resolve(), folder.resolve()))}'


def stated(found: Mapping[str, float | None] | None, sign: bool = False) -> str:
    """Return a number with its interval as text."""
    if found is None:
        return UNKNOWN
    kind = '+.3g' if sign else '.4g'
    text = format(found['value'], kind)
    if found['lower'] is None or found['upper'] is None:
        return text
    return f'{text} ({format(found["lower"], kind)} to {format(found["upper"], kind)})'
