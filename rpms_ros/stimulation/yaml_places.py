# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Descriptions in YAML: every fault is a StimulationError with file, line and place."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation.fields import DescriptionError
from rpms_ros.strict_yaml import LARGEST_DOCUMENT
from rpms_ros.strict_yaml import YamlError
from rpms_ros.strict_yaml import read_yaml

Built = TypeVar('Built')


def from_text(text: str, build: Callable[[object], Built]) -> Built:
    """Return what ``build`` makes of the content of a YAML document.

    Raises
    ------
    DescriptionError
        If the text is not YAML as it is accepted here, or ``build`` finds a fault; names the line.
    StimulationError
        If ``build`` finds a fault that has no place.
    """
    try:
        node = read_yaml(text)
    except YamlError as fault:
        place = f'line {fault.line}, {fault.place}' if fault.place else f'line {fault.line}'
        raise DescriptionError(place, fault.fault) from fault
    try:
        return build(node.content)
    except DescriptionError as fault:
        line = node.line_of(fault.place)
        place = f'line {line}, {fault.place}' if fault.place else f'line {line}'
        raise DescriptionError(place, fault.fault) from fault


def from_file(path: Path, what: str, build: Callable[[object], Built]) -> Built:
    """Return what ``build`` makes of a YAML file, as `from_text` does.

    Parameters
    ----------
    path : Path
        A regular file in UTF-8.
    what : str
        What it should be, for messages.
    build : callable
        Makes something of the content.

    Raises
    ------
    StimulationError
        If it cannot be read or holds a fault; names the file.
    """
    try:
        if not path.is_file():
            raise FileNotFoundError('no regular file' if path.exists() else 'no such file')
        with path.open('rb') as file:
            # a character has at most four bytes; more is refused unread
            text = file.read(4 * LARGEST_DOCUMENT + 1).decode('utf-8')
    except UnicodeDecodeError as fault:
        raise StimulationError(
            f'expected a readable {what}, got {path}: no text in UTF-8 at byte {fault.start}'
        ) from fault
    except (OSError, ValueError) as fault:
        raise StimulationError(f'expected a readable {what}, got {path}: {fault}') from fault
    try:
        return from_text(text, build)
    except StimulationError as fault:
        raise StimulationError(f'{path}: {fault}') from fault
