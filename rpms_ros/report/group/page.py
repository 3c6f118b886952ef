# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The page of a study: one HTML file that needs nothing else."""

from collections.abc import Mapping
from os.path import relpath
from pathlib import Path
from typing import Any
from urllib.parse import quote

from rpms_ros.printable import counted
from rpms_ros.report.group.figures import group_figure
from rpms_ros.report.session.page import UNKNOWN
from rpms_ros.report.session.page import number
from rpms_ros.report.templates import image_url
from rpms_ros.report.templates import page_template
from rpms_ros.report.templates import shipped
from rpms_ros.report.text import with_interval

_HERE = Path(__file__).parent


def as_group_page(document: Mapping[str, Any], folder: Path) -> str:
    """Return the page.

    Parameters
    ----------
    document : mapping
        As `group_document` makes it.
    folder : Path
        Where the page goes: links are relative to it.
    """
    template = page_template(_HERE, number=number, stated=stated, counted=counted)
    return template.render(
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
        file=lambda name: shipped(_HERE.parent / name),
        image=image_url(group_figure(document)),
        link=lambda path: link(path, folder),
    )


def link(path: str, folder: Path) -> str:
    """Return a link from the page in a folder to a path; never another scheme."""
    return f'./{quote(relpath(Path(path).resolve(), folder.resolve()))}'


def stated(found: Mapping[str, float | None] | None, sign: bool = False) -> str:
    """Return a number with its interval as text."""
    if found is None:
        return UNKNOWN
    if not sign:
        return with_interval(found)
    text = format(found['value'], '+.3g')
    if found['lower'] is None or found['upper'] is None:
        return text
    return f'{text} ({found["lower"]:+.3g} to {found["upper"]:+.3g})'
