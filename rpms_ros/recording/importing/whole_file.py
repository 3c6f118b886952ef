# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One file of a laboratory as pulses and force: read, guessed, converted."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from rpms_ros.axis import FORCE, QUANTITIES
from rpms_ros.errors import RecordingError
from rpms_ros.pulses import FloatArray, ForceTrace, PulseTrain
from rpms_ros.recording.export import is_export, read_export
from rpms_ros.recording.importing.conversion import ImportChoices, converted, stamps_of
from rpms_ros.recording.importing.excel import read_excel
from rpms_ros.recording.importing.gates import GateSettings, heights_told, odd_gate, values_at
from rpms_ros.recording.importing.guess import Guess, guessed
from rpms_ros.recording.importing.matlab import read_matlab
from rpms_ros.recording.importing.signals import SignalFile
from rpms_ros.recording.importing.text import read_text, unused
from rpms_ros.recording.importing.xdf import read_xdf
from rpms_ros.recording.rosbag.scan import READERS


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """What is what in a file; what is None is guessed, or taken from the file.

    Attributes
    ----------
    time, force, pulse : str or None
        Names of the columns or signals; of the pulses also a list of trigger times.
    time_unit, force_unit : str or None
        Units.
    pulse_unit : str or None
        Unit of a list of trigger times; ``samples`` for numbers of samples.
    force_scale : float or None
        Newtons of one unit of the force signal; newton metres with a unit of a torque.
    sampling_rate : float or None
        Rate of a table without times [Hz].
    threshold : float or None
        Level of a gate between rest and pulse.
    edge : str or None
        Edge of a gate with which a pulse begins, ``rising`` or ``falling``.
    intensity : float or str
        Share of the stimulator's maximum of every pulse, 0 to 1; or a column with it,
        ``COLUMN/FULL`` if that is FULL at the maximum, or a file with one a pulse.
    block : int or None
        Block of a LabChart file, from 1.
    sheet : str or None
        Sheet of a workbook.
    """

    time: str | None = None
    force: str | None = None
    pulse: str | None = None
    time_unit: str | None = None
    force_unit: str | None = None
    pulse_unit: str | None = None
    force_scale: float | None = None
    sampling_rate: float | None = None
    threshold: float | None = None
    edge: str | None = None
    intensity: float | str = 1.0
    block: int | None = None
    sheet: str | None = None

    @property
    def gate(self) -> GateSettings:
        """What is stated of a gate."""
        share = 1.0 if isinstance(self.intensity, str) else self.intensity
        return GateSettings(self.threshold, share, self.edge)

    def given(self) -> list[str]:
        """Return the names of the options that are not left at their defaults."""
        return [one.name for one in fields(self) if getattr(self, one.name) != one.default]


@dataclass(frozen=True)
class Imported:
    """Pulses and force of a file.

    Attributes
    ----------
    pulses, forces : PulseTrain, ForceTrace
        What it holds.
    facts : tuple of (str, str)
        How it was read and what was guessed, for people.
    guessed : bool
        Whether anything was.
    quantity : str
        What was measured: ``force`` [N] or ``torque`` [N m].
    remarks : tuple of (str, str)
        Those of the facts that only its numbers tell, after the guess: what is missing or odd.
    """

    pulses: PulseTrain
    forces: ForceTrace
    facts: tuple[tuple[str, str], ...]
    guessed: bool
    quantity: str = FORCE
    remarks: tuple[tuple[str, str], ...] = ()


def is_foreign(path: Path) -> bool:
    """Return whether there is a file of a laboratory or an export, and no recording."""
    if path.name.removesuffix('.zstd').endswith(tuple(READERS)):
        return False
    named = not path.exists() and path.suffix != ''
    return named or path.is_file() or is_export(path)


def guess_by(file: SignalFile, options: ImportOptions) -> Guess:
    """Return what is taken for what; raises as `guessed` does."""
    return guessed(
        file,
        time=options.time,
        force=options.force,
        pulse=options.pulse,
        time_unit=options.time_unit,
        force_unit=options.force_unit,
        pulse_unit=options.pulse_unit,
        sampling_rate_hz=options.sampling_rate,
        force_scale=options.force_scale,
        gate=options.gate,
    )


# What overflows or is no number fails the checks below, in words; NumPy's own say nothing more.
@np.errstate(over='ignore', invalid='ignore')
def import_file(
    path: Path,
    options: ImportOptions,
    decide: Callable[[SignalFile, ImportOptions], Guess] = guess_by,
) -> Imported:
    """Return pulses and force of a file, or of an export of this package.

    Parameters
    ----------
    path : Path
        Any file that `read_signals` reads; a folder or file that `rpms export` wrote.
    options : ImportOptions
        What is what.
    decide : callable
        Guesses the rest; a terminal is asked here.

    Raises
    ------
    Ambiguous
        If something cannot be guessed.
    RecordingError
        If the file cannot be read, or an option does not fit it.
    """
    if is_export(path):
        if names := options.given():
            raise RecordingError(
                f'expected no options for an export, in which everything is stated, got '
                f'{", ".join(names)} with {path}'
            )
        pulses, forces, unit = read_export(path)
        facts = (('file', 'export of rpms'),)
        return Imported(pulses, forces, facts, guessed=False, quantity=QUANTITIES[unit])
    choices = ImportChoices(
        options.gate,
        options.sampling_rate,
        options.force_scale,
    )
    file = read_signals(path, options.block, options.sheet)
    guess = decide(file, options)
    pulses, forces = converted(file, guess, choices)
    remarks = list(_remarks(pulses, forces))
    if pulses.sequence[0]:
        remarks.append(('warning', _BEGUN))
    elif begins_amid(pulses, forces):
        pulses = numbered_on(pulses)
        remarks.append(('warning', _AMID))
    used = {guess.time, guess.force, guess.pulse}
    signals = {one.name: one for one in file.signals}
    if isinstance(options.intensity, str):
        name, shares = _intensities(file, guess, choices, pulses, options.intensity)
        pulses = replace(pulses, intensity=shares)
        used.add(name)
    elif guess.pulse in signals and guess.pulse_unit is None:
        stamp_ns = stamps_of(file, signals[guess.pulse], guess, choices)
        if warning := heights_told(signals[guess.pulse], stamp_ns, pulses):
            remarks.append(('warning', warning))
    names = [*signals, *(one.name for one in file.events)]
    if left := [name for name in names if name not in used]:
        remarks.append(('not used', ', '.join(map(repr, left))))
    if options.intensity == 1.0:
        remarks += [
            ('warning', f'each pulse has the intensity 1; --intensity {name!r} decides otherwise')
            for name in left
            if 'intens' in name.lower()
        ]
    read = (('file', ', '.join((file.kind, *file.facts))), *guess.reasons, *remarks)
    named = None not in (options.time, options.force, options.pulse)
    told = remarks or any(text.endswith('decides)') for _, text in guess.reasons)
    return Imported(pulses, forces, read, bool(told or not named), guess.quantity, tuple(remarks))


def _intensities(
    file: SignalFile, guess: Guess, choices: ImportChoices, pulses: PulseTrain, text: str
) -> tuple[str, FloatArray]:
    """Return the column or file that `text` names, and the shares in it (pulses,)."""
    signals = {one.name: one for one in file.signals}
    name, slash, full = text.rpartition('/')
    if text in signals or not (slash and name in signals):
        name, full = text, '1'
    try:
        scale = 1.0 / float(full)
    except (ValueError, ZeroDivisionError) as error:
        raise RecordingError(f'expected --intensity COLUMN/FULL, got {text!r}') from error
    if name in signals:
        found = signals[name]
        shares = found.values
        if len(shares) != len(pulses):
            stamp_ns = stamps_of(file, found, guess, choices)
            shares = values_at(shares, stamp_ns, pulses)
    else:
        if not Path(name).is_file():
            columns = ', '.join(map(repr, signals))
            raise RecordingError(
                f'expected a share, a column or a file with --intensity, got {text!r}; the '
                f'columns of {file.path} are {columns}'
            )
        table = read_signals(Path(name)).signals
        found = next((one for one in table if 'intens' in one.name.lower()), table[0])
        shares = found.values
        if len(shares) != len(pulses):
            raise RecordingError(
                f'expected the intensity of each of {len(pulses)} pulses in {name}, got '
                f'{len(shares)}'
            )
    shares = shares * (scale / 100.0 if found.unit == '%' else scale)
    if (wrong := np.flatnonzero(~((shares >= 0.0) & (shares <= 1.0)))).size:
        raise RecordingError(
            f'expected intensities from 0 to 1 in {name!r}, or in a column with the unit %, got '
            f'{shares[wrong[0]]:.4g} of pulse {wrong[0] + 1}: --intensity COLUMN/FULL divides by '
            'the value of the maximum'
        )
    return name, shares


def _remarks(pulses: PulseTrain, forces: ForceTrace) -> Iterator[tuple[str, str]]:
    if missing := int(np.count_nonzero(~np.isfinite(forces.force))):
        yield 'missing', f'{missing} samples of the force are no finite number'
    period = float(np.median(np.diff(forces.stamp_ns))) / 1e9 if len(forces) > 1 else 0.0
    if warning := odd_gate(pulses, period):
        yield 'warning', warning


_AMID = (
    'pulses come from the beginning, and the force is not at rest there: those before it are not '
    'in the file, and nothing is learnt while they may act; better begin at rest'
)
_BEGUN = (
    'the gate is up in the first row: when that pulse began is not in the file, and nothing is '
    'learnt while it may act; better begin at rest'
)
# The first pulse comes within so many intervals of the pulses after it.
_INTERVALS = 1.5
_FEWEST_PULSES = 5
# Share of the range of the force by which rest is left, at either end: a pull may be negative.
_SHARE = 0.15
# The same in standard deviations of the noise.
_NOISE = 6.0


def begins_amid(pulses: PulseTrain, forces: ForceTrace) -> bool:
    """Return whether stimulation was going on before the first sample, as far as a file shows.

    Parameters
    ----------
    pulses : PulseTrain
        Ascending.
    forces : ForceTrace
        Ascending.
    """
    known = np.isfinite(forces.force)
    force = forces.force[known]
    if len(pulses) < _FEWEST_PULSES or len(force) < 3:
        return False
    first_ns = int(forces.stamp_ns[0])
    interval = float(np.median(np.diff(pulses.onset_ns[: 10 * _FEWEST_PULSES])))
    if not 0.0 <= pulses.onset_ns[0] - first_ns < _INTERVALS * interval:
        return False
    # no pulse of the file acts on these
    before = force[forces.stamp_ns[known] <= pulses.onset_ns[0]]
    if not len(before):
        return False
    low, high = np.percentile(force, [1.0, 99.0])
    noise = float(np.median(np.abs(np.diff(force, 2)))) / (0.6745 * np.sqrt(6.0))
    least = max(_SHARE * (high - low), _NOISE * noise)
    level = float(np.median(before))
    return bool(low + least < level < high - least)


def numbered_on(pulses: PulseTrain) -> PulseTrain:
    """Return the pulses with sequence numbers that say that there were pulses before them."""
    return replace(pulses, sequence=pulses.sequence + 1)


_ZIP, _XDF, _HDF5, _MATLAB = b'PK\x03\x04', b'XDF:', b'\x89HDF', b'MATLAB'


def read_signals(path: Path, block: int | None = None, sheet: str | None = None) -> SignalFile:
    """Return what a file holds.

    Parameters
    ----------
    path : Path
        Table of text, LabChart or Spike2 text, MATLAB, Excel or XDF file.
    block : int, optional
        Block of a LabChart file, from 1.
    sheet : str, optional
        Sheet of a workbook.

    Raises
    ------
    RecordingError
        If it cannot be read; the message says what was expected and which option decides.
    """
    # A pipe would be waited for without end.
    if not path.exists():
        raise RecordingError(f'expected a file at {path}, got no such file')
    if not path.is_file():
        raise RecordingError(f'expected a file at {path}, got no regular file')
    try:
        with path.open('rb') as file:
            head = file.read(1024)
    except OSError as error:
        raise RecordingError(f'expected a file at {path}, got {error}') from error
    if head.startswith(_ZIP):
        unused(path, 'a LabChart file with --block', block)
        return read_excel(path, sheet)
    unused(path, 'a workbook with --sheet', sheet)
    known = read_xdf if head.startswith(_XDF) else None
    if head.startswith((_HDF5, _MATLAB)) or path.suffix.lower() == '.mat':
        known = read_matlab
    if known is not None:
        unused(path, 'a LabChart file with --block', block)
        return known(path)
    return read_text(path, block)


def read_csv(
    path: Path | str, time: str, force: str, pulse: str, settings: GateSettings | None = None
) -> tuple[PulseTrain, ForceTrace]:
    """Return pulses and forces of a table with columns of time [s], force [N] and gate.

    Raises
    ------
    RecordingError
        As `import_file`.
    """
    gate = settings or GateSettings()
    found = import_file(
        Path(path),
        ImportOptions(
            time=time,
            force=force,
            pulse=pulse,
            time_unit='s',
            force_unit='N',
            threshold=gate.threshold,
            intensity=gate.intensity,
            edge=gate.edge,
        ),
    )
    return found.pulses, found.forces
