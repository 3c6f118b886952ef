# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms import`` and ``rpms export``: files of laboratories and of other programs."""

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rpms_ros.axis import FORCE
from rpms_ros.cli.options import (
    INCOMPLETE,
    SUCCESS,
    Subparsers,
    add_bag,
    add_command,
    add_option,
    add_reading_options,
    options_of,
    read,
    warn,
)
from rpms_ros.errors import RecordingError
from rpms_ros.printable import counted
from rpms_ros.report.text import labelled

if TYPE_CHECKING:
    from rpms_ros.recording import Recording
    from rpms_ros.recording.importing import Imported

# Those of `rpms_ros.recording.importing`, which takes long to import.
_SENSOR_UNITS = ('N', 'mN', 'kN', 'g', 'kg', 'lbf', 'Nm', 'mNm', 'kNm', 'kgm', 'ft-lbf')


def add_import(subparsers: Subparsers) -> None:
    """Add `rpms import`."""
    summary = 'a file of a laboratory becomes a recording'
    parser = add_command(subparsers, 'import', run_import, summary)
    parser.add_argument('file', type=Path, metavar='FILE', help='.csv, .txt, .mat, .xlsx, .xdf')
    parser.add_argument('--out', type=Path, required=True, metavar='BAG', help='new folder')
    add_signal_options(parser)


def add_signal_options(parser: argparse.ArgumentParser) -> None:
    """Add what says what is what in a file of a laboratory."""
    group = parser.add_argument_group('what is what in a file (guessed where not given)')
    add_option(group, '--time COL', None, 'column of the time')
    add_option(group, '--force COL', None, 'column of the force')
    add_option(group, '--pulse COL', None, 'column of the gate, or list of trigger times')
    units = ('s', 'ms', 'us', 'min')
    add_option(group, '--time-unit', None, 'unit of the time', choices=units)
    text = 'unit of the force, or of the torque of a dynamometer'
    add_option(group, '--force-unit', None, text, choices=_SENSOR_UNITS)
    text = 'unit of a list of trigger times; samples: numbers of samples'
    add_option(group, '--pulse-unit', None, text, choices=(*units, 'samples'))
    text = 'newtons of one unit of the force signal, as for a force in V; newton metres with Nm'
    add_option(group, '--force-scale N', None, text, type=float)
    text = 'rate of the samples of a table without times'
    add_option(group, '--sampling-rate HZ', None, text, type=float)
    text = 'level of the gate between rest and pulse; half of its range if not given'
    add_option(group, '--threshold LEVEL', None, text, type=float)
    text = 'edge of the gate with which a pulse begins; falling if it is high most of the time'
    add_option(group, '--edge', None, text, choices=('rising', 'falling'))
    text = (
        "share of the stimulator's maximum of every pulse, 0 to 1; or a column with it, or a file "
        'with one a pulse, NAME/FULL if it is FULL at the maximum'
    )
    add_option(group, '--intensity SHARE|COLUMN|FILE', 1.0, text, type=_share_or_name)
    add_option(group, '--block N', None, 'block of a LabChart file, from 1', type=int)
    add_option(group, '--sheet NAME', None, 'sheet of a workbook')


def _share_or_name(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def run_import(arguments: argparse.Namespace) -> int:
    """Import the file and say what it held.

    Makes a recording of a file with time, force and the stimulator's gate or trigger: tables of
    text (any separator, decimal commas, UTF-8, UTF-16 and Latin-1), text exported by LabChart,
    MATLAB .mat and Excel .xlsx.  What is what is guessed and shown, and each option below decides
    it.  Every rising edge of a gate is a pulse, or every falling one if the gate rests high; its
    width is measured.  A gate does not tell the intensity: give it if it was below 1, or the
    column or file that has it.

    Examples
    --------
      rpms import trial.csv --out trial
      rpms import trial.csv --out trial --time 'Time [s]' --force 'fGM [N]' --pulse 'STIM [ ]'
      rpms import session.mat --out session --force data.fz --force-unit mN --threshold 2.5
      rpms import leg.xlsx --out leg --intensity 0.8
      rpms identify trial
    """
    from rpms_ros.recording import write_recording
    from rpms_ros.recording.export import written_whole

    if os.path.lexists(arguments.out):
        raise RecordingError(f'expected a new folder for the recording, got {arguments.out}')
    found = imported(arguments.file, arguments)
    what, source = (found.pulses, found.forces), {'source': arguments.file.name}
    written_whole(
        arguments.out,
        lambda made: write_recording(made, *what, custom=source, quantity=found.quantity),
    )
    stamps = found.forces.stamp_ns
    span = (stamps[-1] - stamps[0]) / 1e9 if len(stamps) else 0.0
    counts = f'{counted(len(found.pulses), "pulse")}, {counted(len(stamps), "sample")}'
    print(f'{arguments.out}: {counts}, {span:.3f} s')
    if found.quantity != FORCE:
        print(f'  a {found.quantity}: read it with --quantity {found.quantity}')
    return 0


def imported(path: Path, arguments: argparse.Namespace) -> 'Imported':
    """Return what a file holds, as the options say; say what was guessed."""
    from rpms_ros.recording.importing import ImportOptions, import_file

    found = import_file(path, options_of(ImportOptions, arguments))
    if found.guessed:
        print(labelled(found.facts), file=sys.stderr)
    return found


def imported_recording(path: Path, arguments: argparse.Namespace) -> 'Recording':
    """Return what a file holds as if it had been recorded."""
    from rpms_ros.api.loading import recording_of

    sign, quantity = getattr(arguments, 'sign', 1), getattr(arguments, 'quantity', FORCE)
    return recording_of(imported(path, arguments), path, 'file', sign, quantity)


def add_export(subparsers: Subparsers) -> None:
    """Add `rpms export`."""
    summary = 'a recording as files of other programs'
    parser = add_command(subparsers, 'export', run_export, summary)
    add_bag(parser)
    parser.add_argument('--out', type=Path, required=True, metavar='DIR', help='new folder')
    text = 'leave out date, name and notes; times begin at 0'
    parser.add_argument('--anonymous', action='store_true', help=text)
    add_reading_options(parser)


def run_export(arguments: argparse.Namespace) -> int:
    """Export the session and say what was written.

    Writes force, pulses and recorded estimates for other programs: a folder of CSV files, every
    number with all of its digits.  Nothing is replaced.

    Examples
    --------
      rpms export bags/sample --out sample_csv       force.csv, pulses.csv, session.json
      rpms export session --out shared --anonymous
    exit codes: 0 well, 1 the recording has faults, 2 not possible
    """
    from rpms_ros.recording.export import write_tables, written_whole
    from rpms_ros.report.recorded import estimate_table, recorded_messages

    path = arguments.bag
    recording = read(path, arguments)
    nodes = recorded_messages(recording, memory=arguments.max_memory)
    findings = [*recording.facts.remarks]
    if nodes.unreadable:
        findings.append(f'{nodes.unreadable} messages could not be decoded')
    if other := {one.unit for one in nodes.estimates} - {recording.unit}:
        units = ', '.join(sorted(other))
        findings.append(f'expected estimates in {recording.unit}, got {units} (--quantity?)')
    if not recording.forces.force.any():
        findings.append(f'the {recording.quantity} is 0 in all samples (--axis, --quantity?)')
    estimates = estimate_table(nodes.estimates) if nodes.estimates else None
    what = (recording, path.resolve().name, estimates, arguments.anonymous)
    written_whole(arguments.out, lambda place: write_tables(place, *what))
    pulses, samples = len(recording.pulses), len(recording.forces)
    counts = f'{counted(pulses, "pulse")}, {counted(samples, "sample")}'
    print(f'{arguments.out}: {counts}, {len(nodes.estimates)} estimates')
    warn(('warning', text) for text in findings)
    return INCOMPLETE if findings else SUCCESS
