# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Dose ledger: what a device gave and what a patient got, on the disk before a pulse is fired.

Pulses are reserved ahead, some at a time.  After a crash everything reserved and not given back
counts as delivered.  There is one ledger a device (its coil, its rest) and one a patient (the
dose, whichever device gave it); each reservation stands in both.
"""

import json
import re
import secrets
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from rpms_ros.errors import StimulationError
from rpms_ros.pulses import nanoseconds
from rpms_ros.stimulation.limits.limiter import (
    ENERGY_ROUNDING,
    BookedPulse,
    DoseExceeded,
    DoseLimits,
    LedgerError,
)
from rpms_ros.stimulation.records.append_only import BEGIN, ChainedFile, Record, wall_ns_of
from rpms_ros.stimulation.records.clocks import Clocks
from rpms_ros.stimulation.schedule.fields import LONGEST_NAME

RESERVE, SETTLE = 'reserve', 'settle'
LARGEST_ENERGY_J = 1e6
_BATCH = re.compile(rb'"batch":"([0-9a-f-]+)"')
_PULSE = re.compile(rb'\[-?\d+,([0-9.eE+-]+),([0-9.eE+-]+)\]')


@dataclass
class Batch:
    """Pulses that were reserved together.

    Attributes
    ----------
    content : mapping
        The record.
    pulses : dict of int to BookedPulse
        Those that count, by their index within the batch.  Their times are since the boot until
        the records of that are read, then minus their ages.
    """

    content: Mapping[str, Any]
    pulses: dict[int, BookedPulse]


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
    # the boot that is read, its reservations, and the largest difference of wall clock and time
    # since a boot: until it was set, a clock may have been behind
    _boot: str = ''
    _newest: deque[str] = field(default_factory=deque)
    _ahead_ns: dict[str, int] = field(default_factory=dict)

    def take(self, record: Record) -> None:
        """Take one record in.

        Raises
        ------
        LedgerError
            If the ledger is somebody else's or says something that no ledger says.
        """
        content = record.content
        try:
            boot, ahead_ns = content['boot_id'], wall_ns_of(content['time']) - content['boot_ns']
            if boot not in self._ahead_ns:
                self.end_boot()
                self._boot = boot
            self._ahead_ns[boot] = max(ahead_ns, self._ahead_ns.get(boot, ahead_ns))
            if content['kind'] == BEGIN:
                if (content['owner'], content['name']) != (self.owner, self.name):
                    raise LedgerError(
                        f'expected the ledger of {self.owner} {self.name!r}, '
                        f'got that of {content["owner"]} {content["name"]!r}'
                    )
            elif content['kind'] == RESERVE:
                self._reserve(content)
            elif content['kind'] == SETTLE:
                for key, index in content['unfired']:
                    if key in self.batches:
                        self.batches[key].pulses.pop(index, None)
        except (KeyError, TypeError, ValueError) as fault:
            said = f'line {record.line}: expected a record of a ledger, got {fault!r}'
            raise LedgerError(said) from fault

    def _reserve(self, content: Mapping[str, Any]) -> None:
        key = content['batch']
        pulses = dict(enumerate(_pulse(*row) for row in content['pulses']))
        self.batches[key] = Batch(content, pulses)
        if content['boot_id'] == self._boot:
            self._newest.append(key)
            # too old whatever the wall clock says
            oldest_ns = content['boot_ns'] - self.horizon_ns
            while self._newest and self._ended(self._newest[0], oldest_ns):
                del self.batches[self._newest.popleft()]
        else:
            # of an earlier boot, written once more for a process that was killed
            self._date(key)
        other = content['patient' if self.owner == 'device' else 'device']
        self.partners[other] += 1
        if other == self.partner:
            self.shared.append(key)

    def _ended(self, key: str, before_ns: int) -> bool:
        """Return whether no pulse of a batch was after a time since its boot [ns]."""
        return all(pulse.time_ns < before_ns for pulse in self.batches[key].pulses.values())

    def end_boot(self) -> None:
        """Turn times of the boot that was read into ages: the ledger, or that boot, is over."""
        for key in self._newest:
            self._date(key)
        self._newest.clear()

    def _date(self, key: str) -> None:
        """Turn times of a batch into ages; forget what is too old."""
        batch, found = self.batches[key], {}
        boot = batch.content['boot_id']
        for index, pulse in batch.pulses.items():
            age_ns = self.clocks.age_ns(boot, pulse.time_ns, self._ahead_ns[boot] + pulse.time_ns)
            if age_ns < self.horizon_ns:
                found[index] = pulse._replace(time_ns=-age_ns)
        batch.pulses = found
        if not found:
            del self.batches[key]


def _pulse(time_ns: int, intensity: float | str, energy_j: float | str) -> BookedPulse:
    """Return a pulse; raise ValueError for figures that none has."""
    pulse = BookedPulse(time_ns, float(intensity), float(energy_j))
    if not (0.0 <= pulse.intensity <= 1.0 and 0.0 <= pulse.energy_j <= LARGEST_ENERGY_J):
        raise ValueError(f'a pulse of {intensity} and {energy_j} J')
    return pulse


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


def readable(torn: bytes, known: LedgerReader) -> list[BookedPulse]:
    """Return the pulses of a record that was cut off, as far as it can be read, as of now.

    Raises
    ------
    LedgerError
        If there is something in it that no pulse has.
    """
    batch = _BATCH.search(torn)
    if batch is not None and batch[1].decode('ascii') in known.batches:
        return []
    try:
        return [_pulse(0, *row) for row in _PULSE.findall(torn)]
    except ValueError as fault:
        said = f'expected pulses in the record that was cut off, got {fault}'
        raise LedgerError(said) from fault


PURPOSE = 'dose ledger'
# of a reservation that has to be written once more: when it was made stays what it was
_COPIED = ('batch', 'device', 'patient', 'pulses', 'time', 'boot_id', 'boot_ns')


class DoseTotals(NamedTuple):
    """What a patient got within the window, reserved pulses included.

    Attributes
    ----------
    pulses : int
        Number of pulses.
    energy_j : float
        Energy [J].
    """

    pulses: int
    energy_j: float


@dataclass
class _Entry:
    time_ns: int
    energy_j: float
    # batch and index within it, on the disk
    place: tuple[str, int]
    counts: bool = True


class MemoryLedger:
    """A dose ledger for a simulated device: nothing outlives the process.

    Parameters
    ----------
    dose : DoseLimits, optional
        What the patient may get; no bound without.
    clock : callable
        Monotonic time [ns].
    """

    def __init__(
        self, dose: DoseLimits | None = None, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._dose, self._clock = dose, clock
        self._writing, self._counting = threading.Lock(), threading.Lock()
        self._entries: deque[_Entry] = deque()
        self._open: dict[int, _Entry] = {}
        self._numbers = self._pulses = 0
        self._energy_j = 0.0

    def history(self, now_monotonic_ns: int) -> tuple[BookedPulse, ...]:
        """Return no pulses: a ledger in memory has no earlier processes."""
        del now_monotonic_ns
        return ()

    def check(self, more: int, energy_j: float) -> None:
        """Raise DoseExceeded if so many pulses of so much energy [J] would be too much."""
        dose = self._dose
        if dose is None:
            return
        count, energy = self.totals()
        for limit, total, most, unit in (
            ('dose_pulses', count + more, dose.pulses, 'pulses'),
            ('dose_energy_j', energy + energy_j, dose.energy_j * (1.0 + ENERGY_ROUNDING), 'J'),
        ):
            if total > most:
                fault = f'expected at most {most:.8g} {unit} in {dose.window_h:g} h'
                raise DoseExceeded(limit, f'{fault}, got {total:.8g} {unit}')

    def reserve(self, pulses: Sequence[BookedPulse]) -> range:
        """Count pulses that are going to be fired; return a number for each.

        Raises
        ------
        LedgerError
            If they cannot be counted; DoseExceeded if they are more than the patient may get.
            None of them may be fired then.
        """
        with self._writing:
            self.check(len(pulses), sum(pulse.energy_j for pulse in pulses))
            # on the disk before they are counted
            entries = self._counted(pulses, self._write(pulses) if pulses else '')
            with self._counting:
                first, self._numbers = self._numbers, self._numbers + len(entries)
                self._open.update(enumerate(entries, first))
                return range(first, self._numbers)

    def take(self, number: int) -> None:
        """Note that a reserved pulse is triggered now; each can be taken once.

        Waits for no file.

        Raises
        ------
        LedgerError
            If the pulse is not reserved, was taken or was given back.
        """
        with self._counting:
            if self._open.pop(number, None) is None:
                raise LedgerError(f'expected a reserved pulse, got number {number}')

    def settle(self, numbers: Iterable[int] | None = None) -> None:
        """Give reserved pulses back that were not taken, so certainly never triggered.

        Parameters
        ----------
        numbers : iterable of int, optional
            Which ones; all by default.

        Raises
        ------
        LedgerError
            If one of them is not reserved or was taken, or the files cannot be written.
        """
        with self._writing:
            with self._counting:
                given = list(self._open if numbers is None else dict.fromkeys(numbers))
                if wrong := [number for number in given if number not in self._open]:
                    fault = f'expected reserved pulses to give back, got numbers {wrong}'
                    raise LedgerError(fault)
                entries = [self._open.pop(number) for number in given]
                for entry in entries:
                    self._drop(entry)
            if entries:
                self._write_unfired([entry.place for entry in entries])

    def count(self, pulses: Sequence[BookedPulse]) -> None:
        """Count pulses that were given, whatever the patient may get.

        Raises
        ------
        LedgerError
            If they cannot be written.
        """
        with self._writing:
            self._counted(pulses)
            self._write(pulses)

    def totals(self) -> DoseTotals:
        """Return what the patient got within the window of the dose, reserved pulses included."""
        with self._counting:
            if self._dose is not None:
                start = self._clock() - nanoseconds(self._dose.window_h * 3600.0)
                while self._entries and self._entries[0].time_ns <= start:
                    self._drop(self._entries.popleft())
            return DoseTotals(self._pulses, self._energy_j)

    def look(self) -> None:
        """Raise LedgerError if pulses cannot be reserved any more."""

    def close(self) -> None:
        """Give back what was not taken."""
        self.settle()

    def _write(self, pulses: Sequence[BookedPulse]) -> str:
        """Put pulses on the disk, where there is one; return the identifier of the batch."""
        del pulses
        return ''

    def _write_unfired(self, places: list[tuple[str, int]]) -> None:
        """Put on the disk, where there is one, which pulses of which batches were given back."""

    def _counted(self, pulses: Iterable[BookedPulse], batch: str = '') -> list[_Entry]:
        entries = [
            _Entry(pulse.time_ns, pulse.energy_j, (batch, index))
            for index, pulse in enumerate(pulses)
        ]
        with self._counting:
            if self._dose is not None:
                self._entries.extend(entries)
            self._pulses += len(entries)
            for entry in entries:
                self._energy_j += entry.energy_j
        return entries

    def _drop(self, entry: _Entry) -> None:
        """Stop counting a pulse that has left the window, or was given back."""
        if entry.counts:
            entry.counts = False
            self._pulses -= 1
            self._energy_j = self._energy_j - entry.energy_j if self._pulses else 0.0


class DoseLedger(MemoryLedger):
    """A dose ledger in two files of a folder, locked as long as it is open.

    Parameters
    ----------
    folder : Path
        Where the ledgers are kept; made if it is not there.
    device, patient : str
        Names of the device and (a pseudonym) of the patient, printable ASCII.
    dose : DoseLimits, optional
        What the patient may get; no bound without.
    clocks : Clocks
        Of this machine.

    Raises
    ------
    LedgerError
        If the device's or the patient's ledger is open elsewhere, damaged, or cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        device: str,
        patient: str,
        dose: DoseLimits | None = None,
        clocks: Clocks | None = None,
    ) -> None:
        self._clocks = clocks if clocks is not None else Clocks()
        super().__init__(dose, self._clocks.monotonic_ns)
        horizon = nanoseconds(3600.0 * max(24.0, dose.window_h if dose is not None else 0.0))
        self.device, self.patient = device, patient
        self._parties = {'device': device, 'patient': patient}
        self._session = secrets.token_hex(4)
        self._batches = 0
        self._files: list[ChainedFile] = []
        self._broken: str | None = None
        readers = [
            LedgerReader('device', device, patient, self._clocks, horizon),
            LedgerReader('patient', patient, device, self._clocks, horizon),
        ]
        try:
            for reader in readers:
                self._files.append(_opened(folder, reader))
            for reader, other in (readers, readers[::-1]):
                require_all(reader, sorted(folder.glob(f'{other.owner}-*.ledger')))
            self._past = self._agree(*readers)
            self._opened_ns = self._clocks.boot_ns()
        except StimulationError as fault:
            # a ledger that is refused stays as it is
            self._broken = str(fault)
            self.close()
            raise LedgerError(str(fault)) from fault
        past = self.history(self._clocks.monotonic_ns())
        self._counted(pulse for pulse in past if pulse.on_patient)

    def history(self, now_monotonic_ns: int) -> tuple[BookedPulse, ...]:
        """Return the pulses of earlier processes that may still count, oldest first.

        Parameters
        ----------
        now_monotonic_ns : int
            Now, on the clock that the answer is wanted on [ns].

        Returns
        -------
        tuple of BookedPulse
            Of the last 24 h, or of the window of the dose if that is longer, from this device or
            of this patient.
        """
        since = self._clocks.boot_ns() - self._opened_ns
        return tuple(
            pulse._replace(time_ns=now_monotonic_ns + pulse.time_ns - since)
            for pulse in self._past
        )

    def look(self) -> None:
        """Raise LedgerError if pulses cannot be reserved any more."""
        self._on_each(ChainedFile.look)

    def close(self) -> None:
        """Give back what was not taken and close the files; may be called again."""
        # what cannot be given back any more counts as delivered
        with suppress(LedgerError):
            self.settle()
            # a wall clock that was set since the last pulse tells how old that is
            self._write_unfired([])
        self._broken = self._broken or 'a closed ledger'
        for file in self._files:
            file.close()

    def _write(self, pulses: Sequence[BookedPulse]) -> str:
        ahead = self._clocks.boot_ns() - self._clocks.monotonic_ns()
        batch = f'{self._session}-{self._batches}'
        self._batches += 1
        rows = [
            [int(pulse.time_ns) + ahead, float(pulse.intensity), float(pulse.energy_j)]
            for pulse in pulses
        ]
        self._append(RESERVE, {'batch': batch, **self._parties, 'pulses': rows})
        return batch

    def _write_unfired(self, places: list[tuple[str, int]]) -> None:
        self._append(SETTLE, {'unfired': places}, sync=False)

    def _append(self, kind: str, fields: Mapping[str, Any], sync: bool = True) -> None:
        self._on_each(lambda file: file.append(kind, fields, sync))

    def _on_each(self, do: Callable[[ChainedFile], object]) -> None:
        if self._broken is not None:
            raise LedgerError(
                f'expected a working ledger, got {self._broken}: start the driver anew'
            )
        try:
            for file in self._files:
                do(file)
        except StimulationError as fault:
            # the two must never differ by more than one reservation
            self._broken = str(fault)
            raise LedgerError(str(fault)) from fault

    def _agree(self, device: LedgerReader, patient: LedgerReader) -> tuple[BookedPulse, ...]:
        """Return the past of both ledgers, with what a crash left out added.

        A reservation is written into the device's ledger first, so a process that was killed in
        between leaves the patient's one short; `require_all` has counted them.
        """
        given, got = device.shared, patient.shared
        if given != got and given[:-1] != got:
            raise LedgerError(
                f'expected the same reservations in the ledgers of device {device.name!r} and '
                f'patient {patient.name!r}, got others: records are missing'
            )
        if given != got:
            old = Batch({'batch': given[-1], **self._parties, 'pulses': []}, {})
            lost = device.batches.get(given[-1], old).content
            self._files[1].append(RESERVE, {name: lost[name] for name in _COPIED if name in lost})
        cut = [*readable(self._files[0].torn, device), *readable(self._files[1].torn, device)]
        if cut:
            now = self._clocks.monotonic_ns()
            self._write([past._replace(time_ns=now) for past in cut])
        return _past(device, patient, cut)


def _opened(folder: Path, reader: LedgerReader) -> ChainedFile:
    name = reader.name
    if not (name.isascii() and name.isprintable() and name.strip() and len(name) <= LONGEST_NAME):
        raise LedgerError(
            f'expected a name of 1 to {LONGEST_NAME} printable characters for the '
            f'{reader.owner}, got {name[:LONGEST_NAME]!r}'
        )
    # in lower case: a patient must not have two ledgers by a slip of the typist
    path = folder / f'{reader.owner}-{quote(name.casefold(), safe="")}.ledger'
    owner = {'owner': reader.owner, 'name': name}
    file = ChainedFile(path, PURPOSE, clocks=reader.clocks, read=reader.take, begin=owner)
    reader.end_boot()
    return file


def _past(
    device: LedgerReader, patient: LedgerReader, cut: Sequence[BookedPulse]
) -> tuple[BookedPulse, ...]:
    """Return all pulses, oldest first, with their (negative) age in place of a time."""
    found = list(cut)
    # what stands in both ledgers counts once
    for batch in {**patient.batches, **device.batches}.values():
        on_device = batch.content['device'] == device.name
        on_patient = batch.content['patient'] == patient.name
        found.extend(
            pulse._replace(on_device=on_device, on_patient=on_patient)
            for pulse in batch.pulses.values()
        )
    return tuple(sorted(found, key=lambda pulse: pulse.time_ns))
