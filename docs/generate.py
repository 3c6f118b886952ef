# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The pages of the reference that are made of the code: commands, parameters, messages, ..."""

import argparse
import ast
import importlib.util
import json
import os
from collections.abc import Iterable, Iterator
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest import mock

ROOT = Path(__file__).resolve().parent.parent
# Lines of a help that fit a page.
_COLUMNS = '92'


def write(folder: Path) -> None:
    """Write every page into a folder, as Markdown; leave alone what has not changed."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in pages():
        path = folder / f'{name}.md'
        if not path.exists() or path.read_text(encoding='utf-8') != text:
            path.write_text(text, encoding='utf-8')


def pages() -> Iterator[tuple[str, str]]:
    """Yield the name and text of each page."""
    yield 'commands', _commands()
    yield 'parameters', _parameters()
    yield 'faults', _faults()
    yield 'messages', _messages()
    yield 'schema', _schema()
    yield 'rooms', _rooms()


def _commands() -> str:
    from rpms_ros.cli import parser

    with mock.patch.dict(os.environ, COLUMNS=_COLUMNS):
        return _helps_of(parser())


def _helps_of(top: argparse.ArgumentParser) -> str:
    (choices,) = (
        action.choices for action in top._actions if isinstance(action, argparse._SubParsersAction)
    )
    parts = ['# Commands', _fenced(top.format_help())]
    for name, command in choices.items():
        parts += [f'## rpms {name}', _fenced(command.format_help())]
    return '\n\n'.join(parts) + '\n'


def _parameters() -> str:
    tool = _tool('document')
    head = ('parameter', 'type', 'default', 'allowed', 'meaning')
    parts = [
        '# Parameters of the nodes',
        'Set with `-p NAME:=VALUE`, in a parameter file (`config/`), or from a launch file.',
    ]
    for name, settings in sorted(tool.NODES.items()):
        parts += [f'## {name}', _table(head, _parameter_rows(settings))]
    return '\n\n'.join(parts) + '\n'


def _parameter_rows(settings: Any) -> Iterator[tuple[str, ...]]:
    """Yield name, type, default, condition and meaning of each parameter."""
    from rpms_ros.nodes.common.parameters import descriptions, type_of

    for name, description in descriptions(settings).items():
        kind = type_of(settings, name).name.lower().replace('_', ' ')
        value = getattr(settings, name)
        shown = (', '.join(value) or '[]') if isinstance(value, tuple) else repr(value)
        yield (f'`{name}`', kind, f'`{shown}`', description.conditions(), description.doc)


def _faults() -> str:
    from rpms_ros.identification.quality.doubts import MEANING, REASON

    parts = [
        '# Faults and doubts',
        (
            'Counted in `fault_names` and `fault_counts` of every estimate. [What to do]'
            '(../../identification/trust.md#doubts).'
        ),
        _table(('fault', 'meaning'), ((f'`{name}`', said) for name, said in MEANING.items())),
        '## Doubts of an estimate',
        _table(('doubt', 'meaning'), ((f'`{name}`', said) for name, said in REASON.items())),
    ]
    return '\n\n'.join(parts) + '\n'


def _messages() -> str:
    parts = ['# Messages, services and actions', 'Package `rpms_msgs`, folder `msg_defs`.']
    for kind, title in (('msg', 'Messages'), ('srv', 'Services'), ('action', 'Actions')):
        parts.append(f'## {title}')
        for path in sorted((ROOT / 'msg_defs' / kind).glob(f'*.{kind}')):
            text = path.read_text(encoding='utf-8')
            parts += [f'### rpms_msgs/{kind}/{path.stem}', _fenced(text)]
    return '\n\n'.join(parts) + '\n'


def _schema() -> str:
    text = (ROOT / 'docs' / 'identify.schema.json').read_text(encoding='utf-8')
    schema = json.loads(text)
    intro = (
        f'{schema["description"]} A key that is not required is left out where the estimator does '
        'not offer it. Numbers that are not finite are null. The schema as a file: '
        '<a href="../../identify.schema.json">identify.schema.json</a>.'
    )
    parts = [
        '# JSON of `rpms identify`',
        intro,
        _table(('key', 'type', 'required', 'meaning'), _rows(schema, '')),
    ]
    return '\n\n'.join(parts) + '\n'


def _rows(schema: dict[str, Any], prefix: str) -> Iterator[tuple[str, str, str, str]]:
    required = schema.get('required', [])
    for name, one in schema.get('properties', {}).items():
        below = next((part for part in one.get('anyOf', [one]) if 'properties' in part), {})
        meaning = one.get('description') or below.get('description', '')
        need = 'yes' if name in required else 'no'
        yield (f'`{prefix}{name}`', _kind(one), need, meaning)
        yield from _rows(below, f'{prefix}{name}.')


def _kind(schema: dict[str, Any]) -> str:
    """Return the type of a value in words."""
    if 'anyOf' in schema:
        return ' or '.join(_kind(part) for part in schema['anyOf'])
    kind = schema.get('type', 'any')
    return ' or '.join(kind) if isinstance(kind, list) else str(kind)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [
        '| ' + ' | '.join(cell.replace('|', '\\|') for cell in row) + ' |' for row in (head, *rows)
    ]
    return '\n'.join([lines[0], '|---' * len(head) + '|', *lines[1:]])


def _rooms() -> str:
    """Every folder and module of the package with the first line of its docstring."""
    parts = ['# Rooms and modules']
    for folder in sorted(path.parent for path in (ROOT / 'rpms_ros').rglob('__init__.py')):
        parts += [f'## {folder.relative_to(ROOT).as_posix()}', _summary(folder / '__init__.py')]
        modules = (path for path in sorted(folder.glob('*.py')) if path.name[:2] != '__')
        rows = [(f'`{path.stem}`', _summary(path)) for path in modules]
        parts += [_table(('module', 'what it holds'), rows)] if rows else []
    return '\n\n'.join(parts) + '\n'


def _summary(path: Path) -> str:
    text = ast.get_docstring(ast.parse(path.read_text('utf-8'))) or ''
    return text.partition('\n\n')[0].replace('\n', ' ')


def _fenced(text: str) -> str:
    return f'```text\n{text.rstrip()}\n```'


def _tool(name: str) -> ModuleType:
    """Import a script of the folder tools, which has no ending."""
    loader = SourceFileLoader(name, str(ROOT / 'tools' / name))
    specification = importlib.util.spec_from_loader(name, loader)
    if specification is None:
        raise ImportError(f'expected a script tools/{name}, got none')
    module = importlib.util.module_from_spec(specification)
    loader.exec_module(module)
    return module
