# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The command ``rpms``."""

import argparse
import atexit
import difflib
import gc
import os
import re
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from rpms_ros import __version__
from rpms_ros.cli.options import CLOSED, FAILURE, INTERRUPTED
from rpms_ros.errors import RpmsError
from rpms_ros.printable import printable

_NEED_ROS = ('demo', 'live')
COMMANDS = (
    *('identify', 'report', 'info', 'verify', 'analyze', 'import', 'export', 'simulate'),
    *('protocol', 'check', 'audit', *_NEED_ROS),
)
"""In the order of the help: what needs ROS last."""
# Module of this package for each command whose name is not that of its module.
_MODULES = {
    **dict.fromkeys(('info', 'verify'), 'recordings'),
    **dict.fromkeys(('import', 'export'), 'files'),
    **dict.fromkeys(('protocol', 'check'), 'schedules'),
}

_DESCRIPTION = """\
Identify a muscle that is stimulated by repetitive magnetic or electrical pulses.

Without ROS, from a simulated session or a table of your own to a page:
  rpms simulate --out session
  rpms import trial.csv --out session --time 'Time [s]' --force 'Force [N]' --pulse Gate
  rpms identify session --out results
  rpms report session --out report.html
"""
_EPILOG = """\
Help on one command: rpms help COMMAND, or rpms COMMAND --help
Exit codes: 0 well, 1 done but with something missing or wrong in the data, 2 not possible,
3 done, but the result must not be used (the verdict is no).
"""
# What an installation without extras lacks.
_EXTRAS = {'jinja2': 'report'}
_NO_ROS = 'it needs ROS 2 Jazzy and rpms_msgs: run make build, or source a workspace'


class _Parser(argparse.ArgumentParser):
    """A parser that names what may have been meant."""

    def error(self, message: str) -> NoReturn:
        """Print one line: the message, with the nearest command, choice or option; then exit."""
        given = re.search(r"invalid choice: '(.*?)'|unrecognized arguments: (--[\w-]+)", message)
        if given:
            known = re.findall(r'[\w-]+', message[given.end() :]) if given[1] else []
            known += re.findall(r'--[\w-]+', self.format_help()) if given[2] else []
            close = difflib.get_close_matches(given[1] or given[2] or '', known, n=1)
            message += f'; did you mean {close[0]}?' if close else ''
        # A usage of ten lines would hide it.
        self.exit(FAILURE, f'{self.prog}: error: {message} ({self.prog} --help)\n')


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    result = _Parser(
        prog='rpms',
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    result.add_argument('--version', action='version', version=f'rpms_ros {__version__}')
    subparsers = result.add_subparsers(metavar='COMMAND', required=True)
    for name in COMMANDS:
        module = import_module(f'rpms_ros.cli.{_MODULES.get(name, name)}')
        getattr(module, f'add_{name}')(subparsers)
        subparsers.choices[name].set_defaults(parser=subparsers.choices[name], command=name)
    return result


def _unknown(arguments: argparse.Namespace, unknown: Sequence[str]) -> str:
    """Return what is wrong with arguments that a command does not know."""
    # A shell makes many names of a star.
    if any(text.startswith('-') for text in unknown) or not hasattr(arguments, 'bag'):
        return f'unrecognized arguments: {" ".join(unknown)}'
    return f'expected one recording, got {len(unknown) + 1}'


def _lacking(error: ModuleNotFoundError, root: str, command: str) -> str:
    """Return what an installation without a module lacks."""
    if root in _EXTRAS:
        return f'{error}; pip install "rpms_ros[{_EXTRAS[root]}]"'
    return f'rpms {command} finds no {root}; {_NO_ROS}' if command in _NEED_ROS else str(error)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code."""
    # before NumPy is imported: its matrices are small, and threads that wait take processor time
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    # what imports make stays: to look through it again and again, and at the end, takes half of a
    # second
    gc.set_threshold(100_000)
    atexit.register(gc.freeze)
    texts = list(sys.argv[1:] if argv is None else argv)
    if texts[:1] == ['help']:
        texts = [*texts[1:], '--help']
    commands = parser()
    # set by a shell that asks how a word may go on
    if '_ARGCOMPLETE' in os.environ:
        from argcomplete import autocomplete

        autocomplete(commands)
    arguments, unknown = commands.parse_known_args(texts)
    if unknown:
        arguments.parser.error(_unknown(arguments, unknown))
    try:
        code: int = arguments.run(arguments)
        sys.stdout.flush()
    except ModuleNotFoundError as error:
        root = (error.name or '').partition('.')[0]
        if root == 'rpms_ros':
            raise
        print(f'rpms: error: {_lacking(error, root, arguments.command)}', file=sys.stderr)
        return FAILURE
    except BrokenPipeError:
        # The reader has closed our output: nothing may be flushed into it any more.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return CLOSED
    # the system says what of a path it cannot take, such as a name of 300 letters
    except (RpmsError, OSError) as error:
        print(f'rpms: error: {printable(str(error))}', file=sys.stderr)
        return FAILURE
    except KeyboardInterrupt:
        print('rpms: interrupted', file=sys.stderr)
        return INTERRUPTED
    return code
