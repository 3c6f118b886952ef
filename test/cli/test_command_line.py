# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The command line itself: help, what may have been meant; a process of its own."""

import json
import os
import re
import signal
import subprocess
import sys

import pytest

from rpms_ros.cli import COMMANDS, main, options
from rpms_ros.identification import estimator_by_name
from rpms_ros.report.text import noted, with_interval

NAMES = list(COMMANDS)


def exits(capsys, *arguments):
    """Run what argparse ends by itself; return exit code, stdout and stderr."""
    with pytest.raises(SystemExit, match=r'\d') as ended:
        main(arguments)
    return (int(ended.value.code or 0), *capsys.readouterr())


def python(code, **environment):
    """Run a program in a process of its own, with no thread of BLAS asked for."""
    inherited = {k: v for k, v in os.environ.items() if not k.endswith('_NUM_THREADS')}
    return subprocess.run(
        [sys.executable, '-c', code],
        env=inherited | environment,
        capture_output=True,
        text=True,
        timeout=250,
        check=False,
    )


@pytest.mark.parametrize(
    ('typed', 'offered'),
    [
        ('rpms ident', ['identify ']),
        ('rpms identify --quan', ['--quantity ']),
        ('rpms identify --quantity ', ['force', 'torque']),
        ('rpms protocol stai', ['staircase ']),
        ('rpms nothing', []),
    ],
)
def test_a_shell_completes_commands_options_and_choices(typed, offered):
    asked = {'_ARGCOMPLETE': '1', '_ARGCOMPLETE_IFS': '\n', 'COMP_LINE': typed}
    program = 'import os; os.dup2(1, 8); from rpms_ros.cli import main; main()'
    answer = python(program, COMP_POINT=str(len(typed)), **asked)
    assert (answer.returncode, answer.stdout.splitlines()) == (0, offered)


def test_help_is_a_command_too(capsys):
    assert exits(capsys, 'help') == exits(capsys, '--help')
    assert exits(capsys, 'help', 'identify') == exits(capsys, 'identify', '--help')


def test_help_begins_with_what_works_without_ros(capsys):
    _, out, _ = exits(capsys, '--help')
    listed = out.partition('COMMAND\n')[2].partition('options:')[0]
    blocks = re.split(r'^ {4}(?=\w)', listed, flags=re.MULTILINE)[1:]
    assert [block.split()[0] for block in blocks] == NAMES
    marked = [block.split()[0] for block in blocks if '(needs ROS 2)' in ' '.join(block.split())]
    assert marked == NAMES[-2:] == ['demo', 'live']
    begun = out.partition('positional arguments:')[0]
    assert 'Without ROS' in begun
    assert 'rpms identify session' in begun
    assert not any(f'rpms {name}' in begun for name in marked)


@pytest.mark.parametrize('name', NAMES)
def test_no_help_shows_an_escaped_per_cent_sign_or_a_default_of_nothing(name, capsys):
    code, out, _ = exits(capsys, name, '--help')
    assert code == 0
    assert '%%' not in out
    assert '(default: [])' not in out
    assert max(map(len, out.splitlines())) <= 100


@pytest.mark.parametrize(
    ('arguments', 'meant'),
    [
        (['identfy', 'x'], 'identify'),
        (['identify', 'x', '--estimatr', 'batch'], '--estimator'),
        (['identify', 'x', '--preset', 'table4'], 'paper_table_4'),
        (['identify', 'x', '--preset', 'table_4'], 'paper_table_4'),
        (['demo', '--preset', 'table_5'], 'paper_table_5'),
    ],
)
def test_a_slip_of_the_keyboard_is_answered_with_what_was_meant(arguments, meant, capsys):
    code, _, err = exits(capsys, *arguments)
    assert code == 2
    assert f'; did you mean {meant}? (rpms' in err
    assert err.endswith(' --help)\n')
    assert err.count('\n') == 1
    assert 'did you mean' not in exits(capsys, 'xyzzy')[2]
    # as of a variable of the shell that nobody has set
    assert exits(capsys, 'demo', '--preset', '')[0] == 2


def test_a_star_that_stands_for_many_recordings_is_not_answered_with_their_names(capsys):
    code, _, err = exits(capsys, 'report', 'a', 'b', 'c')
    assert code == 2
    assert err == 'rpms report: error: expected one recording, got 3 (rpms report --help)\n'


@pytest.mark.parametrize(
    ('numbers', 'text'),
    [
        ((3.0, 2.9, 3.1), '3.00 N (2.90 to 3.10)'),
        ((9.9981, 9.9932, 10.0031), '9.9981 N (9.9932 to 10.0031)'),
        ((123.4, 61.0, 186.0), '123 N (61 to 186)'),
        ((2.0, 2.0, 2.0), '2 N (2 to 2)'),
        ((3.14159, None, None), '3.142 N'),
    ],
)
def test_a_number_has_the_decimals_of_its_interval(numbers, text):
    found = dict(zip(('value', 'lower', 'upper'), numbers, strict=True))
    assert with_interval(found, unit=' N') == text


def test_a_text_cannot_command_the_terminal():
    assert noted([('note', 'red \x1b[31m and \x07')]) == '  note: red ?[31m and ?'


def test_that_it_compiles_is_said_on_stderr_terminal_or_not(capsys, monkeypatch):
    def warm_up(_, tell, load=True):
        tell()
        assert not load

    monkeypatch.setattr('rpms_ros.identification.warm_up.warm_up', warm_up)
    for quiet, told in ((False, 1), (True, 0)):
        options.compile_estimator(lambda: estimator_by_name('batch'), quiet)
        assert capsys.readouterr().err.count('rpms: compiling for this machine, once') == told


def test_an_interrupt_while_it_compiles_is_not_lost():
    """In a callback of numba, from which no exception comes back."""
    code = (
        'import ctypes, os, signal\n'
        'from rpms_ros.cli.options import compile_estimator\n'
        'from rpms_ros.identification import warm_up\n'
        'signal.signal(signal.SIGINT, signal.default_int_handler)\n'
        'callback = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))\n'
        'warm_up.warm_up = lambda *_, load: callback()\n'
        'compile_estimator(None, quiet=True)\n'
        'print("went on")\n'
    )
    done = python(code)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, '', '')


@pytest.mark.long
def test_works_where_there_is_no_ros(short_session):
    code = (
        'import sys\n'
        'for name in ("rclpy", "rpms_msgs", "std_msgs"): sys.modules[name] = None\n'
        'from rpms_ros.cli import main\n'
        f'sys.exit(main(["identify", {str(short_session)!r}, "--json"]))\n'
    )
    done = python(code)
    assert (done.returncode, done.stderr) == (0, '')
    assert json.loads(done.stdout)['pulses'] == 200


@pytest.mark.parametrize(('command', 'missing'), [('demo', 'rcl_interfaces'), ('live', 'rclpy')])
def test_a_command_that_needs_ros_says_so_in_a_line(command, missing):
    code = (
        f'import sys\nsys.modules[{missing!r}] = None\nfrom rpms_ros.cli import main\n'
        f'sys.exit(main([{command!r}]))\n'
    )
    done = python(code)
    assert (done.returncode, done.stdout) == (2, '')
    assert done.stderr == (
        f'rpms: error: rpms {command} finds no {missing}; it needs ROS 2 Jazzy and rpms_msgs: '
        'run make build, or source a workspace\n'
    )


def test_a_reader_that_leaves_early_gets_no_verdict_and_the_files_are_there(
    short_session, tmp_path
):
    """The code of what was cut off was 0, that of a good result."""
    command = ['identify', '--quiet', str(short_session), '--out', str(tmp_path / 'out')]
    read_end, write_end = os.pipe()
    os.close(read_end)
    with os.fdopen(write_end, 'w') as pipe:
        done = subprocess.run(
            [sys.executable, '-u', '-m', 'rpms_ros.cli', *command],
            stdout=pipe,
            stderr=subprocess.PIPE,
            text=True,
            timeout=250,
            check=False,
        )
    assert (done.returncode, done.stderr) == (141, '')
    assert (tmp_path / 'out' / 'result.json').is_file()


@pytest.mark.parametrize(
    'started',
    [
        'import rpms_ros.cli as one\nwith suppress(SystemExit): one.main(["--help"])',
        # up to the import of the node
        'import rpms_ros.nodes.executables as one\nwith suppress(ImportError): one._run("x.y")',
    ],
    ids=['rpms', 'node'],
)
def test_linear_algebra_has_one_thread(started):
    code = (
        f'import os, sys\nfrom contextlib import suppress\n{started}\nimport numpy\n'
        'numpy.ones((900, 900)) @ numpy.ones((900, 900))\n'
        'print(len(os.listdir("/proc/self/task")))'
    )
    done = python(code)
    assert (done.returncode, done.stdout.split()[-1:]) == (0, ['1']), done.stderr


def test_what_the_system_says_of_a_path_is_one_line(capsys):
    assert main(['identify', 'a' * 300]) == options.FAILURE
    err = capsys.readouterr().err
    assert err.startswith('rpms: error: ')
    assert err.count('\n') == 1
    assert 'File name too long' in err
