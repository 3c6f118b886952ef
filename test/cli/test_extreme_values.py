# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Numbers that no session has: a result, or a line that says why not.

Never a traceback, and no warning of a library between the lines.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import RecordingWriter, write_recording
from rpms_ros.recording.rosbag.definitions import PULSE, WRENCH_STAMPED
from rpms_ros.recording.rosbag.writing import encode_forces

Rpms = Callable[..., tuple[int, str, str]]
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


def recording_of(path: Path, name: str) -> Path:
    intensity, width, force = CASES[name]
    onset_ns = STAMP_NS[::50].copy()
    pulses = PulseTrain(onset_ns, intensity, np.arange(40, dtype=np.int64), width)
    write_recording(path, pulses, ForceTrace(STAMP_NS, force))
    return path


def refused_in_one_line(out: str, err: str) -> bool:
    return out == '' and err.startswith('rpms: error: expected ') and err.count('\n') == 1


@pytest.mark.long
@pytest.mark.parametrize('estimator', ['recursive', 'batch'])
@pytest.mark.parametrize('name', list(CASES))
def test_identify_ends_as_documented(
    rpms: Rpms, tmp_path: Path, name: str, estimator: str
) -> None:
    path = recording_of(tmp_path / 'bag', name)
    for options in ([], ['--json']):
        code, out, err = rpms('identify', path, '--estimator', estimator, *options)
        assert code in (0, 1, 2, 3)
        if code == 2:
            assert refused_in_one_line(out, err)
        elif options:
            assert 'NaN' not in out


def test_pulses_that_can_all_not_be_decoded_leave_a_verdict(rpms: Rpms, tmp_path: Path) -> None:
    path = tmp_path / 'bag'
    forces = encode_forces(ForceTrace(STAMP_NS, FORCE), (0.0, 0.0, 1.0))
    with RecordingWriter(path) as writer:
        pulse, force = (
            writer.add_topic('/pulses', PULSE),
            writer.add_topic('/force', WRENCH_STAMPED),
        )
        for index, time_ns in enumerate(STAMP_NS.tolist()):
            writer.append(force, time_ns, forces.message(index))
            writer.append(pulse, time_ns, b'\0\1\0\0')
    code, out, _ = rpms('identify', path, '--quiet')
    assert code == 3
    assert 'no: there is no pulse above intensity 0' in ' '.join(out.split())
