"""The command ``rpms``: one file a command."""

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module

from rpms_ros.errors import RpmsError

COMMANDS = (
    'demo',
    'simulate',
    'info',
    'identify',
    'study',
    'analyze',
    'report',
    'replay',
    'import_csv',
    'protocol',
    'check',
)
"""Modules of this package, in the order of the help."""

SUCCESS, INCOMPLETE, FAILURE, INTERRUPTED = 0, 1, 2, 130
_DESCRIPTION = """\
Identify a muscle that is stimulated by repetitive magnetic or electrical pulses.

  rpms demo                              everything at once, live, with a simulated muscle
  rpms simulate --out session            a recording of a simulated session
  rpms info session                      what a recording holds
  rpms identify session --out results    what the recording says about the muscle
  rpms analyze session --out results     latency, twitch, summation, recruitment
  rpms report session --out report.html  one page that can be read, printed and sent
  rpms replay session                    through the real nodes: the same estimates again?
  rpms import trial.csv --out trial --time 'Time [s]' --force 'Force [N]' --pulse Gate
"""
_EPILOG = """\
Each command explains itself: rpms COMMAND --help
Exit codes: 0 well, 1 done but with something missing or wrong in the data, 2 not possible.
"""


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    result = argparse.ArgumentParser(
        prog='rpms',
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    subparsers = result.add_subparsers(metavar='COMMAND', required=True)
    for name in COMMANDS:
        import_module(f'rpms_ros.cli.{name}').add_parser(subparsers)
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code."""
    arguments = parser().parse_args(argv)
    try:
        code: int = arguments.run(arguments)
        sys.stdout.flush()
    except RpmsError as error:
        print(f'rpms: error: {error}', file=sys.stderr)
        return FAILURE
    except BrokenPipeError:
        # Whoever read our output has seen enough; nothing may be flushed into it any more.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return SUCCESS
    except KeyboardInterrupt:
        print('rpms: interrupted', file=sys.stderr)
        return INTERRUPTED
    return code
