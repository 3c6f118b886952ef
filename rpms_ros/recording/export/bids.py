# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A BIDS dataset of one session: force as physio, pulses as events, parameters in ``nibs/``."""

import gzip
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from rpms_ros import __version__
from rpms_ros.axis import QUANTITIES
from rpms_ros.errors import RecordingError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, IntArray, PulseTrain
from rpms_ros.recording.export.tables import SessionExport, estimate_columns, seconds_text

_LABEL = re.compile(r'[A-Za-z0-9]+', re.ASCII)
_DESCRIPTION = 'dataset_description.json'
# The year 2000: stamps before are those of a clock that began with the machine.
_EARLIEST_S = 946_684_800
_BIDS_VERSION = '1.11.0'
_DRAFT = 'NIBS-BIDS (BEP 037), proposal v6.3 of July 2026'
"""What the folder nibs/ follows: https://github.com/nigelrogasch/nibs-bids."""
_README = f"""\
Force of a muscle that was stimulated by repetitive pulses, written by rpms_ros {__version__}.

- beh/*_recording-force_physio.tsv.gz: force samples with their times
- beh/*_events.tsv: one row for each pulse; nibs_event_id names its parameters
- nibs/*_nibs.tsv: parameters of the pulses, as {_DRAFT} has them
- derivatives/rpms_ros: estimates of the muscle that were made during the session, if any

The folder nibs/ is not part of BIDS {_BIDS_VERSION}, so .bidsignore names it.  What the recording
does not tell is not stated: stimulator, coil or electrodes and where they were placed.
"""
_IGNORED = '**/nibs\n'


def _column(name: str, text: str, **more: Any) -> dict[str, Any]:
    return {'LongName': name, 'Description': text, **more}


_PNS = 'A muscle is stimulated through the nerves within it.'
_REFERENCE = 'Identifier of a parameter set; referenced from the events.'
_NUMBER = 'Counter of the driver; a number left out is a pulse that was not seen.'
_DIRECT = 'The intensity is stated directly, not as multiple of a threshold.'
_EVENT_COLUMNS = {
    'onset': _column('Onset of the pulse', 'Time after the first force sample.', Units='s'),
    'duration': _column('Duration of the pulse', 'As stated.', Units='s'),
    'nibs_event_id': _column(
        'Stimulation parameters', 'References nibs_event_id in nibs/*_nibs.tsv.'
    ),
    'sequence': _column('Number of the pulse', _NUMBER),
}
_NIBS_COLUMNS = {
    'nibs_event_id': _column('Stimulation parameters', _REFERENCE),
    'nibs_type': _column(
        'Stimulation modality', _PNS, Levels={'PNS': 'Peripheral nerve stimulation'}
    ),
    'stimulus_intensity': _column(
        'Intensity', 'Delivered amplitude of the pulse.', Units='% Maximum Stimulator Output'
    ),
    'stimulus_duration': _column('Pulse width', 'Duration of the pulse.', Units='s'),
    'intensity_scaling': _column(
        'Scaling of the intensity', _DIRECT, Levels={'absolute': 'directly specified'}
    ),
}


@dataclass(frozen=True)
class BidsNames:
    """Labels that the names of the files are made of: letters and digits.

    Attributes
    ----------
    subject, task : str
        Who, and what was done.
    session : str
        Which visit; empty if there was one only.
    run : int or None
        Which of several recordings of the visit, from 1.
    """

    subject: str = '01'
    task: str = 'rpms'
    session: str = ''
    run: int | None = None

    def __post_init__(self) -> None:
        for name in ('subject', 'task', 'session'):
            label = getattr(self, name)
            if not _LABEL.fullmatch(label) and not (name == 'session' and label == ''):
                raise RecordingError(f'expected a {name} of letters and digits, got {label!r}')
        if self.run is not None and self.run < 1:
            raise RecordingError(f'expected a run from 1, got {self.run}')

    @property
    def folder(self) -> str:
        """Folder of the visit within the dataset."""
        return f'sub-{self.subject}' + (f'/ses-{self.session}' if self.session else '')

    def file(self, ending: str) -> str:
        """Return the name of a file, without its folder."""
        parts = [f'sub-{self.subject}', f'ses-{self.session}' if self.session else '']
        parts += [f'task-{self.task}', f'run-{self.run}' if self.run else '', ending]
        return '_'.join(part for part in parts if part)


def write_bids(folder: Path, session: SessionExport, names: BidsNames) -> None:
    """Write a dataset.

    Parameters
    ----------
    folder : Path
        Does not exist yet.
    session : SessionExport
        What is written.
    names : BidsNames
        Labels of its files.

    Raises
    ------
    RecordingError
        If there are fewer than two force samples, so that there is no rate.
    """
    visit = folder / names.folder
    for place in (visit / 'beh', visit / 'nibs'):
        place.mkdir(parents=True)
    title = 'Stimulated muscle' if session.anonymous else f'Stimulated muscle: {session.name}'
    _write_json(folder / _DESCRIPTION, _dataset(title, 'raw'))
    (folder / 'README').write_text(_README, encoding='utf-8')
    (folder / '.bidsignore').write_text(_IGNORED, encoding='utf-8')
    _write_table(folder / 'participants.tsv', {'participant_id': [f'sub-{names.subject}']})
    physio = names.file('recording-force_physio')
    _write_force(visit / 'beh' / f'{physio}.tsv.gz', session)
    _write_json(visit / 'beh' / f'{physio}.json', _force_sidecar(session, names.task))
    _write_pulses(visit, session, names)
    scan = f'beh/{physio}.tsv.gz'
    start = {'filename': [scan], 'acq_time': [_start(session.stated_origin_ns)]}
    _write_table(visit / f'{names.folder.replace("/", "_")}_scans.tsv', start)
    if session.estimates is not None:
        _write_estimates(folder / 'derivatives' / 'rpms_ros', session, names, title)


def _write_pulses(visit: Path, session: SessionExport, names: BidsNames) -> None:
    pulses = session.pulses
    labels, sets = _parameter_sets(pulses)
    events = names.file('events')
    columns = {
        'onset': seconds_text(pulses.onset_ns, session.origin_ns),
        'duration': pulses.width.tolist(),
        'nibs_event_id': labels,
        'sequence': pulses.sequence.tolist(),
    }
    _write_table(visit / 'beh' / f'{events}.tsv', columns)
    _write_json(visit / 'beh' / f'{events}.json', _EVENT_COLUMNS)
    nibs = names.file('nibs')
    _write_table(visit / 'nibs' / f'{nibs}.tsv', sets)
    sidecar = {
        'NIBSDescription': 'Repetitive stimulation of a muscle; one parameter set for each '
        'intensity and width that occurs.',
        'ConcurrentModalities': ['beh'],
        'IntendedFor': f'bids::{names.folder}/beh/{events}.tsv',
        'TaskName': names.task,
    }
    _write_json(visit / 'nibs' / f'{nibs}.json', sidecar | _NIBS_COLUMNS)


def _parameter_sets(pulses: PulseTrain) -> tuple[list[str], dict[str, Sequence[Any]]]:
    """Return the set of each pulse, and the columns of the sets: each intensity and width once."""
    known: dict[tuple[float, float], str] = {}
    labels = [
        known.setdefault(pair, f'pulse{len(known) + 1}')
        for pair in zip(pulses.intensity.tolist(), pulses.width.tolist(), strict=True)
    ]
    return labels, {
        'nibs_event_id': list(known.values()),
        'nibs_type': ['PNS'] * len(known),
        'stimulus_intensity': [_percent(intensity) for intensity, _ in known],
        'stimulus_duration': [width for _, width in known],
        'intensity_scaling': ['absolute'] * len(known),
    }


def _percent(share: float) -> str:
    """Return a share in per cent, moved by two decimal places: no digit changes."""
    return format(Decimal(repr(share)).scaleb(2), 'f')


def _write_force(path: Path, session: SessionExport) -> None:
    """Write the samples: BIDS wants them packed, and no header."""
    times = seconds_text(session.forces.stamp_ns, session.origin_ns)
    values = (_cell(value) for value in session.forces.force.tolist())
    lines = '\n'.join(f'{time}\t{value}' for time, value in zip(times, values, strict=True))
    # no time of writing inside: the same session gives the same file
    path.write_bytes(gzip.compress(f'{lines}\n'.encode(), mtime=0))


def _write_estimates(folder: Path, session: SessionExport, names: BidsNames, title: str) -> None:
    assert session.estimates is not None
    visit = folder / names.folder / 'beh'
    visit.mkdir(parents=True)
    _write_json(folder / _DESCRIPTION, _dataset(title, 'derivative'))
    columns = estimate_columns(session.estimates, session.origin_ns)
    _write_table(visit / f'{names.file("desc-estimates_timeseries")}.tsv', columns)


def _rate_hz(stamp_ns: IntArray) -> float:
    steps = np.diff(stamp_ns)
    period = float(np.median(steps)) if len(steps) else 0.0
    if not period > 0.0:
        raise RecordingError(
            f'expected force samples at a rate for BIDS, got {len(stamp_ns)} with a period of '
            f'{period:g} ns; --to csv takes any'
        )
    return NANOSECONDS_PER_SECOND / period


def _start(origin_ns: int) -> str:
    """Return when a session began, ``n/a`` if its clock does not tell."""
    whole, rest = divmod(origin_ns, NANOSECONDS_PER_SECOND)
    if whole < _EARLIEST_S:
        return 'n/a'
    return f'{datetime.fromtimestamp(whole, UTC):%Y-%m-%dT%H:%M:%S}.{rest // 1000:06d}Z'


def _cell(value: Any) -> str:
    """Return a cell of a table: ``n/a`` where there is nothing."""
    if isinstance(value, float) and not np.isfinite(value):
        return 'n/a' if np.isnan(value) else str(value)
    return repr(value) if isinstance(value, float) else str(value)


def _write_table(path: Path, columns: Mapping[str, Sequence[Any]]) -> None:
    rows = (map(_cell, row) for row in zip(*columns.values(), strict=True))
    lines = ['\t'.join(line) for line in (columns, *rows)]
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')


def _write_json(path: Path, document: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(document, allow_nan=False, indent=1), encoding='utf-8')


def _dataset(name: str, kind: str) -> dict[str, Any]:
    """Return the description of a dataset: ``raw`` or ``derivative``."""
    return {
        'Name': name,
        'BIDSVersion': _BIDS_VERSION,
        'DatasetType': kind,
        'GeneratedBy': [{'Name': 'rpms_ros', 'Version': __version__}],
    }


def _force_sidecar(session: SessionExport, task: str) -> dict[str, Any]:
    """Return the description of the force."""
    quantity = QUANTITIES[session.unit]
    when = 'Time of the sample after the first one, as it was stamped.'
    what = f'Isometric {quantity} of the stimulated muscle, positive for a pull.'
    return {
        'TaskName': task,
        'PhysioType': 'generic',
        'SamplingFrequency': _rate_hz(session.forces.stamp_ns),
        'StartTime': 0,
        'Columns': ['timestamp', quantity],
        'timestamp': {'Description': when, 'Units': 's'},
        quantity: {'Description': what, 'Units': session.unit},
        'RpmsRos': {key: value for key, value in session.facts().items() if key != 'notes'},
    }
