# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Identification of recordings."""

import math
import os
import subprocess
import sys
from collections.abc import Mapping

import numpy as np
import pytest

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import (
    BatchEstimator,
    Estimate,
    ModifiedRecursiveLM,
    StreamSettings,
    identify,
)
from rpms_ros.pulses import ForceTrace, PulseTrain

SECOND = 1_000_000_000


def joined(first: ForceTrace, second: ForceTrace) -> ForceTrace:
    return ForceTrace(
        np.concatenate((first.stamp_ns, second.stamp_ns)),
        np.concatenate((first.force, second.force)),
    )


@pytest.mark.parametrize('back', [2, 3600])
def test_pulses_after_a_jump_back_are_used(record, back: int) -> None:
    first_pulses, first = record(np.random.default_rng(7).uniform(size=240), 5000 * SECOND)
    start_ns = (5012 - back) * SECOND
    later_pulses, later = record(np.random.default_rng(8).uniform(size=240), start_ns)
    pulses = PulseTrain.joined([first_pulses, later_pulses])
    session = identify(ModifiedRecursiveLM(), pulses, joined(first, later))
    assert session.last.faults == {'clock_jump': 1, 'samples_excluded': 351}
    assert session.last.pulses == 480
    # some 4 N; a pulse that is missing leaves 1 N
    assert np.abs(session.force - session.prediction)[-8000:].max() < 0.2
    assert session.output_error.of_range < 0.02


@pytest.mark.parametrize('wrong_ns', [0, 9000 * SECOND])
def test_one_wrong_stamp_does_not_cost_the_rest(record, wrong_ns: int) -> None:
    pulses, forces = record(np.random.default_rng(7).uniform(size=240), 5000 * SECOND)
    forces.stamp_ns[6000] = wrong_ns
    session = identify(ModifiedRecursiveLM(), pulses, forces)
    assert session.last.faults == {'force_stamp_alone': 1}
    assert session.last.pulses == 240
    assert np.abs(session.force - session.prediction)[-5000:].max() < 0.2


@pytest.mark.parametrize(
    'force', [np.empty(0), np.full(3, math.nan)], ids=['empty', 'not a number']
)
def test_nothing_to_learn_from_is_refused(force: np.ndarray) -> None:
    forces = ForceTrace(np.arange(len(force)), force)
    with pytest.raises(IdentificationError, match='expected at least one finite force sample'):
        identify(ModifiedRecursiveLM(), PulseTrain.of([]), forces)


@pytest.mark.parametrize(
    ('force', 'found'),
    [([20e3, 27e3, 25e3], '3 samples from 20000 to 27000'), ([-3e4, math.nan], '1 sample from')],
)
def test_forces_that_no_muscle_has_are_named(force: list[float], found: str) -> None:
    forces = ForceTrace(np.arange(len(force)), np.array(force))
    with pytest.raises(IdentificationError, match=f'at most 10000 N or N m, got {found}.*-scale'):
        identify(ModifiedRecursiveLM(), PulseTrain.of([]), forces)


def test_the_batch_from_python_fits_once_for_the_whole_recording(
    record, monkeypatch: pytest.MonkeyPatch
) -> None:
    pulses, forces = record(np.random.default_rng(7).uniform(size=240))
    estimator = BatchEstimator()
    made: list[int] = []
    estimate = estimator.estimate

    def counted(stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        made.append(stamp_ns)
        return estimate(stamp_ns, faults)

    monkeypatch.setattr(estimator, 'estimate', counted)
    session = identify(estimator, pulses, forces)
    # not ten a second, which would take as long as the recording is squared
    assert made == [int(forces.stamp_ns[-1])]
    assert len(session.estimates) == 1


@pytest.mark.long
def test_the_output_error_does_not_depend_on_the_threads_of_blas() -> None:
    # Enough samples for BLAS to part the work.
    code = (
        'import numpy as np\n'
        'from rpms_ros.identification.session import IdentifiedSession\n'
        'noise = np.random.default_rng(1).standard_normal((2, 300_000))\n'
        'usable = np.ones(300_000, bool)\n'
        'session = IdentifiedSession([], np.arange(300_000) * 10**6, *noise, usable)\n'
        'print(repr(session.output_error.newton))\n'
    )
    errors = {
        subprocess.run(
            [sys.executable, '-c', code],
            env={**os.environ, 'OMP_NUM_THREADS': count, 'OPENBLAS_NUM_THREADS': count},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for count in ('1', '2', '3')
    }
    assert len(errors) == 1


def test_the_batch_has_room_for_the_fastest_sensor() -> None:
    pulses = PulseTrain.regular(np.random.default_rng(0).uniform(size=50), 20.0)
    force = np.random.default_rng(1).normal(size=250_000)
    trace = ForceTrace(np.arange(len(force), dtype=np.int64) * 10_000, force)
    chosen = StreamSettings(monitors=())
    assert 'force_queue_full' not in identify(BatchEstimator(), pulses, trace, chosen).last.faults
