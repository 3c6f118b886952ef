# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which nodes a file of parameters is for: rcl drops what is for others without a word.

A file for ``/**/identifier`` has nothing for an identifier that was renamed.
"""

import re
from collections.abc import Iterator
from collections.abc import Mapping
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml

from rpms_ros.nodes.plain_text import plain_text

_PARAMETERS = 'ros__parameters'
_PARTS = {'**': '(?:/[^/]+)*', '*': '/[^/]+'}


def files_of(arguments: Sequence[str]) -> list[Path]:
    """Return the files of parameters on a command line."""
    return [Path(value) for name, value in pairwise(arguments) if name == '--params-file']


def nodes_of(path: Path) -> list[str]:
    """Return the names of nodes, with wildcards, that a file has parameters for.

    Empty if it cannot be read, of which rcl says so itself, or is a pipe, which rcl has emptied.
    """
    if not path.is_file():
        return []
    try:
        # values stay text: PyYAML would refuse some that rcl takes, as a date with a 13th month
        content = yaml.load(path.read_text(encoding='utf-8'), Loader=yaml.BaseLoader)
    except (OSError, UnicodeDecodeError, yaml.YAMLError, RecursionError):
        return []
    return [name for name, _ in blocks_of(content)]


def is_for(pattern: str, node: str) -> bool:
    """Return whether a name with wildcards is that of a node, as rcl compares them.

    >>> [is_for(name, '/left/leg') for name in ('/**', 'left/leg', '/*/leg', '/**/arm', 'leg')]
    [True, True, True, False, False]
    """
    parts = [part for part in pattern.split('/') if part]
    expression = ''.join(_PARTS.get(part, '/' + re.escape(part)) for part in parts)
    return re.fullmatch(expression, node) is not None


def without_effect(arguments: Sequence[str], node: str) -> Iterator[str]:
    """Yield a line for each file on a command line that has nothing for a node."""
    for path in files_of(arguments):
        names = nodes_of(path)
        if names and not any(is_for(name, node) for name in names):
            yield plain_text(
                f'{path} has parameters for {", ".join(names)} and nothing for {node}'
            )


def blocks_of(content: object, prefix: str = '') -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield each node of the content of a file, with wildcards, and its parameters.

    >>> list(blocks_of({'leg': {'identifier': {'ros__parameters': {'seed': 1}}}}))
    [('/leg/identifier', {'seed': 1})]
    """
    for key, value in content.items() if isinstance(content, Mapping) else ():
        if key == _PARAMETERS:
            yield prefix, value if isinstance(value, Mapping) else {}
        else:
            yield from blocks_of(value, f'{prefix}/{str(key).strip("/")}')
