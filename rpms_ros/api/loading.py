"""Recordings and tables as sessions."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rpms_ros.api.session import Session
from rpms_ros.errors import RecordingError
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import PulseTrain
from rpms_ros.recording import GateSettings
from rpms_ros.recording import Recording
from rpms_ros.recording import RecordingFacts
from rpms_ros.recording import Topics
from rpms_ros.recording import read_csv
from rpms_ros.recording import read_recording

_TABLES = ('.csv', '.tsv', '.txt')


def load(
    path: str | Path,
    *,
    columns: tuple[str, str, str] | None = None,
    threshold: float | None = None,
    intensity: float = 1.0,
    pulses_topic: str = 'pulses',
    force_topic: str = 'force',
    axis: str | Sequence[float] = 'z',
    sign: int = 1,
) -> Session:
    """Return the session that a file or folder holds.

    Parameters
    ----------
    path : str or Path
        Recording of rosbag2 (folder, mcap or sqlite3 file) or table (``.csv``, ``.tsv``,
        ``.txt``).
    columns : tuple of str, optional
        Names of the columns of a table: time [s], force [N], gate of the stimulator.
    threshold : float, optional
        Level of the gate between rest and pulse, in its own unit; half of its range if it is not
        given.  Tables only.
    intensity : float
        Share of the stimulator's maximum of every pulse, 0 to 1: a gate does not tell it.  Tables
        only.
    pulses_topic, force_topic : str
        Names of the topics; without a leading slash also in a namespace.  Recordings only.
    axis : str or sequence of float
        Axis of the wrench along which the muscle pulls: ``x``, ``y``, ``z``, ``-x`` or a
        direction.  Recordings only.
    sign : int
        -1 where the sensor shows the muscle's pull as negative, else 1.

    Returns
    -------
    Session
        What was recorded.

    Raises
    ------
    RecordingError
        If there is nothing at the path, it cannot be read, or pulses or force are missing.

    Examples
    --------
    >>> import rpms_ros
    >>> session = rpms_ros.load('bags/sample')
    >>> len(session.pulses), len(session.force)
    (600, 30000)

    Several sessions:

    >>> from pathlib import Path
    >>> sessions = [rpms_ros.load(path) for path in sorted(Path('bags').glob('*/'))]
    >>> [session.name for session in sessions]
    ['sample']
    """
    place = Path(path)
    if place.suffix.lower() in _TABLES:
        if columns is None:
            raise RecordingError(
                f'expected columns=(time, force, gate) for the table {place}, got none'
            )
        if sign not in (1, -1):
            raise RecordingError(f'expected sign 1 or -1, got {sign}')
        pulses, forces = read_csv(place, *columns, GateSettings(threshold, intensity))
        signed = ForceTrace(forces.stamp_ns, sign * forces.force, forces.frame_id)
        return Session(name=place.stem, recording=as_recording(pulses, signed, place, 'table'))
    if columns is not None:
        raise RecordingError(f'expected columns with a table only, got them with {place}')
    topics = Topics(pulses_topic, force_topic)
    recording = read_recording(place, topics, axis, sign)
    name = (place.resolve() if place.is_dir() else place).stem
    return Session(name=name, recording=recording, topics=topics)


def as_recording(pulses: PulseTrain, forces: ForceTrace, path: Path, storage: str) -> Recording:
    """Return pulses and forces as if each had been received at its stamp.

    Parameters
    ----------
    pulses, forces : PulseTrain, ForceTrace
        What happened.
    path : Path
        Where it came from, for people.
    storage : str
        What it came from, for people.
    """
    return Recording(
        pulses,
        forces,
        pulses.onset_ns,
        forces.stamp_ns,
        np.searchsorted(forces.stamp_ns, pulses.onset_ns, side='left'),
        RecordingFacts(path, storage, ()),
    )
