# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms live``: a running session in the browser."""

import argparse
import secrets
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit

from rpms_ros.cli.options import Subparsers, add_command, add_option, add_sensor_options

EVERYWHERE = '0.0.0.0'
"""Stands for every address of the machine."""


def add_live(subparsers: Subparsers) -> None:
    """Add `rpms live`."""
    summary = 'a running session in the browser (needs ROS 2)'
    parser = add_command(subparsers, 'live', run_live, summary)
    add_option(parser, '--namespace NAME', '/', 'namespace of the nodes')
    add_option(parser, '--port N', 8765, 'port to listen on; 0 takes a free one')
    text = 'address of this machine to listen on; 0.0.0.0 lets the network look'
    add_option(parser, '--address A', '127.0.0.1', text)
    text = 'name of this machine under which the page may be asked for, beside addresses'
    add_option(parser, '--allow-name NAME', [], text, action='append', type=str)
    either = parser.add_argument_group('an additional stop').add_mutually_exclusive_group()
    either.add_argument('--stop', action='store_true', help='offer it, with a new token')
    text = 'offer it, with the token in a file that its owner alone can read'
    add_option(either, '--token-file FILE', None, text, type=Path)
    group = parser.add_argument_group('where the data are')
    for name in ('force', 'pulses'):
        text = f'topic of the {name}, relative to the namespace'
        add_option(group, f'--{name}-topic NAME', name, text)
    add_sensor_options(group)


def run_live(arguments: argparse.Namespace) -> int:
    """Serve the page until a signal; return the exit code.

    Serves one page that shows a running session: force measured and modelled, pulses, recruitment
    curve and parameters with their bands, changes, doubts, faults, the stimulator driver and the
    dose. It listens on this machine's own address, needs no network, and disturbs nobody: what it
    hears it asks for best effort.  With a token it offers a stop as well, which is an additional
    one: it needs a browser, a network and two programs, and no driver can count on it.

    Examples
    --------
      rpms live                         the session in namespace /, at http://127.0.0.1:8765/
      rpms live --namespace left_leg    one of several
      rpms live --stop                  with a stop; the address that is printed holds the token
      rpms live --address 0.0.0.0       for a phone in the same network

    exit code: 0 after Ctrl-C, 2 if the page could not be served.
    """
    from rpms_ros.live.server import token_of
    from rpms_ros.nodes.live_page import serve

    token = secrets.token_urlsafe(24) if arguments.stop else ''
    if arguments.token_file is not None:
        token = token_of(arguments.token_file)
    names = ('address', 'port', 'axis', 'quantity')
    parameters = {name: getattr(arguments, name) for name in names}
    parameters['names'] = ['localhost', *arguments.allow_name]
    topics = {'force': arguments.force_topic, 'pulses': arguments.pulses_topic}
    tell = partial(print_address, arguments.address)
    return serve(arguments.namespace, token, parameters, topics, tell)


def print_address(listening: str, url: str, token: str) -> None:
    """Print where the page is: a token goes behind ``#``, which browsers never send.

    Parameters
    ----------
    listening : str
        Address that was asked for: if it is every address of the machine, the form of those for
        others is printed too.
    url : str
        Address of the page on this machine.
    token : str
        What presses its stop; empty for a page that only shows.
    """
    fragment = f'#token={token}' if token else ''
    print(f'{url}{fragment}', flush=True)
    if listening == EVERYWHERE:
        port = urlsplit(url).port
        print(f'elsewhere: http://ADDRESS-OF-THIS-MACHINE:{port}/{fragment}', flush=True)
