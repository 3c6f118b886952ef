# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What pages refer to is there, what is generated holds everything, examples run."""

import ast
import doctest
import importlib
import importlib.util
import inspect
import json
import os
import re
import sys
from dataclasses import fields
from pathlib import Path

import pytest

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
LINK = re.compile(
    r'(?P<image>!?)\[[^\]\n]*\]\((?!https?:|mailto:)(?P<path>[^)#\s]*)(?:#[^)\s]*)?\)'
)


def links(path):
    text = re.sub(r'^```.*?^```', '', path.read_text(encoding='utf-8'), flags=re.M | re.S)
    for found in LINK.finditer(text):
        if found['path']:
            yield bool(found['image']), found['path']


def module(name):
    """Import a script of the folder docs."""
    specification = importlib.util.spec_from_file_location(f'docs_{name}', DOCS / f'{name}.py')
    found = importlib.util.module_from_spec(specification)
    sys.modules[f'docs_{name}'] = found
    specification.loader.exec_module(found)
    return found


def drawn():
    """Return the names of the figures that docs/figures.py draws, without drawing them."""
    for node in ast.parse((DOCS / 'figures.py').read_text()).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == 'FIGURES':
            return {f'{key.value}.png' for key in node.value.keys}
    return set()


@pytest.mark.parametrize('path', PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(path):
    for image, target in links(path):
        place = path.parent / target
        made = image and place.resolve().parent == DOCS / 'figures' and place.name in drawn()
        made = made or 'generated/' in target
        assert made or place.exists(), target


def test_the_list_of_decisions_names_every_page_once():
    folder = DOCS / 'decisions'
    listed = [target for _, target in links(folder / 'README.md')]
    assert sorted(listed) == sorted({path.name for path in folder.glob('*.md')} - {'README.md'})


def test_the_reference_holds_every_command_parameter_and_message():
    environment = dict(os.environ)
    pages = dict(module('generate').pages())
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


def test_the_modules_of_the_two_ways_are_there():
    (text,) = re.findall(r'^## Two ways.*?(?=^## )', PAGE, re.MULTILINE | re.DOTALL)
    names = re.findall(r'`(\w+(?:/\w+)+)`', text)
    assert len(names) > 30
    assert [name for name in names if not (ROOT / 'rpms_ros' / f'{name}.py').exists()] == []


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
