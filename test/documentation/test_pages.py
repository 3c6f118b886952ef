# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""README, CONTRIBUTING and docs: what they refer to is there, every command and program runs.

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

import doctest
import importlib
import inspect
import json
import os
import re
import signal
import subprocess
import sys
import sysconfig
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import pytest

import rpms_ros
from rpms_ros.cli import COMMANDS
from rpms_ros.identification import catalogue
from rpms_ros.identification.quality.doubts import MEANING, REASON
from rpms_ros.identification.stream import sensor_checks
from rpms_ros.stimulation.devices import registry

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
GRADED = ('rpms identify', 'rpms report')
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

    def says(self, name):
        """What the comment says: `seconds` after which it is interrupted, or a `file`."""
        found = MARK.fullmatch(self.comment)
        return found[name] if found else None

    def commands(self):
        """Yield each command with the exit statuses that it may have."""
        text = self.body
        if self.kind == 'console':
            text = '\n'.join(re.findall(r'^\$ (.*)', text, re.MULTILINE))
        for line in text.replace('\\\n', ' ').splitlines():
            if line.strip() and not line.lstrip().startswith('#'):
                status = re.search(r'# exit status (\d)', line)
                usual = VERDICTS if line.startswith(GRADED) else (0,)
                yield line, (int(status[1]),) if status else usual


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
    onset = np.searchsorted(session.force.stamp_ns, session.pulses.onset_ns)
    gate = 5.0 * np.isin(np.arange(len(time)), [onset, onset + 1])
    columns = np.column_stack([time, session.force.force, gate])
    head = 'Time [s],fGM [N],STIM [ ]'
    np.savetxt(folder / 'trial.csv', columns, '%.6f', ',', header=head, comments='')
    return folder


@pytest.fixture
def scratch(tmp_path, examples, domain, monkeypatch):
    """Be in a folder like that of the repository, in which a reader may write."""
    for name in SHARED:
        (tmp_path / name).symlink_to(ROOT / name)
    for path in examples.iterdir():
        (tmp_path / path.name).symlink_to(path)
    scripts = sysconfig.get_path('scripts')
    (tmp_path / '.venv').mkdir()
    (tmp_path / '.venv' / 'bin').symlink_to(scripts)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('PATH', scripts, prepend=os.pathsep)
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'ros_log'))
    monkeypatch.setenv('MPLBACKEND', 'agg')
    monkeypatch.setenv('COLUMNS', '100')


@pytest.fixture
def on_the_graph(context):
    """Tell whether a node of a name is on the graph of the test's domain."""
    from rclpy.node import Node

    looker = Node('looker', context=context, use_global_arguments=False)
    yield lambda name: name in looker.get_node_names()
    looker.destroy_node()


def ends_well(command, statuses):
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT, check=False)
    assert done.returncode in statuses, f'{command[-1]}\n{done.stdout}\n{done.stderr}'
    assert 'Traceback' not in done.stderr, f'{command[-1]}\n{done.stderr}'


def runs_until_stopped(command, seconds, there, wait_for):
    """Start a node, interrupt it some seconds after it is on the graph; it must not end before."""
    name = Path(command.split()[0]).name
    # one of its name may be left from the command before
    wait_for(lambda: not there(name), TIMEOUT)
    process = subprocess.Popen(
        ['bash', '-c', f'exec {command}'],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        wait_for(lambda: there(name) or process.poll() is not None, TIMEOUT)
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
@pytest.mark.usefixtures('scratch')
def test_a_page_runs_as_it_is_written(path, on_the_graph, wait_for):
    for fence in fences(path):
        if name := fence.says('file'):
            Path(name).write_text(fence.body)
    for fence in fences(path):
        if not fence.run:
            continue
        if fence.kind == 'python':
            # -P: by the path through the scratch folder numba would compile everything once more
            program = [sys.executable, '-P', '-c', fence.body]
            ends_well(program, (0,))
            continue
        for command, statuses in fence.commands():
            if seconds := fence.says('seconds'):
                runs_until_stopped(command, int(seconds), on_the_graph, wait_for)
            else:
                ends_well(['bash', '-c', command], statuses)


@pytest.mark.parametrize('path', PAGES, ids=name_of)
def test_every_fence_says_what_it_holds(path):
    for fence in fences(path):
        directive = re.fullmatch(r'\{[\w-]+\}.*', fence.kind)
        assert fence.kind in KNOWN or directive, f'{fence.kind!r}: {fence.body[:60]}'
        assert not fence.comment or MARK.fullmatch(fence.comment), fence.comment
    text = path.read_text(encoding='utf-8')
    # commands that are indented, not fenced, would be run by nobody
    assert not re.findall(r'^    (?:rpms|make|ros2|pip|python|colcon) .*$', text, re.MULTILINE)


# names of figures, each that of the function that draws it
DRAWN = re.findall(r"'(\w+)': \1\b", (DOCS / 'figures.py').read_text())
LINK = re.compile(
    r'(?P<image>!?)\[[^\]\n]*\]\((?!https?:|mailto:)(?P<path>[^)#\s]*)(?:#[^)\s]*)?\)'
)


def links(path):
    text = re.sub(r'^```.*?^```', '', path.read_text(encoding='utf-8'), flags=re.M | re.S)
    for found in LINK.finditer(text):
        if found['path']:
            yield bool(found['image']), found['path']


@pytest.mark.parametrize('path', PAGES, ids=name_of)
def test_links_lead_somewhere(path):
    for image, target in links(path):
        place = path.parent / target
        made = image and place.resolve().parent == DOCS / 'figures' and place.stem in DRAWN
        made = made or 'generated/' in target
        assert made or place.exists(), target


def test_the_list_of_decisions_names_every_page_once():
    folder = DOCS / 'decisions'
    listed = [target for _, target in links(folder / 'README.md')]
    assert sorted(listed) == sorted({path.name for path in folder.glob('*.md')} - {'README.md'})


def test_the_reference_holds_every_command_parameter_and_message(module_at):
    environment = dict(os.environ)
    pages = dict(module_at(DOCS / 'generate.py').pages())
    # a width left behind would fold the tables of other tests
    assert dict(os.environ) == environment
    for name in COMMANDS:
        assert f'\n## rpms {name}\n' in pages['commands']
    for node in ('identifier', 'plant_simulator', 'recorder', 'stimulator_driver'):
        assert f'\n## {node}\n\n| parameter ' in pages['parameters']
    for name in (*MEANING, *REASON):
        assert f'| `{name}` | ' in pages['faults']
    for path in (ROOT / 'msg_defs').glob('*/*.*'):
        if path.suffix in ('.msg', '.srv', '.action'):
            assert f'### rpms_msgs/{path.parent.name}/{path.stem}\n' in pages['messages']
    for path in (ROOT / 'rpms_ros').rglob('[a-z]*.py'):
        assert f'| `{path.stem}` | ' in pages['rooms']
    schema = json.loads((DOCS / 'identify.schema.json').read_text())
    for key in schema['properties']:
        assert f'| `{key}` |' in pages['schema']


PAGE = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
WALKS = dict(re.findall(r'## (A new [^\n]+)\n(.*?)(?=\n## |\Z)', PAGE, re.DOTALL))
PLACE = re.compile(r'`((?:test|docs|rpms_ros|msg_defs|identification|tools)/[\w/.*]*\w)`')


@pytest.mark.parametrize('title', WALKS)
def test_every_file_and_dotted_name_is_there(title):
    for place in PLACE.findall(WALKS[title]):
        folder = ROOT / 'rpms_ros' if place.startswith('identification/') else ROOT
        assert list(folder.glob(place)), place
    groups = {catalogue.GROUP, sensor_checks.GROUP, registry.GROUP}
    for name in {*re.findall(r'`(rpms_ros(?:\.\w+)+)`', WALKS[title])} - groups:
        module, _, member = name.rpartition('.')
        assert hasattr(importlib.import_module(module), member), name


def test_groups_and_options_are_named():
    estimator, monitor = WALKS['A new estimator'], WALKS['A new monitor']
    assert f'"{catalogue.GROUP}"' in estimator
    assert f'`{sensor_checks.GROUP}`' in monitor
    for field in fields(catalogue.EstimatorOptions):
        assert f'`{field.name}`' in estimator, field.name


MODULES = [
    '.'.join(path.relative_to(ROOT).with_suffix('').parts).removesuffix('.__init__')
    for path in sorted((ROOT / 'rpms_ros').rglob('*.py'))
    if '>>> ' in path.read_text(encoding='utf-8')
]


@pytest.mark.parametrize('module', MODULES)
def test_examples(module, monkeypatch):
    # examples name files as somebody in the repository does
    monkeypatch.chdir(ROOT)
    failed, attempted = doctest.testmod(importlib.import_module(module))
    assert attempted > 0
    assert failed == 0


ROW = re.compile(r'^\| [^|]+ \| `(?P<name>[\w.]+)(?:\((?P<argument>\w+)\))?` \| [^|]+ \| ', re.M)
GLOSSARY = (ROOT / 'docs/glossary.md').read_text(encoding='utf-8')
TEST = re.compile(r'`(test/[\w/]+\.py)::(\w+)`')
MODEL = (ROOT / 'docs/model.md').read_text(encoding='utf-8')


def resolve(name):
    """Return what a dotted name below the package stands for; a field for one of a class."""
    module, *attributes = name.split('.')
    found: object = importlib.import_module(f'rpms_ros.{module}')
    for attribute in attributes:
        fields = getattr(found, '__dataclass_fields__', {})
        found = fields[attribute] if attribute in fields else getattr(found, attribute)
    return found


@pytest.mark.parametrize(('name', 'argument'), ROW.findall(GLOSSARY))
def test_names_of_the_glossary_exist(name, argument):
    found = resolve(name)
    assert not argument or argument in inspect.signature(found).parameters


def test_every_number_of_the_model_has_a_test():
    references = TEST.findall(MODEL)
    assert len(references) > 25
    for path, function in references:
        assert f'def {function}(' in (ROOT / path).read_text(encoding='utf-8'), function
