"""YAML documents that come from outside: bounded in size, and with the line of every place."""

import re
from typing import Any

import yaml

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.fields import DescriptionError

LARGEST_DOCUMENT = 200_000
DEEPEST_NESTING = 40


def load_document(text: str) -> tuple[yaml.Node, Any]:
    """Return the node tree of a YAML document and its content.

    Raises
    ------
    StimulationError
        If it is not YAML, is empty, too large, or uses aliases (a short document of nested
        aliases can stand for more content than fits into memory).
    """
    if len(text) > LARGEST_DOCUMENT:
        raise StimulationError(
            f'expected at most {LARGEST_DOCUMENT} characters of YAML, got {len(text)}'
        )
    try:
        _refuse_traps(text)
        node = yaml.compose(text, yaml.SafeLoader)
        content = yaml.safe_load(text)
    except yaml.YAMLError as fault:
        first = ' '.join(str(fault).split())
        raise StimulationError(f'expected a YAML document, got {first}') from fault
    if node is None:
        raise StimulationError('expected a YAML document, got an empty one')
    return node, content


def _refuse_traps(text: str) -> None:
    """Refuse what makes a parser slow or fills the memory, before anything is built."""
    depth = 0
    for event in yaml.parse(text, yaml.SafeLoader):
        if isinstance(event, yaml.AliasEvent):
            raise StimulationError('expected a YAML document without aliases, got one with *')
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST_NESTING:
            raise StimulationError(f'expected at most {DEEPEST_NESTING} levels of nesting in YAML')


def with_line(fault: DescriptionError, node: yaml.Node) -> DescriptionError:
    """Return the same fault with the line of its place in front."""
    line = _line_of(fault.place, node)
    place = f'line {line}, {fault.place}' if fault.place else f'line {line}'
    return DescriptionError(place, fault.fault)


def _line_of(place: str, node: yaml.Node) -> int:
    """Return the line (from 1) of a place, or of the nearest thing around it that exists."""
    for step in re.findall(r'[^.\[\]]+', place):
        found = _child(node, step)
        if found is None:
            break
        node = found
    return int(node.start_mark.line) + 1


def _child(node: yaml.Node, step: str) -> yaml.Node | None:
    if isinstance(node, yaml.MappingNode):
        return next((value for key, value in node.value if key.value == step), None)
    if isinstance(node, yaml.SequenceNode) and step.isdigit() and int(step) < len(node.value):
        child: yaml.Node = node.value[int(step)]
        return child
    return None
