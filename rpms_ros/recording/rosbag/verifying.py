# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a recording is whole and unchanged, one line a finding.

What is odd in its numbers is told by `rpms identify`.  With an audit log also whether the pulses
are those that the driver gave.
"""

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rpms_ros.errors import RecordingError, StimulationError
from rpms_ros.identification.stream.arrivals import no_overlap
from rpms_ros.printable import counted, printable
from rpms_ros.pulses import hash_of
from rpms_ros.recording.rosbag.metadata import SUMS_NAME, fits, read_checksums
from rpms_ros.recording.rosbag.reading import (
    DAMAGE,
    Recording,
    RecordingFacts,
    read_facts,
    read_recording,
    session_hash,
)
from rpms_ros.stimulation.records.append_only import verify_log

OK, FAULT, UNKNOWN = 'ok', 'FAULT', 'unknown'
PUBLISHERS_KEY = 'publishers'
"""Name in `custom_data` under which a recorder notes how many publishers a topic had."""
LOST_KEY = 'lost_messages'
"""Name in `custom_data` under which a recorder notes what came and was not kept."""


@dataclass(frozen=True)
class Finding:
    """What one check found.

    Attributes
    ----------
    check : str
        What was looked at, such as ``checksums``.
    state : str
        ``ok``, ``FAULT``, or ``unknown`` where the recording does not tell.
    text : str
        One line for people.
    """

    check: str
    state: str
    text: str


def _found(check: str, faults: Iterable[str], well: str) -> list[Finding]:
    """Return a finding for each fault, or that there is none."""
    found = [Finding(check, FAULT, printable(text)) for text in faults]
    return found or [Finding(check, OK, printable(well))]


def verify(
    path: Path,
    read: Callable[[], Recording] | None = None,
    memory: int | None = None,
    audit: Path | None = None,
) -> list[Finding]:
    """Return what every check found, at least one finding a check.

    Parameters
    ----------
    path : Path
        Folder or storage file.
    read : callable, optional
        Returns its pulses and force; `read_recording` does if it is not given.
    memory : int, optional
        What reading may take, as of `read_recording` [bytes].
    audit : Path, optional
        Audit log of the driver that gave the pulses.

    Raises
    ------
    RecordingError
        If there is nothing that could be read.
    """
    facts = read_facts(path, memory=memory)
    count = sum(topic.count for topic in facts.topics)
    structure = f'{count} messages on {len(facts.topics)} topics, {facts.storage}'
    findings = _found('structure', facts.remarks, structure)
    findings += _checksums(path if path.is_dir() else path.parent, facts)
    several, lost = '{topic} had {count} publishers', '{count} messages of {topic} were lost'
    findings += _noted(facts, 'publishers', PUBLISHERS_KEY, 1, several, 'one for each topic')
    findings += _noted(facts, 'lost', LOST_KEY, 0, lost, 'the recorder tells of nothing')
    # a text that does not fit its hash is among the remarks already
    findings += [Finding('schedule', OK, str(one)) for one in facts.schedules] or [
        Finding('schedule', UNKNOWN, 'the recording does not tell')
    ]
    try:
        recording = read() if read else read_recording(path, memory=memory)
    except RecordingError as error:
        return [*findings, Finding('session', FAULT, printable(str(error)))]
    new = (text for text in recording.facts.remarks if text not in facts.remarks)
    findings += [Finding('session', FAULT, text) for text in new]
    apart = no_overlap(recording.pulses.onset_ns, recording.forces.stamp_ns)
    findings += [] if apart is None else [Finding('clock', FAULT, apart)]
    if audit is not None:
        findings += _audit(recording, audit)
    digest = session_hash(recording)
    damaged = DAMAGE & facts.faults.keys()
    digest += ' of what could be read, not of all that was recorded' if damaged else ''
    return [*findings, Finding('hash', FAULT if damaged else OK, digest)]


def _checksums(folder: Path, facts: RecordingFacts) -> list[Finding]:
    try:
        sums = read_checksums(folder)
    except (OSError, RecordingError) as error:
        return _found('checksums', [str(error)], '')
    if sums is None:
        return [Finding('checksums', UNKNOWN, f'there is no {SUMS_NAME}')]
    wrong = [
        f'{name} is missing, cannot be read or is not what was written'
        for name, digest in sums.items()
        if not fits(folder / name, digest)
    ]
    unlisted = sorted(set(facts.files) - sums.keys())
    wrong += [f'{name} is not listed in {SUMS_NAME}' for name in unlisted]
    return _found('checksums', wrong, f'SHA-256 of {", ".join(sums)}')


def _noted(
    facts: RecordingFacts, check: str, key: str, usual: int, fault: str, well: str
) -> list[Finding]:
    """Return a finding for each topic of which the recorder counted more than is usual."""
    try:
        counts = {str(topic): int(n) for topic, n in json.loads(facts.custom[key]).items()}
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError):
        return [Finding(check, UNKNOWN, 'the recording does not tell')]
    said = (fault.format(topic=topic, count=n) for topic, n in counts.items() if n > usual)
    return _found(check, said, well)


def _audit(recording: Recording, path: Path) -> Iterator[Finding]:
    """Compare pulses and schedules with those that the driver wrote down in its audit log."""
    if not path.is_file():
        raise RecordingError(f'expected an audit log, got {path}')
    try:
        log = verify_log(path)
    except (OSError, StimulationError) as error:
        raise RecordingError(f'expected an audit log, got {path}: {error}') from error
    pulses = recording.pulses
    known = np.zeros(len(pulses), np.bool_)
    logged = {record.content.get('text_sha256') for record in log.records}
    wrong = [
        f'the log has no schedule {one.name} of sha256 {one.sha256}'
        for one in recording.facts.schedules
        if one.sha256 not in logged
    ]
    for record in log.records:
        length, first_ns = record.content.get('pulses'), record.content.get('first_pulse_ns')
        digest = record.content.get('pulses_sha256')
        if not (isinstance(length, int) and isinstance(first_ns, int) and length > 0):
            continue
        for begin in np.flatnonzero(pulses.onset_ns == first_ns)[:1].tolist():
            if isinstance(digest, str):
                run = slice(begin, begin + length)
                known[run] = True
                if hash_of(pulses[run]) != digest:
                    found = f'{counted(length, "pulse")} from stamp {first_ns} on'
                    wrong.append(f'{found}: not what the driver gave')
    wrong += [f'chain of the log: {log.fault}'] * bool(log.fault)
    wrong += [f'the log is cut off: {log.torn} bytes at its end'] * bool(log.torn)
    yield from (Finding('audit', FAULT, printable(text)) for text in wrong)
    if not known.all():
        text = f'the log has {known.sum()} of {counted(len(pulses), "pulse")}'
        yield Finding('audit', FAULT, text)
    elif not wrong:
        yield Finding('audit', OK, f'{counted(len(pulses), "pulse")} as the driver gave them')
