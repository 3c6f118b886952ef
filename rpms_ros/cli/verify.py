# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms verify``: whether a recording is whole and unchanged."""

import argparse
import json
from pathlib import Path

from rpms_ros.cli.options import (
    add_bag,
    add_command,
    add_memory_option,
    add_option,
    add_topic_options,
    topics_of,
)

_DESCRIPTION = """\
Checks a recording, one line a finding: structure, checksums, signature, publishers, clock, gaps,
doubles, values; and shows the hash of the session that results and reports carry.
"""
_EXAMPLES = """\
  rpms verify session
  rpms verify session --key laboratory.key        signed with this key?
  rpms verify session --audit audit.jsonl         the pulses that the driver gave?
exit codes: 0 nothing wrong, 1 a line says FAULT, 2 cannot be read
"""


def add_parser(subparsers: 'argparse._SubParsersAction[argparse.ArgumentParser]') -> None:
    """Add the command to the command line."""
    parser = add_command(
        subparsers, 'verify', run, 'is a recording whole and unchanged', _DESCRIPTION, _EXAMPLES
    )
    add_bag(parser)
    add_option(parser, '--key FILE', None, 'key of the signature', type=Path)
    text = 'audit log of the driver that gave the pulses'
    add_option(parser, '--audit FILE', None, text, type=Path)
    parser.add_argument('--json', action='store_true', help='one JSON object instead of text')
    add_topic_options(parser)
    add_memory_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print what was found; return 1 if something is wrong."""
    from rpms_ros.recording.rosbag.metadata import read_key
    from rpms_ros.recording.rosbag.verifying import FAULT, verify

    key = read_key(arguments.key) if arguments.key else None
    findings = verify(
        arguments.bag, topics_of(arguments), key, arguments.max_memory, arguments.audit
    )
    if arguments.json:
        rows = [vars(finding) for finding in findings]
        print(json.dumps({'recording': str(arguments.bag), 'findings': rows}))
    else:
        for finding in findings:
            print(f'{finding.check:<11}{finding.state:<9}{finding.text}')
    return 1 if any(finding.state == FAULT for finding in findings) else 0
