# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""HTML pages out of templates, with all that they show inside: the extra rpms_ros[report]."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

if TYPE_CHECKING:
    from jinja2 import Template
    from markupsafe import Markup

# What need not be escaped in a data URL; base64 would be longer.
_KEPT = " !$&'()*+,/:;=?@\n"


def page_template(folder: Path, **filters: Callable[..., str]) -> 'Template':
    """Return the template ``page.html`` of a folder, of jinja2, which escapes every text.

    Parameters
    ----------
    folder : Path
        Beside the templates that pages share.
    **filters : callable
        By the names that the template calls them.
    """
    # figures are drawn without it
    from jinja2 import Environment
    from jinja2 import FileSystemLoader
    from jinja2 import StrictUndefined

    environment = Environment(
        loader=FileSystemLoader([folder, Path(__file__).parent]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies['json.dumps_kwargs'] = {'allow_nan': False}
    environment.filters |= filters
    return environment.get_template('page.html')


def shipped(path: Path) -> 'Markup':
    """Return a style or script of the package as text that is not escaped."""
    from markupsafe import Markup

    return Markup(path.read_text(encoding='utf-8'))


def image_url(svg: bytes) -> str:
    """Return a figure as a URL that holds it."""
    return f'data:image/svg+xml,{quote(svg, safe=_KEPT)}'
