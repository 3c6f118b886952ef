"""``rpms import``: a table of a laboratory becomes a recording."""

import argparse
from pathlib import Path

from rpms_ros.cli.options import add_command
from rpms_ros.errors import RecordingError

_DESCRIPTION = """\
Makes a recording of a table with one row a sample: time [s], force [N] and the stimulator's gate
as the data acquisition sampled it.  Every rising edge of the gate becomes a pulse; its width is
measured.  A gate does not tell the intensity: give it if it was not the maximum.
"""
_EXAMPLES = """\
  rpms import trial.csv --out trial --time 'Time [s]' --force 'fGM [N]' --pulse 'STIM [ ]'
  rpms import trial.csv --out trial --time t --force F --pulse gate --threshold 2.5 --intensity 0.8
  rpms identify trial --preset table_5
"""


def add_parser(subparsers: 'argparse._SubParsersAction[argparse.ArgumentParser]') -> None:
    """Add the command to the command line."""
    parser = add_command(
        subparsers, 'import', run, 'a table (CSV) becomes a recording', _DESCRIPTION, _EXAMPLES
    )
    parser.add_argument('csv', type=Path, metavar='CSV', help='table with named columns')
    parser.add_argument('--out', type=Path, required=True, metavar='BAG', help='new folder')
    parser.add_argument('--time', required=True, metavar='COL', help='column of the time [s]')
    parser.add_argument('--force', required=True, metavar='COL', help='column of the force [N]')
    parser.add_argument('--pulse', required=True, metavar='COL', help='column of the gate')
    parser.add_argument(
        '--threshold',
        type=float,
        metavar='LEVEL',
        help='level of the gate between rest and pulse (default: half of its range)',
    )
    parser.add_argument(
        '--intensity',
        type=float,
        default=1.0,
        metavar='SHARE',
        help="share of the stimulator's maximum of every pulse, 0 to 1 (default: 1)",
    )
    parser.add_argument(
        '--storage', choices=('mcap', 'sqlite3'), default='mcap', help='default: mcap'
    )


def run(arguments: argparse.Namespace) -> int:
    """Import the table and say what it held."""
    from rpms_ros.recording import GateSettings
    from rpms_ros.recording import read_csv
    from rpms_ros.recording import write_recording

    if arguments.out.exists():
        raise RecordingError(f'expected a new folder for the recording, got {arguments.out}')
    pulses, forces = read_csv(
        arguments.csv,
        arguments.time,
        arguments.force,
        arguments.pulse,
        GateSettings(arguments.threshold, arguments.intensity),
    )
    custom = {'source': arguments.csv.name}
    write_recording(arguments.out, pulses, forces, storage=arguments.storage, custom=custom)
    span = (forces.stamp_ns[-1] - forces.stamp_ns[0]) / 1e9
    print(f'{arguments.out}: {len(pulses)} pulses, {len(forces)} samples, {span:.3f} s')
    return 0
