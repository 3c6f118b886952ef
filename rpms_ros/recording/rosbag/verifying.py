# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Everything about a recording that can be checked, one line a finding.

Pulses of a recording beside those that an audit log says a driver gave.
"""

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rpms_ros.errors import RecordingError, StimulationError
from rpms_ros.identification.stream.pulse_checks import no_overlap, outside_shares, range_outside
from rpms_ros.printable import counted, printable
from rpms_ros.pulses import HashedPulses, IntArray, PulseTrain, hash_of
from rpms_ros.recording.rosbag.checksums import SUMS_NAME, read_checksums, sha256, signature_fits
from rpms_ros.recording.rosbag.reading import (
    DAMAGE,
    Recording,
    RecordingFacts,
    Topics,
    read_facts,
    read_recording,
    session_hash,
)
from rpms_ros.stimulation.records.audit_log import verify_log


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
        log = verify_log(path)
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


OK, FAULT, UNKNOWN = 'ok', 'FAULT', 'unknown'
PUBLISHERS_KEY = 'publishers'
"""Name in `custom_data` under which a recorder notes how many publishers a topic had."""
LOST_KEY = 'lost_messages'
"""Name in `custom_data` under which a recorder notes what came and was not kept."""
# Longer steps between stamps are gaps: more than jitter makes of one sampling interval.
_LONGEST_STEP = 1.75
_SEQUENCES = 2**32


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


def verify(
    path: Path,
    topics: Topics | None = None,
    key: bytes | None = None,
    memory: int | None = None,
    audit: Path | None = None,
) -> list[Finding]:
    """Return what every check found, at least one finding a check.

    Parameters
    ----------
    path : Path
        Folder or storage file.
    topics : Topics, optional
        Names of the topics.
    key : bytes, optional
        What the recording must have been signed with.
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
    findings = [*_structure(facts), *_checksums(path, facts), _signature(path, key)]
    findings += [*_publishers(facts), *_schedules(facts)]
    try:
        recording = read_recording(path, topics, memory=memory)
    except RecordingError as error:
        return [*findings, Finding('session', FAULT, printable(str(error)))]
    seen = set(facts.remarks)
    findings += [
        Finding('session', FAULT, text) for text in recording.facts.remarks if text not in seen
    ]
    findings += [*_clock(recording), *_gaps(recording), *_lost(facts)]
    findings += [*_doubles(recording), *_values(recording)]
    if audit is not None:
        findings += _audit(recording, audit)
    if DAMAGE & facts.faults.keys():
        text = f'{session_hash(recording)} of what could be read, not of all that was recorded'
        return [*findings, Finding('hash', FAULT, text)]
    return [*findings, Finding('hash', OK, session_hash(recording))]


def _structure(facts: RecordingFacts) -> list[Finding]:
    """Faults of files, records and counts; damage in a chunk of mcap is found here too."""
    count = sum(topic.count for topic in facts.topics)
    text = f'{count} messages on {len(facts.topics)} topics, {facts.storage}'
    return [Finding('structure', FAULT, remark) for remark in facts.remarks] or [
        Finding('structure', OK, text)
    ]


def _checksums(path: Path, facts: RecordingFacts) -> Iterator[Finding]:
    folder = path if path.is_dir() else path.parent
    try:
        sums = read_checksums(folder)
    except (OSError, RecordingError) as error:
        yield Finding('checksums', FAULT, printable(str(error)))
        return
    if sums is None:
        yield Finding('checksums', UNKNOWN, f'there is no {SUMS_NAME}')
        return
    wrong = [name for name, digest in sums.items() if not _fits(folder / name, digest)]
    for name in wrong:
        text = f'{name} is missing, cannot be read or is not what was written'
        yield Finding('checksums', FAULT, printable(text))
    for name in sorted(set(facts.files) - sums.keys()):
        yield Finding('checksums', FAULT, printable(f'{name} is not listed in {SUMS_NAME}'))
    if not wrong:
        yield Finding('checksums', OK, f'SHA-256 of {", ".join(sums)}')


def _fits(path: Path, digest: str) -> bool:
    try:
        return path.is_file() and sha256(path) == digest
    except OSError:
        return False


def _signature(path: Path, key: bytes | None) -> Finding:
    folder = path if path.is_dir() else path.parent
    try:
        fits = signature_fits(folder, key or b'')
    except (OSError, RecordingError) as error:
        return Finding('signature', FAULT, printable(str(error)))
    if key is None:
        text = 'not signed' if fits is None else 'signed; --key checks it'
        return Finding('signature', UNKNOWN, text)
    if fits is None:
        return Finding('signature', FAULT, 'expected a signature, got none')
    if not fits:
        return Finding('signature', FAULT, 'not made with the key')
    return Finding('signature', OK, 'made with the key')


def _publishers(facts: RecordingFacts) -> list[Finding]:
    try:
        counts = json.loads(facts.custom[PUBLISHERS_KEY])
        several = {str(topic): int(count) for topic, count in counts.items() if int(count) > 1}
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError):
        return [Finding('publishers', UNKNOWN, 'the recording does not tell')]
    return [
        Finding('publishers', FAULT, printable(f'{topic} had {count} publishers'))
        for topic, count in several.items()
    ] or [Finding('publishers', OK, 'one for each topic')]


def _schedules(facts: RecordingFacts) -> list[Finding]:
    """Say what was accepted; a text that does not fit its hash is among the remarks already."""
    return [Finding('schedule', OK, str(one)) for one in facts.schedules] or [
        Finding('schedule', UNKNOWN, 'the recording does not tell')
    ]


def _audit(recording: Recording, path: Path) -> Iterator[Finding]:
    """Compare the pulses with those that the driver wrote down."""
    runs, fault = audited(path)
    wrong = [*differences(recording.pulses, runs), *([f'chain of the log: {fault}'] * bool(fault))]
    for text in wrong:
        yield Finding('audit', FAULT, printable(text))
    count, known = len(recording.pulses), covered(recording.pulses, runs)
    if known < count:
        text = f'the log has {known} of {counted(count, "pulse")}'
        yield Finding('audit', FAULT if known else UNKNOWN, text)
    elif not wrong:
        yield Finding('audit', OK, f'{counted(count, "pulse")} as the driver gave them')


def _clock(recording: Recording) -> list[Finding]:
    columns = {
        'the clock of the recorder (pulses)': recording.pulse_received_ns,
        'the clock of the recorder (force)': recording.force_received_ns,
        'the stamps of the pulses': recording.pulses.onset_ns,
        'the stamps of the force': recording.forces.stamp_ns,
    }
    findings = []
    for name, times in columns.items():
        steps = np.diff(times)
        if back := int(np.count_nonzero(steps < 0)):
            furthest = -float(steps.min()) * 1e-9
            text = f'{name}: {counted(back, "step")} back, the furthest by {furthest:.6g} s'
            findings.append(Finding('clock', FAULT, text))
    apart = no_overlap(recording.pulses.onset_ns, recording.forces.stamp_ns)
    if apart is not None:
        findings.append(Finding('clock', FAULT, apart))
    return findings or [Finding('clock', OK, 'no step back')]


def _lost(facts: RecordingFacts) -> Iterator[Finding]:
    """Say what the recorder did not keep, by its own count."""
    with suppress(AttributeError, KeyError, TypeError, ValueError, RecursionError):
        for topic, count in json.loads(facts.custom[LOST_KEY]).items():
            yield Finding('gaps', FAULT, printable(f'{int(count)} messages of {topic} were lost'))


def _gaps(recording: Recording) -> Iterator[Finding]:
    rising = np.diff(recording.forces.stamp_ns)
    rising = rising[rising > 0]
    interval = float(np.median(rising)) if len(rising) else 0.0
    gaps = rising[rising > _LONGEST_STEP * interval]
    if len(gaps):
        missing = int(np.sum(np.rint(gaps / interval) - 1))
        text = f'{counted(len(gaps), "gap")} in the force, about {counted(missing, "sample")} '
        yield Finding('gaps', FAULT, f'{text}missing, the longest {gaps.max() * 1e-9:.6g} s')
    steps = _steps(recording.pulses.sequence)
    lost = int(np.sum(steps[(steps > 1) & (steps < _SEQUENCES // 2)] - 1))
    if lost:
        are = 'is' if lost == 1 else 'are'
        text = f'{counted(lost, "pulse")} {are} missing in their numbering'
        yield Finding('gaps', FAULT, text)
    if not len(gaps) and not lost:
        yield Finding(
            'gaps', OK, f'none in the force every {interval * 1e-6:.6g} ms nor in pulses'
        )


def _steps(sequence: IntArray) -> IntArray:
    """Return the steps of the numbering of pulses, which wraps at 2^32."""
    steps: IntArray = np.diff(sequence) % _SEQUENCES
    return steps


def _doubles(recording: Recording) -> Iterator[Finding]:
    counts = {
        ('force sample', 'the stamp of another'): _repeated(recording.forces.stamp_ns),
        ('pulse', 'the stamp of another'): _repeated(recording.pulses.onset_ns),
        ('pulse', 'the number of the one before'): int(
            np.count_nonzero(_steps(recording.pulses.sequence) == 0)
        ),
    }
    for (one, what), count in counts.items():
        if count:
            yield Finding('doubles', FAULT, f'{counted(count, one)} with {what}')
    if not any(counts.values()):
        yield Finding('doubles', OK, 'none')


def _repeated(values: IntArray) -> int:
    return len(values) - len(np.unique(values))


def _values(recording: Recording) -> Iterator[Finding]:
    pulses, force = recording.pulses, recording.forces.force
    no_force = int(np.count_nonzero(~np.isfinite(force)))
    no_share = int(np.count_nonzero(outside_shares(pulses.intensity)))
    no_time = int(np.count_nonzero(~(np.isfinite(pulses.width) & (pulses.width > 0))))
    if no_force:
        text = f'{counted(no_force, "force")}: no finite number'
        yield Finding('values', FAULT, text)
    if no_share:
        text = counted(no_share, 'intensity', 'intensities')
        where = range_outside(pulses.intensity)
        yield Finding('values', FAULT, f'{text} outside 0 to 1, {where}')
    if no_time:
        yield Finding('values', FAULT, f'{counted(no_time, "width")}: no time')
    if not (no_force or no_share or no_time):
        yield Finding('values', OK, 'finite, intensities from 0 to 1')
