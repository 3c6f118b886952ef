# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`rpms layout`: a layout of Foxglove or PlotJuggler for the topics of one namespace."""

import argparse
import json
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rpms_ros.axis import AXES, UNITS
from rpms_ros.cli.options import add_option, add_quantity_option
from rpms_ros.errors import RpmsError

_FILES = {'foxglove': 'foxglove_layout.json', 'plotjuggler': 'plotjuggler_layout.xml'}
_NAMESPACE = re.compile(r'(/[A-Za-z_][A-Za-z0-9_]*)*')
_WRENCH = re.compile(r'wrench([./])force([./])z')


class LayoutError(RpmsError):
    """A layout cannot be written."""


def add_parser(subparsers: Any) -> None:
    """Add `rpms layout`."""
    parser = subparsers.add_parser(
        'layout',
        help='write a layout of Foxglove or PlotJuggler',
        description='Write the layout of a plotting program for the topics of one namespace.',
        epilog='example: rpms layout foxglove --namespace left_leg --out left_leg.json',
    )
    parser.add_argument('program', choices=tuple(_FILES), help='what it is for')
    add_option(parser, '--namespace NAME', '', 'of the nodes')
    add_option(parser, '--axis', 'z', 'axis of the wrench')
    add_quantity_option(parser)
    add_option(parser, '--out FILE', None, 'file to write; printed if not given', type=Path)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write or print a layout."""
    text = layout(arguments.program, arguments.namespace, arguments.axis, arguments.quantity)
    if arguments.out is None:
        print(text, end='')
        return 0
    try:
        arguments.out.write_text(text, 'utf-8')
    except OSError as error:
        raise LayoutError(f'expected a file to write, got {error}') from error
    print(arguments.out)
    return 0


def layout(program: str, namespace: str = '', axis: str = 'z', quantity: str = 'force') -> str:
    """Return the layout of a program, as its file has it.

    Parameters
    ----------
    program : str
        ``foxglove`` or ``plotjuggler``.
    namespace : str
        Of the nodes, as ``left_leg`` or ``/ward/left_leg``; empty for none.
    axis : str
        Axis of the wrench that is shown: x, y or z, whatever its sign.
    quantity : str
        ``force`` or ``torque``.

    Raises
    ------
    LayoutError
        If one of them is none, or the layout is not installed.
    """
    for name, value, known in (
        ('program', program, tuple(_FILES)),
        ('axis', axis, tuple(AXES)),
        ('quantity', quantity, tuple(UNITS)),
    ):
        if value not in known:
            raise LayoutError(f'expected {name} {", ".join(known)}, got {value!r}')
    prefix = '/' + namespace.strip('/') if namespace.strip('/') else ''
    if not _NAMESPACE.fullmatch(prefix):
        raise LayoutError(f'expected a namespace of letters, digits and _, got {namespace!r}')

    def moved(path: str) -> str:
        shown = _WRENCH.sub(rf'wrench\g<1>{quantity}\g<2>{axis[-1]}', path)
        return prefix + shown if shown.startswith('/') else shown

    def titled(title: str) -> str:
        unit = UNITS[quantity]
        title = title.replace('Force', quantity.capitalize()).replace('force', quantity)
        return re.sub(r'(?<=[ \[])N(?=[ \]]|$)', unit, title)

    text = _installed(_FILES[program]).read_text('utf-8')
    return (_foxglove if program == 'foxglove' else _plotjuggler)(text, moved, titled)


def _foxglove(text: str, moved: Callable[[str], str], titled: Callable[[str], str]) -> str:
    def change(item: Any, key: str = '') -> Any:
        if isinstance(item, dict):
            return {name: change(value, name) for name, value in item.items()}
        if isinstance(item, list):
            return [change(value) for value in item]
        if key in ('value', 'topicPath'):
            return moved(item)
        return titled(item) if key in ('foxglovePanelTitle', 'label') else item

    return json.dumps(change(json.loads(text)), indent=2) + '\n'


def _plotjuggler(text: str, moved: Callable[[str], str], titled: Callable[[str], str]) -> str:
    text = re.sub(r'(<curve name=")([^"]+)', lambda found: found[1] + moved(found[2]), text)
    names = r'(<DockArea name="|tab_name=")([^"]+)'
    return re.sub(names, lambda found: found[1] + titled(found[2]), text)


def _installed(name: str) -> Path:
    """Return a file of the share folder, from wherever the package is installed."""
    prefixes = [*filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(':')), sys.prefix]
    for prefix in prefixes:
        path = Path(prefix, 'share', 'rpms_ros', 'config', name)
        if path.is_file():
            return path
    raise LayoutError(f'expected {name} below share/rpms_ros/config, got none in {prefixes}')
