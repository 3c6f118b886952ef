# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The runner as a process: exit codes, signals, one line for what is wrong."""

import signal
from pathlib import Path

import pytest
from rclpy.node import Node

from rpms_ros.errors import NodeError
from rpms_ros.nodes import executables

# of a process that imports and ends on a machine under load [s]
PATIENCE = 120.0
NODE = """
import sys
from dataclasses import dataclass
from rclpy.node import Node
from rpms_ros.nodes.common.parameters import NodeParameters, declare_parameters, parameter
from rpms_ros.nodes.common.runner import run

@dataclass(frozen=True)
class Example(NodeParameters):
    rate: float = parameter(20.0, 'Rate.', unit='Hz', bounds=(1.0, 50.0))

class ExampleNode(Node):

    settings_type = Example

    def __init__(self, **options):
        super().__init__('example', **options)
        settings = declare_parameters(self, Example)
        self.create_timer(0.01, lambda: print('running at', settings.rate, flush=True))

sys.exit(run(ExampleNode))
"""


def stopped(python, *arguments, stop=signal.SIGTERM):
    """The first line of a node that then gets a signal, its exit code and what it complains of."""
    process = python('-c', NODE, *arguments)
    line = process.stdout.readline()
    process.send_signal(stop)
    _, errors = process.communicate(timeout=PATIENCE)
    return line.strip(), process.returncode, errors


def ended(python, code, *arguments):
    """Exit code, stdout and stderr of a process that has run some code."""
    process = python('-c', code, *arguments)
    said = process.communicate(timeout=PATIENCE)
    return (process.returncode, *said)


@pytest.mark.parametrize('stop', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_node_with_exit_code_zero(python, stop):
    assert stopped(python, stop=stop) == ('running at 20.0', 0, '')


STARTER = """
import os, pathlib, subprocess, sys, time
heard = pathlib.Path(sys.argv[2])
environment = {**os.environ, 'RPMS_ROS_PARENT': str(os.getpid())}
with heard.open('w') as file:
    node = subprocess.Popen([sys.executable, '-c', sys.argv[1]], env=environment, stdout=file)
while 'running' not in heard.read_text():
    time.sleep(0.01)
print(node.pid, flush=True)
os._exit(0)
"""


def test_a_node_ends_with_whoever_started_it(python, tmp_path, wait_for):
    _, node, _ = ended(python, STARTER, NODE, str(tmp_path / 'heard'))
    wait_for(lambda: not is_running(int(node)))


def is_running(process):
    """Whether a process lives; one that nobody has waited for yet does not."""
    try:
        return ') Z ' not in Path(f'/proc/{process}/stat').read_text()
    except FileNotFoundError:
        return False


def test_parameters_come_from_a_yaml_file(python, tmp_path):
    file = tmp_path / 'example.yaml'
    file.write_text('example:\n  ros__parameters:\n    rate: 2.5\n    rat: 1.0\n')
    line, code, errors = stopped(python, '--ros-args', '--params-file', str(file))
    assert (line, code) == ('running at 2.5', 0)
    assert 'parameter rat is unknown here and ignored' in errors


def test_a_file_that_has_nothing_for_the_node_is_said(python, tmp_path):
    file = tmp_path / 'example.yaml'
    file.write_text('/**/example:\n  ros__parameters: {rate: 2.5}\n')
    arguments = ('--ros-args', '-r', '__node:=other', '--params-file', str(file))
    line, _, errors = stopped(python, *arguments)
    assert line == 'running at 20.0'
    assert 'WARN' in errors
    assert f'expected parameters for /other in {file}, got those of /**/example' in errors


@pytest.mark.parametrize(
    ('written', 'warned'),
    [
        ('exmple: {ros__parameters: {rate: 5.0}}', True),
        ('left: {example: {ros__parameters: {rate: 5.0}}}', True),
        ('/*/example: {ros__parameters: {rate: 5.0}}', True),
        ('/**/example: {ros__parameters: {rate: 5.0}}', False),
        ('/**: {ros__parameters: {rate: 5.0}}', False),
        ('# example: {ros__parameters: {rate: 5.0}}', True),
    ],
)
def test_each_file_without_effect_is_said(python, tmp_path, written, warned):
    """Any other parameter hid it: a limit in it was left out without a word."""
    file = tmp_path / 'example.yaml'
    file.write_text(written)
    options = ('-p', 'rate:=2.5', '--params-file', str(file))
    line, _, errors = stopped(python, '--ros-args', *options)
    assert line == ('running at 2.5' if warned else 'running at 5.0')
    assert ('expected parameters for /example in' in errors) == warned


def test_a_bad_parameter_is_one_line_and_exit_code_two(python, tmp_path):
    file = tmp_path / 'example.yaml'
    file.write_text('example:\n  ros__parameters:\n    rate: 20\n')
    code, _, err = ended(python, NODE, '--ros-args', '--params-file', str(file))
    message = 'error: parameter rate: expected double, got integer 20 (write 20.0)\n'
    assert (code, err) == (2, message)


@pytest.mark.parametrize('arguments', [['--params-file', '/missing.yaml'], ['--nonsense']])
def test_bad_ros_arguments_are_no_traceback_and_exit_code_two(python, arguments):
    code, _, err = ended(python, NODE, '--ros-args', *arguments)
    assert code == 2
    # rcl may log a line of its own before ours
    assert err.splitlines()[-1].startswith('error: ')
    assert 'Traceback' not in err


COMPILING = """
import os, signal, sys
from numba import njit
from numba.extending import overload
from rpms_ros.nodes.common.runner import run

def one():
    return 1

@overload(one)
def compiled_one():
    os.kill(os.getpid(), signal.SIGINT)
    return one

def build():
    # what is compiled prints itself: between two lines of Python the signal comes again
    njit(lambda: print(one()))()
    while True:
        pass

sys.exit(run(build))
"""


def test_a_signal_while_something_is_compiled_lets_it_be_compiled_first(python):
    assert ended(python, COMPILING) == (0, '1\n', '')


def test_a_second_signal_does_not_wait_until_something_is_compiled(python):
    twice = 'os.kill(os.getpid(), signal.SIGINT)\n    os.kill(os.getpid(), signal.SIGTERM)'
    code = COMPILING.replace('os.kill(os.getpid(), signal.SIGINT)', twice)
    assert ended(python, code) == (0, '', '')


SPINNING = """
import os, signal, sys, threading
from numba import njit
from numba.extending import overload
from rclpy.node import Node
from rpms_ros.nodes.common.runner import run

def one():
    return 1

@overload(one)
def compiled_one():
    os.kill(os.getpid(), signal.SIGINT)
    return one

class ExampleNode(Node):

    def __init__(self):
        super().__init__('example')
        self.create_timer(0.01, self.compile)

    def compile(self):
        njit(lambda: one())()
        # for longer than it takes until a signal that waits for numba comes again
        threading.Event().wait(0.5)
        print('finished', flush=True)

sys.exit(run(ExampleNode))
"""


def test_a_callback_that_compiles_is_finished_after_a_signal(python):
    assert ended(python, SPINNING) == (0, 'finished\n', '')


CLOSING = """
import os, signal, sys
from rclpy.node import Node
from rpms_ros.nodes.common.runner import run

class ExampleNode(Node):

    def __init__(self):
        super().__init__('example')
        self.create_timer(0.01, lambda: os.kill(os.getpid(), signal.SIGTERM))

    def destroy_node(self):
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
            os.kill(os.getpid(), number)
        super().destroy_node()
        print('closed', flush=True)

sys.exit(run(ExampleNode))
"""


def test_further_signals_do_not_interrupt_the_end(python):
    assert ended(python, CLOSING) == (0, 'closed\n', '')


def test_a_failure_while_a_node_is_built_is_not_hidden(python):
    failing = COMPILING.replace('signal.SIGINT', '0')
    failing = failing.replace('while True:', "raise RuntimeError('no node')")
    code, _, err = ended(python, failing.replace('        pass\n', ''))
    assert code == 1
    assert 'RuntimeError: no node' in err


def test_a_signal_while_modules_are_imported_is_no_traceback(monkeypatch):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(executables, 'import_module', interrupted)
    assert executables.identifier() == 0


def test_help_tells_the_parameters_and_starts_nothing(python):
    code, out, err = ended(python, NODE, '--help')
    assert (code, err) == (0, '')
    assert '  rate  Rate. ([Hz] 1.0 to 50.0; default 20.0)\n' in out
    assert 'running' not in out


def test_a_node_without_ros_says_so_in_a_line(python):
    name = 'stimulator_driver'
    code = (
        'import sys\nsys.modules["rclpy"] = None\n'
        f'from rpms_ros.nodes.executables import {name}\nsys.exit({name}())\n'
    )
    ending, out, err = ended(python, code)
    assert (ending, out, err.count('\n')) == (2, '', 1)
    assert err.endswith(f'{name} needs ROS 2 Jazzy and rpms_msgs\n')


def test_a_domain_in_which_somebody_is_is_not_chosen(graphs, domain, context, monkeypatch):
    from rpms_ros.nodes.common import runner

    monkeypatch.setattr(runner, '_DOMAINS', range(domain, domain + 1))
    # this test holds it
    with pytest.raises(NodeError, match='expected a free DDS domain'), runner.free_domain():
        pass
    nodes = [Node('here', context=context, use_global_arguments=False)]
    with graphs.private_context(domain) as second:
        nodes.append(Node('there', context=second, use_global_arguments=False))
        # whoever is first, or second where the first has gone
        for node in nodes:
            monkeypatch.setattr(runner, '_MARK', 6)
            with pytest.raises(NodeError, match='expected a free DDS'), runner.free_domain():
                pass
            node.destroy_node()
            node.context.try_shutdown()
    with runner.free_domain() as free:
        assert free == domain
