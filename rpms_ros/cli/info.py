# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms info``: what a recording holds."""

import argparse
import json
import sys
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpms_ros.cli.import_file import add_signal_options
from rpms_ros.cli.options import add_command, add_memory_option, progress, read
from rpms_ros.errors import RecordingError
from rpms_ros.printable import printable
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.report.text import noted, table
from rpms_ros.schema import plain

if TYPE_CHECKING:
    from rpms_ros.recording import Recording, RecordingFacts

_DESCRIPTION = """\
Shows topics, types, numbers of messages, duration and what is wrong with a recording.
Reads mcap and sqlite3: a folder, a single file, split, compressed, or cut off by a killed writer;
and files of a laboratory, as `rpms import` does.
"""
_EXAMPLES = """\
  rpms info bags/sample
  rpms info session/session_0.mcap --json
"""


def add_parser(subparsers: 'argparse._SubParsersAction[argparse.ArgumentParser]') -> None:
    """Add the command to the command line."""
    parser = add_command(
        subparsers, 'info', run, 'what a recording holds', _DESCRIPTION, _EXAMPLES
    )
    parser.add_argument('bag', type=Path, metavar='BAG', help='folder or file of the recording')
    parser.add_argument('--json', action='store_true', help='one JSON object instead of text')
    add_memory_option(parser)
    add_signal_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the facts; return 1 if something is wrong with the recording."""
    from rpms_ros.recording import read_facts
    from rpms_ros.recording.importing import is_foreign

    if is_foreign(arguments.bag):
        facts = _facts_of_file(read(arguments.bag, arguments))
    else:
        with progress('reading', None, 'messages', arguments.quiet) as advance:
            facts = read_facts(arguments.bag, advance, arguments.max_memory)
    if (apart := _apart(arguments.bag, arguments.max_memory)) is not None:
        faults = {**facts.faults, 'pulses_apart': 1}
        facts = replace(facts, faults=faults, remarks=(*facts.remarks, apart))
    if arguments.json:
        json.dump(as_document(facts), sys.stdout, indent=2)
        print()
    else:
        print(as_text(facts))
    return 1 if facts.faults else 0


def _facts_of_file(recording: 'Recording') -> 'RecordingFacts':
    """Return the facts of a file of a laboratory: pulses and samples in place of topics."""
    from rpms_ros.recording.rosbag.scan import TopicFacts

    pulses, forces = recording.pulses.onset_ns, recording.forces.stamp_ns
    topics = tuple(
        TopicFacts(name, kind, len(stamps), int(stamps[0]), int(stamps[-1]))
        for name, kind, stamps in (
            ('pulses', 'pulses', pulses),
            (recording.quantity, 'samples', forces),
        )
        if len(stamps)
    )
    return replace(recording.facts, topics=topics)


def _apart(bag: Path, memory: int | None) -> str | None:
    """Return a sentence if pulses and force do not overlap by their stamps, else None."""
    from rpms_ros.identification.stream.pulse_checks import no_overlap
    from rpms_ros.recording import read_recording

    try:
        recording = read_recording(bag, memory=memory)
    except RecordingError:
        # topics of other names, or without messages: there is nothing to compare
        return None
    return no_overlap(recording.pulses.onset_ns, recording.forces.stamp_ns)


def as_document(facts: 'RecordingFacts') -> dict[str, Any]:
    """Return the facts as JSON takes them; times in s."""
    return {
        'recording': str(facts.path),
        'storage': facts.storage,
        'topics': [
            {
                'name': topic.name,
                'type': topic.type_name,
                'messages': topic.count,
                'first_s': topic.first_ns / NANOSECONDS_PER_SECOND,
                'duration_s': (topic.last_ns - topic.first_ns) / NANOSECONDS_PER_SECOND,
            }
            for topic in facts.topics
        ],
        'custom': dict(facts.custom),
        'schedules': plain(facts.schedules),
        'faults': dict(facts.faults),
        'remarks': list(facts.remarks),
    }


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
    parts = (head, textwrap.indent(topics, '  '), notes)
    return '\n'.join(part for part in parts if part)
