# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the ledgers of a device and of a patient say about earlier processes."""

import json
import math
import re
from collections import Counter
from collections.abc import Iterable
from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
from pathlib import Path
from typing import Any
from typing import NamedTuple

from rpms_ros.stimulation.clocks import Clocks
from rpms_ros.stimulation.dose import LedgerError
from rpms_ros.stimulation.record_chain import BEGIN
from rpms_ros.stimulation.record_chain import Record
from rpms_ros.stimulation.record_chain import wall_ns_of

RESERVE, SETTLE = 'reserve', 'settle'
LARGEST_ENERGY_J = 1e6
_BATCH = re.compile(rb'"batch":"([0-9a-f-]+)"')
_PULSE = re.compile(rb'\[-?\d+,([0-9.eE+-]+),([0-9.eE+-]+)\]')


class Past(NamedTuple):
    """A pulse of an earlier process.

    Attributes
    ----------
    age_ns : int
        How long ago, at least [ns].
    intensity : float
        Share of the maximum.
    energy_j : float
        Energy [J].
    """

    age_ns: int
    intensity: float
    energy_j: float


@dataclass
class Batch:
    """Pulses that were reserved together.

    Attributes
    ----------
    content : mapping
        The record.
    pulses : dict of int to Past
        Those that count, by their index within the batch.
    """

    content: Mapping[str, Any]
    pulses: dict[int, Past]


@dataclass
class LedgerReader:
    """Takes the records of one ledger in.

    Attributes
    ----------
    owner, name : str
        Whose it is: ``device`` or ``patient``, and what it is called.
    partner : str
        The patient, or the device, that is going to be in use together with it.
    clocks : Clocks
        Of this machine.
    horizon_ns : int
        Pulses older than this are left out [ns].
    batches : dict of str to Batch
        Reservations with pulses that still count, by their identifier, oldest first.
    shared : list of str
        Identifiers of all reservations together with the partner, oldest first.
    partners : Counter of str
        How many reservations there are together with whom.
    """

    owner: str
    name: str
    partner: str
    clocks: Clocks
    horizon_ns: int
    batches: dict[str, Batch] = field(default_factory=dict)
    shared: list[str] = field(default_factory=list)
    partners: Counter[str] = field(default_factory=Counter)

    def take(self, record: Record) -> None:
        """Take one record in.

        Raises
        ------
        LedgerError
            If the ledger is somebody else's or says something that no ledger says.
        """
        content = record.content
        try:
            if content['kind'] == BEGIN:
                self._check_owner(content)
            elif content['kind'] == RESERVE:
                self._reserve(content)
            elif content['kind'] == SETTLE:
                for key, index in content['unfired']:
                    if key in self.batches:
                        self.batches[key].pulses.pop(index, None)
        except (KeyError, TypeError, ValueError) as fault:
            raise LedgerError(
                f'line {record.line}: expected a record of a ledger, got {fault!r}'
            ) from fault

    def _check_owner(self, content: Mapping[str, Any]) -> None:
        if (content['owner'], content['name']) != (self.owner, self.name):
            raise LedgerError(
                f'expected the ledger of {self.owner} {self.name!r}, '
                f'got that of {content["owner"]} {content["name"]!r}'
            )

    def _reserve(self, content: Mapping[str, Any]) -> None:
        key = content['batch']
        pulses = self._pulses(content)
        if pulses:
            self.batches[key] = Batch(content, pulses)
        other = content['patient' if self.owner == 'device' else 'device']
        self.partners[other] += 1
        if other == self.partner:
            self.shared.append(key)

    def _pulses(self, content: Mapping[str, Any]) -> dict[int, Past]:
        """Return the pulses of a record that may still count, by their index."""
        rows, boot_id, written_ns = content['pulses'], content['boot_id'], content['boot_ns']
        wall_ns = wall_ns_of(content['time']) - written_ns
        latest = max((time_ns for time_ns, _, _ in rows), default=0)
        if self.clocks.age_ns(boot_id, latest, wall_ns + latest) >= self.horizon_ns:
            return {}
        found = {}
        for index, (time_ns, intensity, energy_j) in enumerate(rows):
            age = self.clocks.age_ns(boot_id, time_ns, wall_ns + time_ns)
            if age < self.horizon_ns:
                found[index] = Past(age, float(intensity), float(energy_j))
        return found


def agreed(device: LedgerReader, patient: LedgerReader) -> Batch | None:
    """Return the reservation that the patient's ledger lacks, if any.

    A reservation is written into the device's ledger first, so a process that was killed in
    between leaves the patient's one short.

    Raises
    ------
    LedgerError
        If one of them has lost records that the other has.
    """
    given, got = device.shared, patient.shared
    if given == got:
        return None
    if given[:-1] == got:
        old = {'batch': given[-1], 'device': device.name, 'patient': patient.name, 'pulses': []}
        return device.batches.get(given[-1], Batch(old, {}))
    short = device if len(given) <= len(got) else patient
    raise LedgerError(
        f'expected in the ledger of {short.owner} {short.name!r} the {max(len(given), len(got))} '
        f'reservations that the other ledger has, got {min(len(given), len(got))}: records are '
        'missing'
    )


def require_all(reader: LedgerReader, others: Iterable[Path]) -> None:
    """Hold a ledger against those of everybody else, so that its loss shows to the next partner.

    Raises
    ------
    LedgerError
        If it lacks reservations that one of the others has.
    """
    name, text = re.escape(json.dumps(reader.name).encode()), rb'("(?:[^"\\]|\\.)*")'
    parties = (name, text) if reader.owner == 'device' else (text, name)
    # whole lines alone: what a kill has cut off is written once more behind it
    pair = re.compile(rb'"device":%s,"patient":%s,[^\n]*"hash":"[0-9a-f]{64}"}\n' % parties)
    # of the last reservation a killed process may have left the patient's ledger without
    spare = 1 if reader.owner == 'patient' else 0
    for path in others:
        try:
            found = Counter(pair.findall(path.read_bytes()))
        except OSError as fault:
            raise LedgerError(f'expected a readable ledger, got {path}: {fault}') from fault
        for partner, count in found.items():
            got = reader.partners[json.loads(partner)]
            if got < count - spare:
                raise LedgerError(
                    f'expected in the ledger of {reader.owner} {reader.name!r} the {count} '
                    f'reservations that {path.name} has, got {got}: records are missing'
                )


def readable(torn: bytes, known: LedgerReader) -> list[Past]:
    """Return the pulses of a record that was cut off, as far as it can be read, as of now.

    Raises
    ------
    LedgerError
        If there is something in it that no pulse has.
    """
    batch = _BATCH.search(torn)
    if batch is not None and batch[1].decode('ascii') in known.batches:
        return []
    found = []
    for row in _PULSE.findall(torn):
        try:
            past = Past(0, *(float(figure) for figure in row))
        except ValueError:
            past = Past(0, math.nan, math.nan)
        if not (0.0 <= past.intensity <= 1.0 and 0.0 <= past.energy_j <= LARGEST_ENERGY_J):
            raise LedgerError(f'expected pulses in the record that was cut off, got {row}')
        found.append(past)
    return found
