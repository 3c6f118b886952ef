# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Numbers that no session has: a result, or a line that says why not; never a traceback."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import PulseTrain
from rpms_ros.recording import write_recording

Rpms = Callable[..., tuple[int, str, str]]
STAMP_NS = 10**18 + np.arange(2000, dtype=np.int64) * 1_000_000
INTENSITY = np.random.default_rng(1).random(40)
WIDTH = np.full(40, 1e-4)
FORCE = np.sin(np.arange(2000.0))
ONE = np.eye(1, 2000, 500)[0]
CASES = {
    'no intensity': (INTENSITY * np.nan, WIDTH, FORCE),
    'one huge intensity': (np.where(INTENSITY > 0.9, 1e300, INTENSITY), WIDTH, FORCE),
    'no width': (INTENSITY, WIDTH * np.nan, FORCE),
    'one huge force': (INTENSITY, WIDTH, FORCE + 1e155 * ONE),
    'huge forces': (INTENSITY, WIDTH, FORCE * 1e155),
    'tiny forces': (INTENSITY, WIDTH, FORCE * 1e-310),
    'no force': (INTENSITY, WIDTH, FORCE * np.nan),
}


@pytest.mark.filterwarnings('ignore::RuntimeWarning')
@pytest.mark.parametrize('estimator', ['recursive', 'batch'])
@pytest.mark.parametrize('name', list(CASES))
def test_identify_ends_as_documented(
    rpms: Rpms, tmp_path: Path, name: str, estimator: str
) -> None:
    intensity, width, force = CASES[name]
    onset_ns = STAMP_NS[::50].copy()
    pulses = PulseTrain(onset_ns, intensity, np.arange(40, dtype=np.int64), width)
    write_recording(tmp_path / 'bag', pulses, ForceTrace(STAMP_NS, force))
    for options in ([], ['--json']):
        command = ('identify', tmp_path / 'bag', '--estimator', estimator, *options)
        code, out, err = rpms(*command)
        assert code in (0, 1, 2, 3)
        if code == 2:
            assert out == ''
            assert err.startswith('rpms: error: expected ')
            assert err.count('\n') == 1
        elif options:
            assert 'NaN' not in out
