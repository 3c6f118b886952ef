# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses of a recording beside those that an audit log says a driver gave."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.errors import StimulationError
from rpms_ros.printable import counted
from rpms_ros.pulses import PulseTrain
from rpms_ros.stimulation.audit_log import verify
from rpms_ros.stimulation.pulse_hash import HashedPulses
from rpms_ros.stimulation.pulse_hash import hash_of


def audited(path: Path) -> tuple[list[HashedPulses], str]:
    """Return the runs of pulses in an audit log, and what is wrong with its chain, if anything.

    Raises
    ------
    RecordingError
        If there is no audit log.
    """
    if not path.is_file():
        raise RecordingError(f'expected an audit log, got {path}')
    try:
        log = verify(path)
    except (OSError, StimulationError) as error:
        raise RecordingError(f'expected an audit log, got {path}: {error}') from error
    runs = []
    for record in log.records:
        count, first_ns = record.content.get('pulses'), record.content.get('first_pulse_ns')
        digest = record.content.get('pulses_sha256')
        if not (isinstance(count, int) and isinstance(first_ns, int) and count > 0):
            continue
        if isinstance(digest, str):
            runs.append(HashedPulses(count, first_ns, digest))
    return runs, log.fault


def differences(pulses: PulseTrain, runs: list[HashedPulses]) -> Iterator[str]:
    """Yield a line for each run that is in the recording and is not what the driver gave."""
    for run in runs:
        begins = np.flatnonzero(pulses.onset_ns == run.first_ns)
        for begin in begins[:1].tolist():
            part = pulses[slice(begin, begin + run.count)]
            if hash_of(part) != run.sha256:
                found = f'{counted(run.count, "pulse")} from stamp {run.first_ns} on'
                yield f'{found}: not what the driver gave'


def covered(pulses: PulseTrain, runs: list[HashedPulses]) -> int:
    """Return how many pulses of the recording belong to a run of the audit log."""
    known = np.zeros(len(pulses), np.bool_)
    for run in runs:
        for begin in np.flatnonzero(pulses.onset_ns == run.first_ns)[:1].tolist():
            known[begin : begin + run.count] = True
    return int(known.sum())
