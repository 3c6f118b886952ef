# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Signs of life of a sensor and of a process, and the lock of a device."""

import signal
import subprocess
import sys
from collections.abc import Callable

import pytest

from rpms_ros.stimulation.driver.authority import ProcessLife, host_identity
from rpms_ros.stimulation.driver.safety_monitor import SensorLife

SECOND = 1_000_000_000


def test_a_sample_that_repeats_its_stamp_is_no_sign_of_life() -> None:
    life = SensorLife('force_sensor', 0.2)
    assert life.refusal(1, 'force_sensor', 1) is None
    assert life.refusal(1, 'force_sensor', 2) == (
        'expected a force sample after the last one, got its stamp moved 0 ns'
    )
    assert life.refusal(2, 'force_sensor', 3) is None
    assert life.refusal(1, 'force_sensor', 4) is not None
    # from there on it counts again: a clock that was set back locks nothing for good
    assert life.refusal(2, 'force_sensor', 5) is None


def test_a_sample_of_a_foreign_frame_is_no_sign_of_life() -> None:
    life = SensorLife('force_sensor', 0.2)
    assert life.refusal(1, 'ankle', 1) == "expected force in frame 'force_sensor', got 'ankle'"


def test_a_sample_of_another_time_is_no_sign_of_life() -> None:
    life, now = SensorLife('force_sensor', 0.2), 1000 * SECOND
    refused = 'expected a force sample within 0.2 s of the time of the driver, got one of '
    assert life.refusal(now - 86400 * SECOND, 'force_sensor', now) == f'{refused}8.64e+04 s ago'
    assert life.refusal(now - SECOND // 4, 'force_sensor', now) == f'{refused}0.25 s ago'
    # one of tomorrow blocks none of today
    assert life.refusal(now + 86400 * SECOND, 'force_sensor', now) == f'{refused}-8.64e+04 s ago'
    assert life.refusal(now - SECOND // 5, 'force_sensor', now) is None


def test_the_end_of_a_process_is_seen(wait_for: Callable[..., None]) -> None:
    process = subprocess.Popen([sys.executable, '-S', '-c', 'input()'], stdin=subprocess.PIPE)
    life = ProcessLife(host_identity(), process.pid)
    assert life.known
    assert not life.ended
    process.kill()
    wait_for(lambda: life.ended)
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    life.close()
    assert not life.ended
    assert ProcessLife(host_identity(), process.pid).ended


@pytest.mark.parametrize(('host', 'process'), [('elsewhere', 1), ('', 1), (host_identity(), 0)])
def test_a_process_of_another_machine_is_not_known(host: str, process: int) -> None:
    life = ProcessLife(host, process)
    assert not life.known
    assert not life.ended
