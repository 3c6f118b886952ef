# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms export``: a recording as files of other programs."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rpms_ros.cli.options import (
    INCOMPLETE,
    SUCCESS,
    add_command,
    add_option,
    add_reading_options,
    read,
    warn,
)
from rpms_ros.errors import RecordingError
from rpms_ros.printable import counted

if TYPE_CHECKING:
    from rpms_ros.recording.export import SessionExport

FORMATS = ('csv', 'mat', 'bids')
_DESCRIPTION = """\
Writes force, pulses and recorded estimates for other programs: a folder of CSV files, a MATLAB
file (version 5), or a BIDS dataset with the stimulation as NIBS-BIDS (BEP 037, a draft) has it.
Every number is written with all of its digits: `rpms import` reads the same numbers again.
Nothing is replaced.
"""
_EXAMPLES = """\
  rpms export bags/sample --to csv --out sample_csv       force.csv, pulses.csv, session.json
  rpms export session --to mat --out session.mat
  rpms export session --to bids --out dataset --subject 07 --session 2 --anonymous
  rpms import dataset --out again                         the same numbers again
exit codes: 0 well, 1 the recording has faults, 2 not possible
"""


def add_parser(subparsers: 'argparse._SubParsersAction[argparse.ArgumentParser]') -> None:
    """Add the command to the command line."""
    parser = add_command(
        subparsers, 'export', run, 'a recording as files of other programs', _DESCRIPTION,
        _EXAMPLES,
    )  # fmt: skip
    parser.add_argument('bag', type=Path, metavar='BAG', help='folder or file of the recording')
    parser.add_argument('--to', required=True, choices=FORMATS, help='what is written')
    text = 'new folder; new file of MATLAB'
    parser.add_argument('--out', type=Path, required=True, metavar='PLACE', help=text)
    text = 'leave out date, name and notes; times begin at 0'
    parser.add_argument('--anonymous', action='store_true', help=text)
    group = parser.add_argument_group('names of a BIDS dataset (letters and digits)')
    add_option(group, '--subject LABEL', '01', 'of the person')
    add_option(group, '--session LABEL', '', 'of the visit, if there are several')
    add_option(group, '--task LABEL', 'rpms', 'of what was done')
    text = 'which recording of the visit, from 1'
    add_option(group, '--run N', None, text, type=int, dest='run_number')
    add_reading_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Export the session and say what was written."""
    from rpms_ros.recording.export import (
        BidsNames,
        write_bids,
        write_matlab,
        write_tables,
        written_whole,
    )

    names = BidsNames(arguments.subject, arguments.task, arguments.session, arguments.run_number)
    if arguments.to != 'bids' and names != BidsNames():
        raise RecordingError(
            f'expected names of a dataset with --to bids, got --to {arguments.to}'
        )
    if arguments.to == 'mat' and arguments.out.suffix.lower() != '.mat':
        raise RecordingError(f'expected a file that ends with .mat, got {arguments.out}')
    session, findings = _session(arguments)

    def write(place: Path) -> None:
        if arguments.to == 'bids':
            write_bids(place, session, names)
        else:
            {'csv': write_tables, 'mat': write_matlab}[arguments.to](place, session)

    written_whole(arguments.out, write)
    rows = 0 if session.estimates is None else len(session.estimates.stamp_ns)
    counts = f'{counted(len(session.pulses), "pulse")}, {counted(len(session.forces), "sample")}'
    print(f'{arguments.out}: {counts}, {rows} estimates')
    warn(findings)
    return INCOMPLETE if findings else SUCCESS


def _session(arguments: argparse.Namespace) -> tuple['SessionExport', list[tuple[str, str]]]:
    """Return what is exported, and what was wrong with it."""
    from rpms_ros.recording import session_hash
    from rpms_ros.recording.export import SessionExport
    from rpms_ros.recording.rosbag.reading import held_bytes
    from rpms_ros.report.recorded import estimate_table, recorded_messages

    path = arguments.bag
    name = path.resolve().name
    recording = read(path, arguments)
    nodes = recorded_messages(path, memory=arguments.max_memory, held=held_bytes(recording))
    findings = [('warning', remark) for remark in recording.facts.remarks]
    if nodes.unreadable:
        findings.append(('warning', f'{nodes.unreadable} messages could not be decoded'))
    if other := {one.unit for one in nodes.estimates} - {recording.unit}:
        units = ', '.join(sorted(other))
        findings.append(
            ('warning', f'expected estimates in {recording.unit}, got {units} (--quantity?)')
        )
    session = SessionExport(
        name,
        recording.pulses,
        recording.forces,
        recording.unit,
        estimate_table(nodes.estimates) if nodes.estimates else None,
        session_hash(recording),
        recording.facts.custom,
        arguments.anonymous,
    )
    return session, findings
