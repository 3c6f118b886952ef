# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`rpms audit`: whether an audit log or a dose ledger is whole, and what it says."""

import argparse
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rpms_ros.cli.options import Subparsers, add_command
from rpms_ros.printable import printable

if TYPE_CHECKING:
    from rpms_ros.stimulation.records.append_only import Audit, Record

_STAMPS = frozenset({'number', 'kind', 'time', 'boot_id', 'boot_ns', 'previous', 'hash'})


def add_audit(subparsers: Subparsers) -> None:
    """Add `rpms audit`."""
    text = 'verify an audit log or a dose ledger, and say what it holds'
    parser = add_command(subparsers, 'audit', run, text)
    parser.add_argument('file', type=Path, help='audit log or dose ledger')


def run(arguments: argparse.Namespace) -> int:
    """Verify a file and print what it holds; return 0 if it is whole, 1 if not.

    Verify the chain of hashes of a stimulator driver's audit log, or of a dose ledger, and
    print its sessions: who did what, with which limits, what was refused, stopped and
    reset.  The first broken record is named by its line.  Note the newest hash elsewhere:
    it shows whether the end of the file was removed later.

    Examples
    --------
      rpms audit audit.jsonl
      rpms audit audit.jsonl | grep refusal
    exit status: 0 whole, 1 broken or cut off at the end, 2 no such file
    """
    from rpms_ros.errors import StimulationError
    from rpms_ros.stimulation.records.append_only import verify_log

    if not arguments.file.is_file():
        fault = f'expected an audit log or a dose ledger, got no regular file at {arguments.file}'
        raise StimulationError(fault)
    found = verify_log(arguments.file, purpose=None)
    print('\n'.join(report(arguments.file, found)))
    return 1 if found.fault or found.torn else 0


def report(path: Path, found: 'Audit') -> list[str]:
    """Return what a person wants to know, line by line."""
    lines = list(_verdict(path, found))
    if not found.records:
        return lines
    if found.records[0].content.get('purpose') == 'dose ledger':
        return [*lines, *_ledger(found.records)]
    counts = Counter(str(record.content['kind']) for record in found.records[1:])
    said = ', '.join(f'{printable(kind)} {count}' for kind, count in sorted(counts.items()))
    lines.append(f'  records      {said or "none"}')
    return [*lines, *map(_line, found.records[1:])]


def _verdict(path: Path, found: 'Audit') -> Iterator[str]:
    yield f'{path}: {len(found.records)} records, {"BROKEN" if found.fault else "whole"}'
    if found.fault:
        yield f'  first broken {found.fault}'
        yield '               nothing from there on can be trusted'
    if found.records:
        times = [str(record.content['time']) for record in (found.records[0], found.records[-1])]
        yield f'  time         {times[0]} to {times[1]}'
        yield f'  newest hash  {found.hash}'
    if found.torn:
        yield f'  cut off      {found.torn} bytes at the end: a process was killed'
    if torn := sum(record.content['kind'] == 'torn' for record in found.records):
        yield f'  cut off      {torn} times before, and continued'


def _line(record: 'Record') -> str:
    """Return one record: sessions stand out."""
    content = record.content
    time = str(content['time'])[:19].replace('T', ' ')
    # what is no plain letter is escaped
    said = json.dumps({name: value for name, value in content.items() if name not in _STAMPS})
    if content['kind'] == 'session':
        return f'session at {time} UTC: {said}'
    return f'  {time[11:]}  {printable(str(content["kind"])):<12} {said}'


def _ledger(records: 'tuple[Record, ...]') -> Iterator[str]:
    first = records[0].content
    yield f'  ledger       of {first["owner"]} {first["name"]}'
    days: dict[str, list[float]] = {}
    for record in records:
        pulses, unfired = record.content.get('pulses', ()), record.content.get('unfired', ())
        if pulses or unfired:
            day = days.setdefault(str(record.content['time'])[:10], [0, 0.0, 0])
            day[0] += len(pulses)
            day[1] += sum(energy for _, _, energy in pulses)
            day[2] += len(unfired)
    for name, (pulses, energy, back) in days.items():
        reserved = f'{pulses:g} pulses and {energy:.0f} J reserved'
        yield f'  {name}   {reserved}, {back:g} pulses given back'
