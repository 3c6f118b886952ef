# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms replay``: play a recording into the identifier node and compare the estimates."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from rpms_ros.cli.options import (
    Subparsers,
    add_bag,
    add_command,
    add_estimator_options,
    add_option,
    add_reading_options,
    progress,
    read,
)
from rpms_ros.errors import NodeError, RecordingError
from rpms_ros.schema import plain

if TYPE_CHECKING:
    from rpms_ros.nodes.replay import Replay
    from rpms_ros.report.recorded import Agreement

# Parameters that are not the identifier's own.
_OF_EVERY_NODE = ('use_sim_time', 'qos_overrides')

_DESCRIPTION = """\
Plays pulses and force of a recording over DDS into the real identifier node, as fast as it keeps
up or at a factor of the recorded speed, and compares its estimates with those in the recording, if
there are any, and with those of `rpms identify`: they have to agree in every bit.
Needs rclpy, in a domain of its own on this machine.
"""
_EXAMPLES = """\
  rpms replay session                      as fast as the node keeps up
  rpms replay session --factor 1           as fast as it was recorded
  rpms replay session --estimator tracking --parameters identifier.yaml
Exit code 1 if estimates differ or are missing.
"""


def add_replay(subparsers: Subparsers) -> None:
    """Add `rpms replay`."""
    parser = add_command(
        subparsers,
        'replay',
        run,
        'play a recording into the identifier node and compare the estimates (needs ROS 2)',
        _DESCRIPTION,
        _EXAMPLES,
    )
    add_bag(parser)
    text = 'seconds of the recording per second; 0 is as fast as the node keeps up'
    add_option(parser, '--factor F', 0.0, text)
    text = 'parameter file of the identifier; goes before the options of the estimator'
    add_option(parser, '--parameters FILE', None, text, type=Path)
    parser.add_argument('--json', action='store_true', help='one JSON object on stdout')
    add_reading_options(parser)
    # a node has to be one that works on line
    add_estimator_options(parser, on_line=True)


def run(arguments: argparse.Namespace) -> int:
    """Replay the recording; return 1 if estimates differ or are missing."""
    from rpms_ros.nodes.replay import replay
    from rpms_ros.report.recorded import compare, recorded_messages

    parameters = identifier_parameters(arguments)
    # what the file says goes before the option, as for the estimator
    arguments.quantity = parameters['quantity']
    recording = read(arguments.bag, arguments)
    recorded = recorded_messages(arguments.bag, memory=arguments.max_memory).estimates
    total = len(recording.pulses) + len(recording.forces)
    with progress('replaying', total, 'messages', arguments.quiet) as advance:
        done = replay(recording, parameters, arguments.factor, advance)
    off_line = compare(done.expected, done.estimates)
    again = compare(recorded, done.estimates) if recorded else None
    document = as_document(done, off_line, again)
    if arguments.json:
        print(json.dumps(document, allow_nan=False))
    else:
        print(f'{arguments.bag}\n{_as_text(document)}')
    exact = off_line.exact and (again is None or again.exact)
    return 0 if exact else 1


def identifier_parameters(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the parameters of the identifier.

    Raises
    ------
    NodeError
        If the parameter file holds none of an identifier.
    """
    parameters = {
        'estimator': arguments.estimator,
        'preset': arguments.preset,
        'repetition_rate': arguments.rate_hz,
        'quantity': arguments.quantity,
    }
    if arguments.parameters is None:
        return parameters
    from rpms_ros.recording.rosbag.metadata import loaded, regular_text

    try:
        content = loaded(regular_text(arguments.parameters))
        return {**parameters, **_of_an_identifier(content, arguments.parameters)}
    except (OSError, RecordingError, ValueError, yaml.YAMLError) as error:
        raise NodeError(
            f'expected a parameter file, got {arguments.parameters}: {error}'
        ) from error


def _of_an_identifier(content: object, path: Path) -> dict[str, Any]:
    """Return the parameters for an identifier, of a file that may be one for several nodes."""
    from rpms_ros.nodes.common.parameters import blocks_of, descriptions
    from rpms_ros.nodes.identifier import IdentifierParameters

    blocks = dict(blocks_of(content))
    own = set(descriptions(IdentifierParameters))
    for_all = [block for name, block in blocks.items() if name.endswith('*')]
    named = {name: block for name, block in blocks.items() if not name.endswith('*')}
    # the only node of a file may have any name
    if len(named) > 1:
        named = {name: one for name, one in named.items() if name.endswith('/identifier')}
    if len(named) > 1:
        raise NodeError(
            f'expected parameters of one identifier in {path}, got those of {", ".join(named)}'
        )
    if not named and not for_all:
        raise NodeError(f'expected ros__parameters of an identifier in {path}, got none')
    found: dict[str, Any] = {}
    for block in for_all:
        found |= {name: value for name, value in block.items() if name in own}
    for block in named.values():
        # what rclpy gives every node says nothing of a replay
        found |= {name: value for name, value in block.items() if name not in _OF_EVERY_NODE}
    return found


def as_document(
    done: 'Replay', off_line: 'Agreement', recorded: 'Agreement | None'
) -> dict[str, Any]:
    """Return the result as JSON takes it; times in s."""
    return {
        'messages': done.messages,
        'estimates': len(done.estimates),
        'recorded_s': done.recorded_s,
        'elapsed_s': done.elapsed_s,
        'factor': done.factor,
        'off_line': _agreement(off_line),
        'recorded': recorded and _agreement(recorded),
    }


def _agreement(agreement: 'Agreement') -> dict[str, Any]:
    return {'exact': agreement.exact, **plain(agreement)}


def _as_text(document: dict[str, Any]) -> str:
    recorded = document['recorded']
    speed = f'{document["recorded_s"]:.3f} s in {document["elapsed_s"]:.3f} s'
    rows = (
        f'sent       {document["messages"]} messages, {speed}, factor {document["factor"]:.3g}',
        f'recorded   {_verdict(recorded) if recorded else "no estimates in the recording"}',
        f'off line   {_verdict(document["off_line"])}',
    )
    return '\n'.join(f'  {row}' for row in rows)


def _verdict(agreement: dict[str, Any]) -> str:
    if agreement['exact']:
        return f'all {agreement["compared"]} estimates, bit for bit'
    fields = ', '.join(f'{name} {count}' for name, count in agreement['differing'].items())
    return (
        f'DIFFERS: {agreement["missing"]} estimates missing, {agreement["compared"]} compared, '
        f'differing fields {fields or "none"}'
    )
