# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the pages of the site refer to is there; what is generated holds everything."""

import ast
import importlib.util
import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from rpms_ros.cli import COMMANDS
from rpms_ros.identification.quality.doubts import MEANING, REASON

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


def links(path) -> Iterator[tuple[bool, str]]:
    text = re.sub(r'^```.*?^```', '', path.read_text(encoding='utf-8'), flags=re.M | re.S)
    for found in LINK.finditer(text):
        if found['path']:
            yield bool(found['image']), found['path']


def module(name) -> ModuleType:
    """Import a script of the folder docs."""
    specification = importlib.util.spec_from_file_location(f'docs_{name}', DOCS / f'{name}.py')
    assert specification is not None
    assert specification.loader is not None
    found = importlib.util.module_from_spec(specification)
    sys.modules[f'docs_{name}'] = found
    specification.loader.exec_module(found)
    return found


def drawn() -> set[str]:
    """Return the names of the figures that docs/figures.py draws, without drawing them."""
    for node in ast.parse((DOCS / 'figures.py').read_text()).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == 'FIGURES':
            return {f'{key.value}.png' for key in node.value.keys}  # type: ignore[attr-defined]
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
