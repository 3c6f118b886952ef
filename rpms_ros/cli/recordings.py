# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms info`` and ``rpms verify``: what a recording holds, and whether it is whole."""

import argparse
import json
import textwrap
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rpms_ros.cli.files import add_signal_options
from rpms_ros.cli.options import (
    Subparsers,
    add_bag,
    add_command,
    add_json,
    add_memory_option,
    add_option,
    add_reading_options,
    of_a_laboratory,
    progress,
    read,
)
from rpms_ros.printable import printable
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.report.text import noted, table
from rpms_ros.schema import plain

if TYPE_CHECKING:
    from rpms_ros.recording import Recording, RecordingFacts


def add_info(subparsers: Subparsers) -> None:
    """Add `rpms info`."""
    parser = add_command(subparsers, 'info', run_info, 'what a recording holds')
    add_bag(parser)
    add_json(parser)
    add_memory_option(parser)
    add_signal_options(parser)


def run_info(arguments: argparse.Namespace) -> int:
    """Print the facts; return 1 if something is wrong with the recording.

    Shows topics, types, numbers of messages, duration and what is wrong with a recording. Reads
    mcap and sqlite3: a folder, a single file, split, compressed, or cut off by a killed writer;
    and files of a laboratory, as `rpms import` does.

    Examples
    --------
      rpms info bags/sample
      rpms info session/session_0.mcap --json
    """
    from rpms_ros.recording import read_facts

    if of_a_laboratory(arguments.bag, arguments):
        facts = _facts_of_file(read(arguments.bag, arguments))
    else:
        with progress('reading', None, 'messages', arguments.quiet) as advance:
            facts = read_facts(arguments.bag, advance, arguments.max_memory)
    if arguments.json:
        print(json.dumps(plain(facts), indent=2, default=str))
    else:
        print(as_text(facts))
    return 1 if facts.faults else 0


def _facts_of_file(recording: 'Recording') -> 'RecordingFacts':
    """Return the facts of a file of a laboratory: pulses and samples in place of topics."""
    from rpms_ros.recording.rosbag.scan import TopicFacts

    pulses, forces = recording.pulses.onset_ns, recording.forces.stamp_ns
    found = (('pulses', 'pulses', pulses), (recording.quantity, 'samples', forces))
    topics = tuple(
        TopicFacts(name, kind, len(stamps), int(stamps[0]), int(stamps[-1]))
        for name, kind, stamps in found
        if len(stamps)
    )
    return replace(recording.facts, topics=topics)


def as_text(facts: 'RecordingFacts') -> str:
    """Return the facts as a table."""
    rows = []
    for topic in facts.topics:
        duration = (topic.last_ns - topic.first_ns) / NANOSECONDS_PER_SECOND
        silent = topic.silent_ns / NANOSECONDS_PER_SECOND
        rate = f'{(topic.count - 1) / (duration - silent):.1f} Hz' if duration > silent else ''
        rate += f', {silent:.3f} s without' if silent else ''
        rows.append((topic.name, topic.type_name, str(topic.count), f'{duration:.3f} s', rate))
    topics = table(('topic', 'type', 'messages', 'duration', 'rate'), rows, texts=2)
    told = [('accepted', str(schedule)) for schedule in facts.schedules]
    warnings = [('warning', remark) for remark in facts.remarks]
    notes = noted([*facts.custom.items(), *told, *warnings])
    head = f'{printable(str(facts.path))}  ({facts.storage})'
    return '\n'.join(filter(None, (head, textwrap.indent(topics, '  '), notes)))


def add_verify(subparsers: Subparsers) -> None:
    """Add `rpms verify`."""
    parser = add_command(subparsers, 'verify', run_verify, 'is a recording whole and unchanged')
    add_bag(parser)
    text = 'audit log of the driver that gave the pulses'
    add_option(parser, '--audit FILE', None, text, type=Path)
    add_json(parser)
    add_reading_options(parser)


def run_verify(arguments: argparse.Namespace) -> int:
    """Print what was found; return 1 if something is wrong.

    Checks a recording, one line a finding: structure, checksums, publishers, lost messages,
    accepted schedules, pulses and force on one clock; and shows the hash of the session that
    results and reports carry.  Faults of the numbers are those of `rpms identify`.

    Examples
    --------
      rpms verify session
      rpms verify session --audit audit.jsonl         the pulses that the driver gave?
    exit codes: 0 nothing wrong, 1 a line says FAULT, 2 cannot be read
    """
    from rpms_ros.recording.rosbag.verifying import FAULT, verify

    pulses_and_force = partial(read, arguments.bag, arguments)
    findings = verify(arguments.bag, pulses_and_force, arguments.max_memory, arguments.audit)
    if arguments.json:
        rows = [vars(finding) for finding in findings]
        print(json.dumps({'recording': str(arguments.bag), 'findings': rows}))
    else:
        for finding in findings:
            print(f'{finding.check:<11}{finding.state:<9}{finding.text}')
    return 1 if any(finding.state == FAULT for finding in findings) else 0
