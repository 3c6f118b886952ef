# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`rpms layout`: a layout of Foxglove or PlotJuggler for the topics of one namespace."""

import argparse
from pathlib import Path
from typing import Any


def add_parser(subparsers: Any) -> None:
    """Add `rpms layout`."""
    parser = subparsers.add_parser(
        'layout',
        help='write a layout of Foxglove or PlotJuggler',
        description='Write the layout of a plotting program for the topics of one namespace.',
        epilog='example: rpms layout foxglove --namespace left_leg --out left_leg.json',
    )
    parser.add_argument('program', choices=('foxglove', 'plotjuggler'), help='what it is for')
    parser.add_argument('--namespace', default='', help='of the nodes (default: none)')
    parser.add_argument('--axis', default='z', help='axis of the wrench (default: z)')
    parser.add_argument(
        '--quantity',
        choices=('force', 'torque'),
        default='force',
        help='what the sensor measures (default: force)',
    )
    parser.add_argument('--out', type=Path, help='file to write (default: print it)')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write or print a layout."""
    from rpms_ros.layouts import LayoutError
    from rpms_ros.layouts import layout

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
