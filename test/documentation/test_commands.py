# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Every command and every program of README, CONTRIBUTING and docs runs as it is written.

A page is read from top to bottom, in one folder that looks like that of the repository.  In fences

- ``bash``: every line is a command; ``# exit status 1`` behind it says that it is to end so
- ``console``: lines that begin with ``$`` are commands, the others their output
- ``python``: a program
- ``text``, ``yaml``, ``toml``, ``ini``: neither

and in a comment above one

- ``<!-- not run: REASON -->``
- ``<!-- stopped after N s: REASON -->``: a node, which runs until N s after it is on the graph
  and ends well when it is interrupted
- ``<!-- file: NAME -->``: what it holds is a file that the commands of the page find
"""

import os
import re
import signal
import subprocess
import sys
import sysconfig
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import rpms_ros

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / 'docs'
PAGES = [
    path
    for path in (ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted(DOCS.rglob('*.md')))
    if 'generated' not in path.parts
]
KNOWN = {'bash', 'console', 'python', 'text', 'yaml', 'toml', 'ini', 'json'}
FENCE = re.compile(
    r'^(?P<indent> *)(?:<!-- (?P<comment>[^\n]*?) -->\n *)?'
    r'```(?P<kind>[^\n]*)\n(?P<body>.*?)^ *```$',
    re.MULTILINE | re.DOTALL,
)
MARK = re.compile(
    r'(?:not run|stopped after (?P<seconds>\d+) s): (?P<reason>.{10,})|file: (?P<file>\S+)'
)
# These end with the verdict on the data: good, doubtful, no.
GRADED = ('rpms identify', 'rpms report', 'rpms study')
VERDICTS = (0, 1, 3)
# what a reader has beside the repository
SHARED = ('bags', 'bench', 'config', 'docs', 'launch', 'msg_defs', 'rpms_ros', 'tools')
# a bound for what hangs: the first run on a machine compiles, and others may use it meanwhile
TIMEOUT = 900


@dataclass(frozen=True)
class Fence:
    """One fence of a page."""

    kind: str
    body: str
    comment: str

    @property
    def run(self):
        return self.kind in ('bash', 'console', 'python') and not self.comment.startswith(
            'not run'
        )

    @property
    def file(self):
        found = MARK.fullmatch(self.comment)
        return found['file'] if found else None

    @property
    def seconds(self):
        """After how long it is interrupted; 0 if it ends by itself."""
        found = MARK.fullmatch(self.comment)
        return int(found['seconds'] or 0) if found else 0

    def commands(self):
        """Return each command with the exit statuses that it may have."""
        lines = self.body.splitlines()
        if self.kind == 'console':
            lines = [line.removeprefix('$ ') for line in lines if line.startswith('$ ')]
        joined = '\n'.join(lines).replace('\\\n', ' ')
        commands = []
        for line in joined.splitlines():
            if line.strip() and not line.lstrip().startswith('#'):
                status = re.search(r'# exit status (\d)', line)
                usual = VERDICTS if line.startswith(GRADED) else (0,)
                commands.append((line, (int(status[1]),) if status else usual))
        return commands


def fences(path):
    for found in FENCE.finditer(path.read_text(encoding='utf-8')):
        body = re.sub(f'^{found["indent"]}', '', found['body'], flags=re.MULTILINE)
        yield Fence(found['kind'].strip(), body, found['comment'] or '')


def name_of(path):
    return str(path.relative_to(ROOT))


@pytest.fixture(scope='module')
def examples(tmp_path_factory):
    """What the pages call by a name of the reader: a session and a table."""
    folder = tmp_path_factory.mktemp('examples')
    session = rpms_ros.simulate(duration=8.0, noise=0.02)
    session.save(folder / 'session')
    time = (session.force.stamp_ns - session.force.stamp_ns[0]) / 1e9
    gate = np.zeros(len(time))
    onset = np.searchsorted(session.force.stamp_ns, session.pulses.onset_ns)
    for offset in (0, 1):
        gate[np.minimum(onset + offset, len(gate) - 1)] = 5.0
    rows = zip(time.tolist(), session.force.force.tolist(), gate.tolist(), strict=True)
    lines = ['Time [s],fGM [N],STIM [ ]', *(f'{t:.3f},{f:.6f},{g:g}' for t, f, g in rows)]
    (folder / 'trial.csv').write_text('\n'.join(lines) + '\n')
    return folder


@pytest.fixture
def scratch(tmp_path, examples):
    """A folder like that of the repository, in which a reader may write."""
    for name in SHARED:
        (tmp_path / name).symlink_to(ROOT / name)
    for path in examples.iterdir():
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / '.venv').mkdir()
    (tmp_path / '.venv' / 'bin').symlink_to(sysconfig.get_path('scripts'))
    return tmp_path


@pytest.fixture
def on_the_graph(context):
    """Tell whether a node of a name is on the graph of the test's domain."""
    from rclpy.node import Node

    looker = Node('looker', context=context, use_global_arguments=False)
    yield lambda name: name in looker.get_node_names()
    looker.destroy_node()


def environment(folder, domain):
    return {
        **os.environ,
        'PATH': f'{sysconfig.get_path("scripts")}:{os.environ["PATH"]}',
        'ROS_DOMAIN_ID': str(domain),
        'ROS_LOG_DIR': str(folder / 'ros_log'),
        'MPLBACKEND': 'agg',
        'COLUMNS': '100',
    }


def ends_well(command, folder, variables, statuses):
    how = {'capture_output': True, 'text': True, 'timeout': TIMEOUT, 'check': False}
    done = subprocess.run(command, cwd=folder, env=variables, **how)
    assert done.returncode in statuses, f'{command[-1]}\n{done.stdout}\n{done.stderr}'
    assert 'Traceback' not in done.stderr, f'{command[-1]}\n{done.stderr}'


def runs_until_stopped(command, seconds, folder, variables, there):
    """Start a node, interrupt it some seconds after it is on the graph; it must not end before."""
    name, end = Path(command.split()[0]).name, time.monotonic() + TIMEOUT
    # one of its name may be left from the command before
    while there(name) and time.monotonic() < end:
        time.sleep(0.05)
    process = subprocess.Popen(
        ['bash', '-c', f'exec {command}'],
        cwd=folder,
        env=variables,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        while not there(name) and process.poll() is None and time.monotonic() < end:
            time.sleep(0.05)
        output, _ = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=TIMEOUT)
        assert process.returncode == 0, f'{command}\n{output}'
    else:
        pytest.fail(f'expected that it runs until it is stopped: {command}\n{output}')
    finally:
        process.kill()


# a page is a dozen processes, each of which loads what the package stands on
@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize('path', [p for p in PAGES if any(f.run for f in fences(p))], ids=name_of)
def test_a_page_runs_as_it_is_written(path, scratch, domain, on_the_graph):
    variables = environment(scratch, domain)
    for fence in fences(path):
        if fence.file is not None:
            (scratch / fence.file).write_text(fence.body)
    for fence in fences(path):
        if not fence.run:
            continue
        if fence.kind == 'python':
            # -P: by the path through the scratch folder numba would compile everything once more
            program = [sys.executable, '-P', '-c', fence.body]
            ends_well(program, scratch, variables, (0,))
            continue
        for command, statuses in fence.commands():
            if fence.seconds:
                runs_until_stopped(command, fence.seconds, scratch, variables, on_the_graph)
            else:
                ends_well(['bash', '-c', command], scratch, variables, statuses)


@pytest.mark.parametrize('path', PAGES, ids=name_of)
def test_every_fence_says_what_it_holds(path):
    for fence in fences(path):
        directive = re.fullmatch(r'\{[\w-]+\}.*', fence.kind)
        assert fence.kind in KNOWN or directive, f'{fence.kind!r}: {fence.body[:60]}'
        assert not fence.comment or MARK.fullmatch(fence.comment), fence.comment
    text = path.read_text(encoding='utf-8')
    # commands that are indented, not fenced, would be run by nobody
    assert not re.findall(r'^    (?:rpms|make|ros2|pip|python|colcon) .*$', text, re.MULTILINE)
