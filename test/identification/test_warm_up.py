# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""After the warm-up nothing is left to compile while a session is identified."""

import subprocess
import sys

import pytest

from rpms_ros.identification import Estimator, estimator_by_name
from rpms_ros.identification.warm_up import warm_up

# What Python calls has a signature when it has been compiled, or loaded from the cache.
PROGRAM = """
import gc
import os
import sys
from numba.core.dispatcher import Dispatcher
from rpms_ros.identification import estimator_by_name, identify
from rpms_ros.identification.warm_up import warm_up
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import ForceTrace, PulseTrain
import numpy as np

def ready():
    return {
        (one.py_func.__module__, one.py_func.__qualname__, one.signatures[0])
        for one in gc.get_objects() if isinstance(one, Dispatcher) and one.signatures
    }

generator = np.random.default_rng(3)
pulses = PulseTrain.regular(generator.uniform(0.0, 1.0, 500), 20.0)
muscle = Contraction(simulation_subject(), fixed_rate_hz=20.0)
muscle.add_pulses(pulses.onset_ns, pulses.intensity)
stamps = np.arange(6250) * 4_000_000
force = muscle.force(stamps) + 0.02 * generator.standard_normal(len(stamps))
# the whole warm-up, as if nothing had been compiled here; numba has read its own copy
os.environ.pop('NUMBA_CACHE_DIR')
warm_up(lambda: estimator_by_name(sys.argv[1]))
before = ready()
identify(estimator_by_name(sys.argv[1]), pulses, ForceTrace(stamps, force))
print(sorted(f'{module}.{name}' for module, name, _ in ready() - before))
"""


@pytest.mark.long
def test_nothing_is_left_to_compile():
    """A muscle that changes runs other code."""
    answer = subprocess.run(
        [sys.executable, '-c', PROGRAM, 'tracking'], capture_output=True, text=True, check=True
    )
    assert answer.stdout == '[]\n'


def test_what_is_slow_is_done_once_on_a_machine(tmp_path, monkeypatch):
    built: list[Estimator] = []
    told: list[int] = []

    def build() -> Estimator:
        built.append(estimator_by_name('recursive'))
        return built[-1]

    # numba has read its own copy of the variable already
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path))

    def tell() -> None:
        told.append(len(built))

    warm_up(build, tell)
    assert len(built) == 2
    (marker,) = tmp_path.iterdir()
    assert marker.name.startswith('compiled-')
    warm_up(build, tell)
    assert len(built) == 3
    monkeypatch.delenv('NUMBA_CACHE_DIR')
    warm_up(build, tell)
    assert len(built) == 5
    # before it, and only where something is compiled
    assert told == [1, 4]
