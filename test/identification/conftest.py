# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of simulated muscles, made once."""

from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from rpms_ros.identification import Estimate
from rpms_ros.identification.analysis.responses import Response
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import FloatArray, ForceTrace, PulseTrain

MILLISECOND = 1_000_000
GATE_VOLTS = 4.0
Record = Callable[..., tuple[PulseTrain, ForceTrace]]


@pytest.fixture(scope='session')
def record() -> Record:
    """Force of the simulated subject at 1 kHz for intensities at 20 Hz."""

    def simulate(
        intensity: FloatArray, start_ns: int = 0, sequence: int = 0
    ) -> tuple[PulseTrain, ForceTrace]:
        pulses = PulseTrain.regular(intensity, 20.0, start_ns)
        muscle = Contraction(simulation_subject())
        muscle.add_pulses(pulses.onset_ns, pulses.intensity)
        stamps = start_ns + MILLISECOND * np.arange(50 * len(intensity), dtype=np.int64)
        pulses.sequence[:] = (pulses.sequence + sequence) % 2**32
        return pulses, ForceTrace(stamps, muscle.force(stamps))

    return simulate


@pytest.fixture(scope='session')
def recorded(living_sessions) -> Callable[..., Any]:
    """Record a muscle at 1 kHz under random or given intensities, with noise and a rest after."""
    return living_sessions.recorded


@pytest.fixture(scope='session')
def images() -> Callable[[Sequence[Estimate]], list[list[bytes]]]:
    """Every field of estimates in every bit, the order of faults included."""

    def of(estimates: Sequence[Estimate]) -> list[list[bytes]]:
        return [
            [
                repr(one).encode() if isinstance(one, dict | tuple) else np.asarray(one).tobytes()
                for one in vars(estimate).values()
            ]
            for estimate in estimates
        ]

    return of


@pytest.fixture(scope='session')
def numpy_recursion(module_at) -> ModuleType:
    """The plain version of the recursion, which stands beside the benchmarks."""
    return module_at(Path(__file__).parents[2] / 'bench' / 'numpy_recursion.py')


@pytest.fixture(scope='session')
def rat_train() -> Callable[..., Response]:
    """The train in a trial of the rat, by the path of its file, and every so many samples."""

    def read(path: Path, step: int = 1) -> Response:
        time, _, gate, force = np.loadtxt(path, delimiter=',', skiprows=1, usecols=range(4)).T
        high = gate > GATE_VOLTS
        onset = time[1:][high[1:] & ~high[:-1]]
        part = np.flatnonzero((time >= onset[0] - 0.05) & (time < onset[-1] + 0.5))[::step]
        usable = np.ones(len(part), dtype=np.bool_)
        return Response(
            onset - onset[0], time[part] - onset[0], force[part], usable, np.nan, np.nan
        )

    return read


@pytest.fixture(scope='session')
def living_sessions(beside) -> ModuleType:
    """The module of sessions in the folder of all tests: `session`, `recorded`, `SUBJECT`."""
    return beside('living_sessions')


@pytest.fixture(scope='session')
def league(module_at) -> ModuleType:
    """Muscles of other kinds than the model's: `session`."""
    return module_at(Path(__file__).parents[2] / 'bench' / 'league.py')
