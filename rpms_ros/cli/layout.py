# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`rpms layout`: a layout of Foxglove or PlotJuggler for the topics of one namespace."""

import argparse
from pathlib import Path
from typing import Any

from rpms_ros.cli.options import add_option, add_quantity_option


def add_parser(subparsers: Any) -> None:
    """Add `rpms layout`."""
    parser = subparsers.add_parser(
        'layout',
        help='write a layout of Foxglove or PlotJuggler',
        description='Write the layout of a plotting program for the topics of one namespace.',
        epilog='example: rpms layout foxglove --namespace left_leg --out left_leg.json',
    )
    parser.add_argument('program', choices=('foxglove', 'plotjuggler'), help='what it is for')
    add_option(parser, '--namespace NAME', '', 'of the nodes')
    add_option(parser, '--axis', 'z', 'axis of the wrench')
    add_quantity_option(parser)
    add_option(parser, '--out FILE', None, 'file to write; printed if not given', type=Path)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write or print a layout."""
    from rpms_ros.layouts import LayoutError, layout

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
