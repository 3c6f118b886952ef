# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a file system, a running recorder and numbers that no session has do to the commands."""

import os
import shutil
import tempfile
import threading
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import RecordingWriter, read_facts, write_recording
from rpms_ros.recording.rosbag.definitions import PULSE, WRENCH_STAMPED
from rpms_ros.recording.rosbag.metadata import SUMS_NAME
from rpms_ros.recording.rosbag.writing import encode_forces

COMMANDS = ('info', 'verify', 'identify', 'analyze')
NOBODY = 65534


def test_names_cannot_break_the_line(rpms, short_session, tmp_path):
    for command in COMMANDS:
        code, out, err = rpms(command, tmp_path / 'a\nb\x1b[2J')
        assert (code, out) == (2, ''), command
        reason = f'rpms: error: expected a recording at {tmp_path}/a\\nb\\x1b[2J'
        assert (err.startswith(reason), err.count('\n')) == (True, 1), err
    path = tmp_path / 'c\nd\x1b[2J'
    shutil.copytree(short_session, path)
    os.truncate(path / 'short_0.mcap', 400_000)
    for command in COMMANDS[:3]:
        code, out, err = rpms(command, path)
        assert code == 1
        assert '\x1b' not in out + err
        assert 'c\nd' not in out + err


@contextmanager
def without_rights():
    """Be somebody who may read only what everybody may."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(NOBODY)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


@pytest.fixture
def public_folder():
    """A folder that every user may enter; pytest closes its own whenever another one starts."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


@pytest.mark.parametrize('part', ['', 'short_0.mcap', 'metadata.yaml', SUMS_NAME])
def test_what_may_not_be_read_is_named(rpms, short_session, public_folder, part):
    path = public_folder / 'bag'
    shutil.copytree(short_session, path)
    # What the commands import when they are first run may be in a folder of root's.
    for command in COMMANDS:
        rpms(command, path)
    (path / part).chmod(0)
    with without_rights():
        outcomes = [rpms(command, path) for command in COMMANDS]
    (path / part).chmod(0o755)
    for code, out, err in outcomes:
        assert code == (2 if part in ('', 'short_0.mcap') else 1)
        assert 'ermission denied' in ' '.join((out + err).split())


def test_a_recording_that_grows_is_read_up_to_where_it_is(rpms, tmp_path):
    path = tmp_path / 'bag'
    stamps = 10**18 + np.arange(100, dtype=np.int64) * 1_000_000
    records = encode_forces(ForceTrace(stamps, np.ones(100)), (0.0, 0.0, 1.0))
    writer = RecordingWriter(path)
    topic = writer.add_topic('/force', WRENCH_STAMPED)
    stopped = threading.Event()
    flushed = threading.Event()

    def write():
        while not stopped.is_set():
            for index in range(len(records)):
                writer.append(topic, int(stamps[index]), records.message(index))
            writer.flush()
            flushed.set()

    thread = threading.Thread(target=write)
    thread.start()
    assert flushed.wait(60.0)
    counts = []
    for _ in range(5):
        code, _, err = rpms('info', path)
        # Where it stood while it was read.
        assert (code, err) == (1, '')
        counts.append(read_facts(path).topics[0].count)
    stopped.set()
    thread.join()
    writer.close()
    assert counts == sorted(counts)
    facts = read_facts(path)
    assert facts.faults == {}
    assert facts.topics[0].count >= max(counts)


STAMP_NS = 10**18 + np.arange(2000, dtype=np.int64) * 1_000_000
INTENSITY = np.random.default_rng(1).random(40)
EVERY_OTHER = np.arange(40) % 2 == 1
WIDTH = np.full(40, 1e-4)
FORCE = np.sin(np.arange(2000.0))
ONE = np.eye(1, 2000, 500)[0]
CASES = {
    'no intensity': (INTENSITY * np.nan, WIDTH, FORCE),
    'half of the intensities': (np.where(EVERY_OTHER, np.nan, 0.7), WIDTH, FORCE),
    'infinite intensities': (np.full(40, np.inf), WIDTH, FORCE),
    'some infinite intensities': (np.where(INTENSITY > 0.9, -np.inf, INTENSITY), WIDTH, FORCE),
    'one huge intensity': (np.where(INTENSITY > 0.9, 1e300, INTENSITY), WIDTH, FORCE),
    'no width': (INTENSITY, WIDTH * np.nan, FORCE),
    'one huge force': (INTENSITY, WIDTH, FORCE + 1e155 * ONE),
    'one infinite force': (INTENSITY, WIDTH, np.where(ONE > 0.0, np.inf, FORCE)),
    'huge forces': (INTENSITY, WIDTH, FORCE * 1e155),
    'largest forces': (INTENSITY, WIDTH, FORCE * 1e308),
    'tiny forces': (INTENSITY, WIDTH, FORCE * 1e-310),
    'no force': (INTENSITY, WIDTH, FORCE * np.nan),
}


@pytest.mark.long
@pytest.mark.parametrize('estimator', ['recursive', 'batch'])
@pytest.mark.parametrize('name', list(CASES))
def test_identify_ends_as_documented(rpms, tmp_path, name, estimator):
    path, (intensity, width, force) = tmp_path / 'bag', CASES[name]
    pulses = PulseTrain.numbered(STAMP_NS[::50].copy(), intensity, width)
    write_recording(path, pulses, ForceTrace(STAMP_NS, force))
    for options in ([], ['--json']):
        code, out, err = rpms('identify', path, '--estimator', estimator, *options)
        assert code in (0, 1, 2, 3)
        if code == 2:
            assert out == ''
            assert err.startswith('rpms: error: expected ')
            assert err.count('\n') == 1
        elif options:
            assert 'NaN' not in out


def test_pulses_that_can_all_not_be_decoded_leave_a_verdict(rpms, tmp_path):
    path = tmp_path / 'bag'
    forces = encode_forces(ForceTrace(STAMP_NS, FORCE), (0.0, 0.0, 1.0))
    with RecordingWriter(path) as writer:
        pulse = writer.add_topic('/pulses', PULSE)
        force = writer.add_topic('/force', WRENCH_STAMPED)
        for index, time_ns in enumerate(STAMP_NS.tolist()):
            writer.append(force, time_ns, forces.message(index))
            writer.append(pulse, time_ns, b'\0\1\0\0')
    code, out, _ = rpms('identify', path, '--quiet')
    assert code == 3
    assert 'no: there is no pulse above intensity 0' in ' '.join(out.split())
