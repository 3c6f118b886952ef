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

from rpms_ros.errors import MISREAD, RpmsError

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

_PARSER_FAULTS = (yaml.YAMLError, AssertionError, *MISREAD)


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
            if step not in node.children:
                break
            node = node.children[step]
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
    reader = _Reader(text)
    try:
        root = reader.document()
    except yaml.MarkedYAMLError as fault:
        mark = fault.problem_mark or fault.context_mark
        line = mark.line + 1 if mark is not None else reader.line
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
        raise YamlError(reader.line, '', f'expected a YAML document, got {what}') from fault
    if root is None:
        raise YamlError(1, '', 'expected a YAML document, got an empty one')
    return root


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


class _Reader:
    """Builds nodes from events; each calls itself for what is within it, to a bounded depth."""

    def __init__(self, text: str) -> None:
        self.line = 1
        self._events = yaml.parse(text, yaml.SafeLoader)
        self._nodes = 0

    def document(self) -> Node | None:
        """Return the content of the one document, None if there is none."""
        root = None
        while not isinstance(event := self._next(), yaml.StreamEndEvent):
            if isinstance(event, yaml.DocumentStartEvent):
                if root is not None:
                    self._refuse('expected one YAML document, got another one')
                if event.version or event.tags:
                    self._refuse('expected a YAML document without directives, got one with %')
            elif isinstance(event, yaml.NodeEvent):
                root = self._node(event, '', 0)
        return root

    def _next(self) -> Any:
        event = next(self._events)
        self.line = event.start_mark.line + 1 if event.start_mark is not None else self.line
        return event

    def _node(self, event: Any, place: str, depth: int) -> Node:
        """Return what begins with an event at a place, within so many lists and mappings."""
        self._check(event, place)
        if isinstance(event, yaml.ScalarEvent):
            read = self._resolved if event.implicit[0] else self._text
            return Node(read(event.value, place), self.line)
        if depth == DEEPEST_NESTING:
            fault = f'expected at most {DEEPEST_NESTING} levels of nesting in YAML, got more'
            self._refuse(fault, place)
        mapping = isinstance(event, yaml.MappingStartEvent)
        node = Node(None, self.line)
        while not isinstance(event := self._next(), yaml.CollectionEndEvent):
            key, below = str(len(node.children)), f'{place}[{len(node.children)}]'
            if mapping:
                key = self._key(event, node, place)
                event, below = self._next(), join(place, key)
            node.children[key] = self._node(event, below, depth + 1)
        found = {key: child.content for key, child in node.children.items()}
        node.content = found if mapping else list(found.values())
        return node

    def _check(self, event: Any, place: str) -> None:
        """Refuse what refers to something else, and too much of anything."""
        if isinstance(event, yaml.AliasEvent):
            self._refuse('expected a YAML document without aliases, got one with *', place)
        self._nodes += 1
        if self._nodes > MOST_NODES:
            self._refuse(f'expected at most {MOST_NODES} values and keys in YAML, got more', place)
        if event.anchor is not None:
            self._refuse(f'expected no anchor, got &{clipped(event.anchor)}', place)
        if event.tag is not None:
            self._refuse(f'expected no tag, got {clipped(event.tag)}', place)

    def _key(self, event: Any, parent: Node, place: str) -> str:
        self._check(event, place)
        if not isinstance(event, yaml.ScalarEvent):
            self._refuse('expected a text as key, got a list or a mapping', place)
        key: str = event.value
        if not key.isprintable() or not 0 < len(key) <= LONGEST_KEY:
            fault = f'expected a key of 1 to {LONGEST_KEY} printable characters, got {shown(key)}'
            self._refuse(fault, place)
        if key in parent.children:
            fault = f'expected the key once, got it again after line {parent.children[key].line}'
            self._refuse(fault, join(place, key))
        return key

    def _text(self, value: str, place: str) -> str:
        if len(value) > LONGEST_TEXT:
            fault = f'expected at most {LONGEST_TEXT} characters of text, got {len(value)}'
            self._refuse(fault, place)
        if not value.replace('\n', '').replace('\t', '').isprintable():
            self._refuse(f'expected printable text, got {shown(value)}', place)
        return value

    def _resolved(self, value: str, place: str) -> Any:
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
                f'colons or underscores, or a text in quotes, got {shown(value)}',
                place,
            )
        return self._text(value, place)

    def _refuse(self, fault: str, place: str = '') -> NoReturn:
        raise YamlError(self.line, place, fault)
