# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a file system and a running recorder do to the commands: a line and an exit code."""

import os
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from rpms_ros.pulses import ForceTrace
from rpms_ros.recording import RecordingWriter, read_facts
from rpms_ros.recording.rosbag.definitions import WRENCH_STAMPED
from rpms_ros.recording.rosbag.metadata import SUMS_NAME
from rpms_ros.recording.rosbag.writing import encode_forces

Rpms = Callable[..., tuple[int, str, str]]
COMMANDS = ('info', 'verify', 'identify', 'analyze')
NOBODY = 65534


def refused(rpms: Rpms, path: Path, reason: str) -> None:
    """Every command says in one line why it cannot read this."""
    for command in COMMANDS:
        code, out, err = rpms(command, path)
        assert (code, out) == (2, ''), command
        assert err.startswith(f'rpms: error: {reason}'), err
        assert err.count('\n') == 1


def test_names_cannot_break_the_line(rpms: Rpms, short_session: Path, tmp_path: Path) -> None:
    refused(rpms, tmp_path / 'a\nb\x1b[2J', f'expected a recording at {tmp_path}/a\\nb\\x1b[2J')
    path = tmp_path / 'c\nd\x1b[2J'
    shutil.copytree(short_session, path)
    os.truncate(path / 'short_0.mcap', 400_000)
    for command in COMMANDS[:3]:
        code, out, err = rpms(command, path)
        assert code == 1
        assert '\x1b' not in out + err
        assert 'c\nd' not in out + err


@contextmanager
def without_rights() -> Iterator[None]:
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
def public_folder() -> Iterator[Path]:
    """A folder that every user may enter; pytest closes its own whenever another one starts."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


@pytest.mark.parametrize('part', ['', 'short_0.mcap', 'metadata.yaml', SUMS_NAME])
def test_what_may_not_be_read_is_named(
    rpms: Rpms, short_session: Path, public_folder: Path, part: str
) -> None:
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


def test_a_recording_that_grows_is_read_up_to_where_it_is(rpms: Rpms, tmp_path: Path) -> None:
    path = tmp_path / 'bag'
    stamps = 10**18 + np.arange(100, dtype=np.int64) * 1_000_000
    records = encode_forces(ForceTrace(stamps, np.ones(100)), (0.0, 0.0, 1.0))
    writer = RecordingWriter(path)
    topic = writer.add_topic('/force', WRENCH_STAMPED)
    stopped = threading.Event()
    flushed = threading.Event()

    def write() -> None:
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
