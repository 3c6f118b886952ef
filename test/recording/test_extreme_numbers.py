# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Numbers that no measurement has: read or refused in words, without a warning of a library."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing import Ambiguous, ImportOptions, import_file, read_csv

COUNT = 200


@pytest.fixture
def columns() -> dict[str, np.ndarray]:
    time = np.arange(COUNT) / 1000.0
    gate = np.where(np.arange(COUNT) % 50 - 10 < 3, 5.0, 0.0)
    return {'time': time, 'force': 2.0 + np.sin(30.0 * time), 'gate': gate}


@pytest.mark.long
@pytest.mark.parametrize('value', [np.inf, np.nan, 1e308, 1e-310])
@pytest.mark.parametrize('column', ['time', 'force', 'gate'])
@pytest.mark.parametrize('count', [2, COUNT])
def test_numbers_that_cannot_be_are_read_or_refused(
    tmp_path: Path, columns: dict[str, np.ndarray], column: str, value: float, count: int
) -> None:
    columns[column][:count:2] = value
    columns[column][1:count:4] = -value
    savemat(tmp_path / 'trial.mat', columns)
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(tmp_path / 'trial.csv', table, delimiter=',', header='time,force,gate', comments='')
    names: dict[str, Any] = dict(zip(('time', 'force', 'pulse'), columns, strict=True))
    for path in (tmp_path / 'trial.mat', tmp_path / 'trial.csv'):
        for given in ({}, names):
            with suppress(RecordingError, Ambiguous):
                import_file(path, ImportOptions(**given))
    with suppress(RecordingError):
        read_csv(tmp_path / 'trial.csv', *columns)
