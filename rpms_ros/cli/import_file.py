# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms import``: a file of a laboratory becomes a recording."""

import argparse
import os
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpms_ros.axis import FORCE
from rpms_ros.cli.options import add_command, add_option
from rpms_ros.errors import RecordingError
from rpms_ros.printable import counted
from rpms_ros.report.text import labelled

if TYPE_CHECKING:
    from rpms_ros.recording import Recording
    from rpms_ros.recording.importing import Guess, Imported, ImportOptions, SignalFile

# Those of `rpms_ros.recording.importing`, which takes long to import.
_SENSOR_UNITS = ('N', 'mN', 'kN', 'g', 'kg', 'lbf', 'Nm', 'mNm', 'kNm', 'kgm', 'ft-lbf')
_DESCRIPTION = """\
Makes a recording of a file with time, force and the stimulator's gate or trigger: tables of text
(any separator, decimal commas, UTF-8, UTF-16 and Latin-1), text exported by LabChart and Spike2,
MATLAB .mat, Excel .xlsx and XDF of the Lab Streaming Layer.  What is what is guessed and shown; on
a terminal it is asked for, and each option below decides it.  Every rising edge of a gate is a
pulse, or every falling one if the gate rests high; its width is measured.  A gate does not tell
the intensity: give it if it was below 1, or the column or file that has it.
What `rpms export` has written is read again without options, with the same numbers.
"""
_EXAMPLES = """\
  rpms import trial.csv --out trial
  rpms import trial.csv --out trial --time 'Time [s]' --force 'fGM [N]' --pulse 'STIM [ ]'
  rpms import session.mat --out session --force data.fz --force-unit mN --threshold 2.5
  rpms import leg.xdf --out leg --intensity 0.8
  rpms identify trial
"""


def add_parser(subparsers: 'argparse._SubParsersAction[argparse.ArgumentParser]') -> None:
    """Add the command to the command line."""
    parser = add_command(
        subparsers, 'import', run, 'a file of a laboratory becomes a recording', _DESCRIPTION,
        _EXAMPLES,
    )  # fmt: skip
    parser.add_argument(
        'file', type=Path, metavar='FILE', help='.csv, .txt, .mat, .xlsx, .xdf, or an export'
    )
    parser.add_argument('--out', type=Path, required=True, metavar='BAG', help='new folder')
    add_signal_options(parser)
    add_option(parser, '--storage', 'mcap', 'of the recording', choices=('mcap', 'sqlite3'))


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
        "share of the stimulator's maximum of every pulse, 0 to 1; or a column with it, "
        'COLUMN/FULL if that is FULL at the maximum, or a file with one a pulse'
    )
    add_option(group, '--intensity SHARE|COLUMN|FILE', 1.0, text, type=_share_or_name)
    add_option(group, '--block N', None, 'block of a LabChart file, from 1', type=int)
    add_option(group, '--sheet NAME', None, 'sheet of a workbook')
    parser.add_argument('--yes', action='store_true', help='ask nothing on a terminal')


def _share_or_name(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def run(arguments: argparse.Namespace) -> int:
    """Import the file and say what it held."""
    if os.path.lexists(arguments.out):
        raise RecordingError(f'expected a new folder for the recording, got {arguments.out}')
    found = imported(arguments.file, arguments)
    _write(arguments, found)
    stamps = found.forces.stamp_ns
    span = (stamps[-1] - stamps[0]) / 1e9 if len(stamps) else 0.0
    counts = f'{counted(len(found.pulses), "pulse")}, {counted(len(stamps), "sample")}'
    print(f'{arguments.out}: {counts}, {span:.3f} s')
    if found.quantity != FORCE:
        print(f'  a {found.quantity}: read it with --quantity {found.quantity}')
    return 0


def imported(path: Path, arguments: argparse.Namespace) -> 'Imported':
    """Return what a file holds, as the options say; a terminal is asked for the rest."""
    from rpms_ros.recording.importing import guess_by, import_file

    asked = _asked(arguments)
    options = signal_options(arguments)
    found = import_file(path, options, _questioned if asked else guess_by)
    # A terminal has seen the guess, but not what the numbers told after it.
    told = found.remarks if asked else found.facts
    if found.guessed and told:
        print(labelled(told), file=sys.stderr)
    return found


def imported_recording(path: Path, arguments: argparse.Namespace) -> 'Recording':
    """Return what a file holds as if it had been recorded."""
    from rpms_ros.api.loading import as_recording
    from rpms_ros.pulses import ForceTrace

    found = imported(path, arguments)
    if getattr(arguments, 'quantity', FORCE) not in (FORCE, found.quantity):
        raise RecordingError(
            f'expected a {arguments.quantity}, got a {found.quantity} in {path}; --force-unit '
            'decides'
        )
    sign = getattr(arguments, 'sign', 1)
    forces = ForceTrace(found.forces.stamp_ns, sign * found.forces.force)
    return as_recording(found.pulses, forces, path, 'file', found.quantity)


def signal_options(arguments: argparse.Namespace) -> 'ImportOptions':
    """Return what the command line says of a file."""
    from rpms_ros.recording.importing import ImportOptions

    return ImportOptions(
        **{one.name: getattr(arguments, one.name) for one in fields(ImportOptions)}
    )


def _asked(arguments: argparse.Namespace) -> bool:
    return sys.stdin.isatty() and sys.stderr.isatty() and not arguments.yes


def _questioned(file: 'SignalFile', options: 'ImportOptions') -> 'Guess':
    """Return the guess; what cannot be guessed is asked for, and then whether it is right."""
    from rpms_ros.recording.importing import Ambiguous, guess_by

    while True:
        try:
            guess = guess_by(file, options)
            break
        except Ambiguous as error:
            name = error.option.removeprefix('--').replace('-', '_')
            if getattr(options, name) is not None:
                raise
            print(f'{error}\n{_numbered(error.candidates)}', file=sys.stderr)
            answer: dict[str, Any] = {name: _chosen(error.candidates)}
            options = replace(options, **answer)
    if not _agreed(file, guess):
        raise RecordingError('expected the guess to be accepted; the options decide otherwise')
    return guess


def _numbered(names: tuple[str, ...]) -> str:
    return '\n'.join(f'  {number} {name}' for number, name in enumerate(names, 1))


def _chosen(names: tuple[str, ...]) -> str:
    print(f'which, 1 to {len(names)}? ', end='', file=sys.stderr, flush=True)
    answer = sys.stdin.readline().strip()
    if answer.isdecimal() and 1 <= int(answer) <= len(names):
        return names[int(answer) - 1]
    raise RecordingError(f'expected a number from 1 to {len(names)}, got {answer!r}')


def _agreed(file: 'SignalFile', guess: 'Guess') -> bool:
    print(_shown(file, guess), file=sys.stderr)
    print('import it like this [Y/n]? ', end='', file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ('', 'y', 'yes')


def _shown(file: 'SignalFile', guess: 'Guess') -> str:
    return labelled([('file', ', '.join((file.kind, *file.facts))), *guess.reasons])


def _write(arguments: argparse.Namespace, found: 'Imported') -> None:
    """Write the recording beside its place and move it there as a whole."""
    from rpms_ros.recording import write_recording
    from rpms_ros.recording.export import written_whole

    def write(made: Path) -> None:
        custom = {'source': arguments.file.name}
        write_recording(
            made,
            found.pulses,
            found.forces,
            storage=arguments.storage,
            custom=custom,
            quantity=found.quantity,
        )

    written_whole(arguments.out, write)
