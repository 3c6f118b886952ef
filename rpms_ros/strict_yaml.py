# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""YAML from outside, read strictly: what doses people must not depend on how a parser guesses.

The YAML 1.2 core schema without its surprises: no octal or hexadecimal number, no leading zero, no
``yes`` or ``on``, no base 60, no date, no tag, no anchor, no alias, no key twice, one document.
Size, depth, keys and texts are bounded before anything is built.  A fault names its line.
"""

import re
from dataclasses import dataclass, field
from typing import Any, NoReturn

import yaml

from rpms_ros.errors import RpmsError

LARGEST_DOCUMENT = 200_000
"""Characters."""
MOST_NODES = 10_000
DEEPEST_NESTING = 40
LONGEST_TEXT = 2000
LONGEST_KEY = 100
LONGEST_NUMBER = 40
_SHOWN = 120

_NULL = frozenset({'', '~', 'null', 'Null', 'NULL'})
_BOOLEAN = {
    'true': True, 'True': True, 'TRUE': True, 'false': False, 'False': False, 'FALSE': False,
}  # fmt: skip
_SPECIAL = re.compile(r'[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)')
_INTEGER = re.compile(r'[-+]?(0|[1-9][0-9]*)')
_FLOAT = re.compile(r'[-+]?(\.[0-9]+|(0|[1-9][0-9]*)(\.[0-9]*)?)([eE][-+]?[0-9]+)?')
# What YAML 1.1, another language or a person takes for a number, and this schema does not.
_DOUBTFUL = re.compile(r'[-+]?[0-9][0-9_:,]*([.][0-9_]*)?([eE][-+]?[0-9]+)?|[-+]?0[xXoObB]\w*')

_PARSER_FAULTS = (
    yaml.YAMLError, ArithmeticError, AssertionError, AttributeError, LookupError, RecursionError,
    TypeError, ValueError,
)  # fmt: skip


class YamlError(RpmsError):
    """A text is not a document that is accepted.

    Attributes
    ----------
    line : int
        Where, from 1.
    place : str
        Path of the fault in the document, e.g. ``limits.maximum_rate_hz``; may be empty.
    fault : str
        What was expected and what came.
    """

    def __init__(self, line: int, place: str, fault: str) -> None:
        super().__init__(f'line {line}, {place}: {fault}' if place else f'line {line}: {fault}')
        self.line = line
        self.place = place
        self.fault = fault


@dataclass
class Node:
    """A value of a document and where it stands.

    Attributes
    ----------
    content : object
        None, bool, int, float, str, list or dict with text keys.
    line : int
        Of its beginning, from 1.
    children : dict of str to Node
        By key, or by index.
    """

    content: Any
    line: int
    children: dict[str, 'Node'] = field(default_factory=dict)

    def line_of(self, place: str) -> int:
        """Return the line of a place such as ``a[2].b``, or of what is nearest around it."""
        node = self
        for step in re.findall(r'[^.\[\]]+', place):
            child = node.children.get(step)
            if child is None:
                break
            node = child
        return node.line


def read_yaml(text: str) -> Node:
    """Return the content of a YAML document, with lines.

    Raises
    ------
    YamlError
        If it is not one that is accepted; whatever the text, nothing else is raised.
    """
    if len(text) > LARGEST_DOCUMENT:
        fault = f'expected at most {LARGEST_DOCUMENT} characters of YAML, got {len(text)}'
        raise YamlError(1, '', fault)
    builder = _Builder()
    try:
        for event in yaml.parse(text, yaml.SafeLoader):
            builder.take(event)
    except yaml.MarkedYAMLError as fault:
        mark = fault.problem_mark or fault.context_mark
        line = mark.line + 1 if mark is not None else builder.line
        what = ' '.join(part for part in (fault.context, fault.problem) if part)
        raise YamlError(line, '', f'expected a YAML document, got {clipped(what)}') from fault
    except yaml.reader.ReaderError as fault:
        line = text.count('\n', 0, fault.position) + 1
        what = f'character {fault.character:#x}'
        raise YamlError(line, '', f'expected printable text, got {what}') from fault
    except _PARSER_FAULTS as fault:
        # a character that does not exist, written as an escape, and whatever else the parser
        # stumbles over
        what = clipped(' '.join(str(fault).split()))
        raise YamlError(builder.line, '', f'expected a YAML document, got {what}') from fault
    if builder.root is None:
        raise YamlError(1, '', 'expected a YAML document, got an empty one')
    return builder.root


def join(place: str, key: str) -> str:
    """Return the place of ``key`` below ``place``."""
    return f'{place}.{clipped(key)}' if place else clipped(key)


def shown(value: object) -> str:
    """Return a value as an error message may show it: printable and short, texts in quotes."""
    try:
        return clipped(repr(value))
    except ValueError:
        return 'a number of thousands of digits'


def clipped(text: str) -> str:
    """Return a text as an error message may show it: printable and short."""
    short = text if len(text) <= _SHOWN else f'{text[:_SHOWN]}...'
    return short if short.isprintable() else ascii(short)[1:-1]


class _Builder:
    """Builds nodes from events, in one pass and without recursion."""

    def __init__(self) -> None:
        self.root: Node | None = None
        self.line = 1
        self._open: list[Node] = []
        self._keys: list[str | None] = []
        # of each open list or mapping, within the one around it
        self._places: list[str] = []
        self._nodes = 0

    def take(self, event: yaml.Event) -> None:
        """Take one event in."""
        self.line = event.start_mark.line + 1 if event.start_mark is not None else self.line
        match event:
            case yaml.AliasEvent():
                self._refuse('expected a YAML document without aliases, got one with *')
            case yaml.DocumentStartEvent():
                self._start(event)
            case yaml.CollectionEndEvent():
                self._open.pop()
                self._keys.pop()
                self._places.pop()
            case yaml.NodeEvent():
                self._node(event)

    def _start(self, event: yaml.DocumentStartEvent) -> None:
        if self.root is not None:
            self._refuse('expected one YAML document, got another one')
        if event.version or event.tags:
            self._refuse('expected a YAML document without directives, got one with %')

    def _node(self, event: Any) -> None:
        self._nodes += 1
        if self._nodes > MOST_NODES:
            self._refuse(f'expected at most {MOST_NODES} values and keys in YAML, got more')
        if event.anchor is not None:
            self._refuse(f'expected no anchor, got &{clipped(event.anchor)}')
        if event.tag is not None:
            self._refuse(f'expected no tag, got {clipped(event.tag)}')
        if isinstance(event, yaml.ScalarEvent):
            self._scalar(event)
            return
        content: Any = {} if isinstance(event, yaml.MappingStartEvent) else []
        if self._awaits_key():
            self._refuse('expected a text as key, got a list or a mapping')
        place = self._place()
        self._open.append(self._add(content))
        self._keys.append(None)
        self._places.append(place)
        if len(self._open) > DEEPEST_NESTING:
            self._refuse(f'expected at most {DEEPEST_NESTING} levels of nesting in YAML, got more')

    def _scalar(self, event: yaml.ScalarEvent) -> None:
        plain = event.implicit[0]
        if self._awaits_key():
            self._key(event.value)
        else:
            self._add(self._resolved(event.value) if plain else self._text(event.value))

    def _awaits_key(self) -> bool:
        return bool(
            self._open and isinstance(self._open[-1].content, dict) and self._keys[-1] is None
        )

    def _key(self, key: str) -> None:
        if not key.isprintable() or not 0 < len(key) <= LONGEST_KEY:
            self._refuse(
                f'expected a key of 1 to {LONGEST_KEY} printable characters, got {shown(key)}'
            )
        parent = self._open[-1]
        if key in parent.content:
            first = parent.children[key].line
            self._refuse(f'expected the key once, got it again after line {first}', key)
        self._keys[-1] = key

    def _add(self, content: Any) -> Node:
        node = Node(content, self.line)
        if not self._open:
            self.root = node
            return node
        parent = self._open[-1]
        if isinstance(parent.content, dict):
            key = self._keys[-1] or ''
            self._keys[-1] = None
            parent.content[key] = content
        else:
            key = str(len(parent.content))
            parent.content.append(content)
        parent.children[key] = node
        return node

    def _text(self, value: str) -> str:
        if len(value) > LONGEST_TEXT:
            self._refuse(f'expected at most {LONGEST_TEXT} characters of text, got {len(value)}')
        if not value.replace('\n', '').replace('\t', '').isprintable():
            self._refuse(f'expected printable text, got {shown(value)}')
        return value

    def _resolved(self, value: str) -> Any:
        """Return what a plain scalar stands for in the core schema."""
        if value in _NULL:
            return None
        if value in _BOOLEAN:
            return _BOOLEAN[value]
        if _SPECIAL.fullmatch(value):
            return float(value.replace('.', ''))
        if len(value) <= LONGEST_NUMBER:
            if _INTEGER.fullmatch(value):
                return int(value)
            if _FLOAT.fullmatch(value):
                return float(value)
        if _DOUBTFUL.fullmatch(value):
            self._refuse(
                'expected a number written in at most 40 decimal digits without leading zeros, '
                f'colons or underscores, or a text in quotes, got {shown(value)}'
            )
        return self._text(value)

    def _refuse(self, fault: str, key: str = '') -> NoReturn:
        place = self._place()
        raise YamlError(self.line, join(place, key) if key else place, fault)

    def _place(self) -> str:
        """Return the place of the value that comes next."""
        if not self._open:
            return ''
        node, key, place = self._open[-1], self._keys[-1], self._places[-1]
        if isinstance(node.content, list):
            return f'{place}[{len(node.content)}]'
        return place if key is None else join(place, key)
