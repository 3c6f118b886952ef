# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""LabChart's export as text: lines of ``Name=`` before each block, then time and channels."""

from pathlib import Path

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing.signals import Signal
from rpms_ros.recording.importing.signals import SignalFile
from rpms_ros.recording.importing.signals import unlike
from rpms_ros.recording.importing.text import decoded
from rpms_ros.recording.importing.text import number

_KEYS = ('Interval=', 'ChannelTitle=', 'ExcelDateTime=', 'TimeFormat=', 'DateFormat=')


def is_labchart(text: str) -> bool:
    """Return whether a text begins as LabChart's exports do."""
    head = text[:2000].splitlines()[:12]
    return sum(line.startswith(_KEYS) for line in head) >= 2


def read_labchart(path: Path, block: int | None = None) -> SignalFile:
    """Return the channels of one block.

    Parameters
    ----------
    path : Path
        The file.
    block : int, optional
        Which one, from 1; needed if there are several.

    Raises
    ------
    RecordingError
        If there are several blocks and none is chosen, or a row holds no numbers.
    """
    text, encoding = decoded(path)
    blocks = _blocks(text.splitlines())
    if block is None and len(blocks) > 1:
        raise RecordingError(
            f'expected one block in {path}, got {len(blocks)}: --block 1 to {len(blocks)} decides'
        )
    chosen = 1 if block is None else block
    if not 1 <= chosen <= len(blocks):
        raise RecordingError(f'expected a block from 1 to {len(blocks)} of {path}, got {chosen}')
    head, rows = blocks[chosen - 1]
    comma = any(',' in cell for row in rows[:50] for cell in row)
    width = min((len(row) for row in rows), default=0)
    if width < 2:
        raise RecordingError(f'expected time and channels in {path}, got no such rows')
    titles = head.get('ChannelTitle', [])
    units = head.get('UnitName', [])
    names = unlike([*titles, *[''] * width][: width - 1])
    table = np.array([[_value(path, cell, comma) for cell in row[:width]] for row in rows])
    time = table[:, 0]
    signals = tuple(
        Signal(name, np.ascontiguousarray(table[:, index + 1]), _at(units, index), time)
        for index, name in enumerate(names)
    )
    return SignalFile(path, 'LabChart text', signals, facts=(encoding, f'block {chosen}'))


def _blocks(lines: list[str]) -> list[tuple[dict[str, list[str]], list[list[str]]]]:
    """Return header and rows of each block."""
    blocks: list[tuple[dict[str, list[str]], list[list[str]]]] = []
    for line in lines:
        name, equals, rest = line.partition('=')
        if equals and name.isalpha():
            if not blocks or blocks[-1][1]:
                blocks.append(({}, []))
            blocks[-1][0][name] = [cell.strip() for cell in rest.strip('\t').split('\t')]
        elif line.strip() and blocks:
            # a comment follows the numbers of a row, behind #
            cells = [cell.strip() for cell in line.split('#')[0].rstrip('\t ').split('\t')]
            blocks[-1][1].append(cells)
    return blocks


def _value(path: Path, cell: str, comma: bool) -> float:
    value = number(cell, comma)
    if value is None:
        raise RecordingError(f'expected numbers in {path}, got {cell[:40]!r}')
    return value


def _at(texts: list[str], index: int) -> str:
    return texts[index].strip('*') if index < len(texts) else ''
