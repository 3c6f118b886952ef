# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings and files of laboratories as sessions."""

import re
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rpms_ros.api.session import Session
from rpms_ros.axis import FORCE
from rpms_ros.errors import RecordingError
from rpms_ros.identification import DEFAULT_RATE
from rpms_ros.pulses import FloatArray, ForceTrace, PulseTrain, stamps
from rpms_ros.recording import Recording, RecordingFacts, Topics, read_recording
from rpms_ros.recording.importing import Imported, ImportOptions, import_file, is_foreign
from rpms_ros.report.recorded import true_muscle

# Beyond that nanoseconds do not fit into 64 bits.
_LATEST_S = 9e9
_TABLES = ('.csv', '.tsv', '.txt')
_OF_RECORDINGS = {'pulses_topic': 'pulses', 'force_topic': 'force', 'axis': 'z'}
# Options of the command, as messages name them: keywords here.
_OPTION = re.compile(r'--([a-z]+(?:-[a-z]+)*)(?: [A-Z][A-Z-]*)?')


def load(
    path: str | Path,
    *,
    time: str | None = None,
    force: str | None = None,
    pulse: str | None = None,
    time_unit: str | None = None,
    force_unit: str | None = None,
    pulse_unit: str | None = None,
    force_scale: float | None = None,
    sampling_rate: float | None = None,
    threshold: float | None = None,
    edge: str | None = None,
    intensity: float | str = 1.0,
    block: int | None = None,
    sheet: str | None = None,
    pulses_topic: str = 'pulses',
    force_topic: str = 'force',
    axis: str | Sequence[float] = 'z',
    sign: int = 1,
    quantity: str = 'force',
) -> Session:
    """Return the session that a file or folder holds.

    Parameters
    ----------
    path : str or Path
        Recording of rosbag2 (folder, mcap or sqlite3 file); a file of a laboratory, as
        ``rpms import`` takes it (table of text, LabChart text, MATLAB, Excel).
    time, force, pulse : str, optional
        Names of the columns or signals of a file; of the pulses also a list of trigger times.
        Guessed where they are not given; `Session.imported` has the guess.
    time_unit, force_unit : str, optional
        ``s``, ``ms``, ``us`` or ``min``; ``N``, ``mN``, ``kN``, ``g``, ``kg`` or ``lbf``;
        ``Nm``, ``mNm``, ``kNm``, ``kgm`` or ``ft-lbf`` of a torque; all forces are in N m then.
    pulse_unit : str, optional
        Unit of a list of trigger times, as of the time; ``samples`` for numbers of samples.
    force_scale : float, optional
        Newtons of one unit of the force signal, as for a force in V; newton metres with ``Nm``.
    sampling_rate : float, optional
        Rate of the samples of a file without times [Hz].
    threshold : float, optional
        Level of the gate between rest and pulse, in its own unit; half of its range if it is not
        given.  Files only.
    edge : str, optional
        Edge of the gate with which a pulse begins, ``rising`` or ``falling``; falling if the gate
        is high most of the time.  Files only.
    intensity : float or str
        Share of the stimulator's maximum of every pulse, 0 to 1: a gate does not tell it; or the
        column with it, or a file with one a pulse, ``NAME/FULL`` if it is FULL at the maximum.
        Files only.
    block : int, optional
        Block of a LabChart file, from 1.
    sheet : str, optional
        Sheet of a workbook.
    pulses_topic, force_topic : str
        Names of the topics; without a leading slash also in a namespace.  Recordings only.
    axis : str or sequence of float
        Axis of the wrench along which the muscle pulls: ``x``, ``y``, ``z``, ``-x`` or a
        direction.  Recordings only.
    sign : int
        -1 where the sensor shows the muscle's pull as negative, else 1.
    quantity : str
        What of a recorded wrench is read: ``force``, or ``torque``; then all forces are in N m.
        Of a file its unit decides.

    Returns
    -------
    Session
        What was recorded; of ``rpms simulate`` with the true muscle.

    Raises
    ------
    RecordingError
        If there is nothing at the path, it cannot be read, pulses or force are missing, or it
        cannot be guessed what is what: the message names the keyword that decides.

    Examples
    --------
    >>> import rpms_ros
    >>> session = rpms_ros.load('bags/sample')
    >>> len(session.pulses), len(session.force)
    (600, 30000)

    A MATLAB file:

    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from scipy.io import savemat
    >>> file = Path(tempfile.mkdtemp()) / 'leg.mat'
    >>> gate = np.where(np.arange(1000) % 50 == 10, 5.0, 0.0)
    >>> savemat(file, {'fs': 1000.0, 'force': np.zeros(1000), 'trigger': gate})
    >>> session = rpms_ros.load(file, intensity=0.8)
    >>> len(session.pulses), session.info()['imported'][1]
    (20, 'time: 1000 samples a second')

    Several sessions:

    >>> sessions = [rpms_ros.load(path) for path in sorted(Path('bags').glob('*/'))]
    >>> [session.name for session in sessions]
    ['sample']
    """
    place = Path(path)
    # each option has the name of its keyword here
    keywords = locals()
    options = ImportOptions(**{one.name: keywords[one.name] for one in fields(ImportOptions)})
    if is_foreign(place):
        if sign not in (1, -1):
            raise RecordingError(f'expected sign 1 or -1, got {sign!r}')
        for name, usual in _OF_RECORDINGS.items():
            if str(keywords[name]) != usual:
                raise RecordingError(f'expected {name} with a recording, got it with {place}')
        storage = 'table' if place.suffix.lower() in _TABLES else 'file'
        try:
            found = import_file(place, options)
            recording = recording_of(found, place, storage, sign, quantity)
        except RecordingError as error:
            raise RecordingError(_with_keywords(str(error))) from error
        told = tuple((label, _with_keywords(text)) for label, text in found.facts)
        return Session(name=place.stem, recording=recording, imported=told)
    if given := options.given():
        what = f'{given[0]} with a table or another file of a laboratory'
        raise RecordingError(f'expected {what}, got it with {place}')
    topics = Topics(pulses_topic, force_topic)
    recording = read_recording(place, topics, axis, sign, quantity=quantity)
    name = place.resolve().name if place.is_dir() else place.stem
    muscle = true_muscle(recording, DEFAULT_RATE)
    changing = muscle is not None and len(muscle.stamp_ns) > 1
    subject = None if muscle is None else muscle.subject
    return Session(name, recording, subject, muscle if changing else None)


def from_arrays(
    time: npt.ArrayLike,
    force: npt.ArrayLike,
    pulse_times: npt.ArrayLike,
    intensity: npt.ArrayLike = 1.0,
    *,
    name: str = 'arrays',
) -> Session:
    """Return the session of arrays that a program has.

    Parameters
    ----------
    time : array_like (samples,)
        Times of the samples, rising [s].
    force : array_like (samples,)
        Force [N]; not a number, or masked, where a sample is missing.
    pulse_times : array_like (pulses,)
        Onsets of the pulses, rising, in the clock of `time` [s].
    intensity : array_like (pulses,) or float
        Shares of the stimulator's maximum, 0 to 1.
    name : str
        What people call it.

    Raises
    ------
    RecordingError
        If lengths do not fit, times do not rise or are not finite, most pulses lie outside the
        force, or an intensity is no share.

    Examples
    --------
    >>> import numpy as np
    >>> import rpms_ros
    >>> time = np.arange(0.0, 5.0, 0.001)
    >>> session = rpms_ros.from_arrays(time, np.sin(time), [0.5, 0.55, 0.6], [0.4, 0.8, 0.6])
    >>> len(session.pulses), len(session.force)
    (3, 5000)
    """
    seconds, newtons, onsets = (np.atleast_1d(_numbers(one)) for one in (time, force, pulse_times))
    for what, values in (('time', seconds), ('pulse_times', onsets)):
        if values.ndim != 1 or not len(values) or not np.all(np.abs(values) < _LATEST_S):
            raise RecordingError(f'expected finite times in s in {what}, got {values}')
        if (late := np.flatnonzero(np.diff(values) <= 0.0)).size:
            fault = f'expected rising {what}, got {values[late[0]]} and then {values[late[0] + 1]}'
            raise RecordingError(fault)
    if newtons.shape != seconds.shape:
        fault = f'expected a force for each of {len(seconds)} times, got {newtons.shape}'
        raise RecordingError(fault)
    first, last = seconds[0], seconds[-1]
    if np.mean((onsets < first) | (onsets > last)) > 0.5:
        fault = f'expected pulse_times within those of the force, {first:g} to {last:g} s'
        raise RecordingError(f'{fault}, got {onsets[0]:g} to {onsets[-1]:g} s')
    shares = _numbers(intensity)
    if shares.shape not in ((), onsets.shape):
        fault = f'expected an intensity for each of {len(onsets)} pulses, or one'
        raise RecordingError(f'{fault}, got {shares.shape}')
    if (wrong := shares[~((shares >= 0.0) & (shares <= 1.0))]).size:
        raise RecordingError(f'expected intensities from 0 to 1, got {wrong[0]}')
    pulses = PulseTrain.numbered(stamps(onsets), shares)
    forces = ForceTrace(stamps(seconds), newtons)
    return Session(name, as_recording(pulses, forces, Path(name), 'arrays'))


def _numbers(given: npt.ArrayLike) -> FloatArray:
    """Return them, not a number where an array is masked."""
    try:
        if (kind := np.asarray(given).dtype).kind in 'mM':
            # a count of its unit, whatever that is
            raise TypeError(f'{kind}, times are in s')
        numbers: FloatArray = np.ma.filled(np.ma.array(given, dtype=float), np.nan)
    except (TypeError, ValueError) as error:
        raise RecordingError(f'expected numbers, got others: {error}') from error
    return numbers


def recording_of(found: Imported, path: Path, storage: str, sign: int, quantity: str) -> Recording:
    """Return what a file holds as if it had been recorded; `as_recording` has the parameters.

    Raises
    ------
    RecordingError
        If the file holds another quantity than the one that is asked for.
    """
    if quantity not in (FORCE, found.quantity):
        fault = f'expected a {quantity}, got a {found.quantity} in {path}; --force-unit decides'
        raise RecordingError(fault)
    forces = ForceTrace(found.forces.stamp_ns, sign * found.forces.force, found.forces.frame_id)
    return as_recording(found.pulses, forces, path, storage, found.quantity)


def _with_keywords(text: str) -> str:
    """Return a text that names keywords where it named options of the command."""
    return _OPTION.sub(lambda option: f'{option[1].replace("-", "_")}=', text)


def as_recording(
    pulses: PulseTrain, forces: ForceTrace, path: Path, storage: str, quantity: str = FORCE
) -> Recording:
    """Return pulses and forces as if each had been received at its stamp.

    Parameters
    ----------
    pulses, forces : PulseTrain, ForceTrace
        What happened.
    path : Path
        Where it came from, for people.
    storage : str
        What it came from, for people.
    quantity : str
        What the sensor measured.
    """
    before = np.searchsorted(forces.stamp_ns, pulses.onset_ns, side='left')
    received, facts = (pulses.onset_ns, forces.stamp_ns), RecordingFacts(path, storage, ())
    return Recording(pulses, forces, *received, before, facts, quantity)
