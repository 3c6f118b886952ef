# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One number says how good the predictions of a session were."""

import math

import numpy as np
import pytest

from rpms_ros.identification.session import output_error

MILLISECOND = 1_000_000


def session(seconds: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stamps, a slow sinusoid of 10 N that is near zero at its end, and usable flags."""
    stamp = np.arange(1000 * seconds, dtype=np.int64) * MILLISECOND
    force = 5.0 - 5.0 * np.cos(2.0 * np.pi * 1e-9 * stamp / 10.0)
    return stamp, force, np.ones(len(stamp), dtype=np.bool_)


def test_a_force_near_zero_at_the_end_does_not_matter() -> None:
    stamp, force, usable = session(40)
    error = output_error(stamp, force, force - 0.08, usable)
    assert error.newton == pytest.approx(0.08)
    # 0.08 N of a force that goes from 0 to 10 N
    assert error.of_range == pytest.approx(0.008)


@pytest.mark.parametrize(('seconds', 'settled'), [(40, 10), (12, 6)])
def test_what_is_wrong_before_settling_does_not_count(seconds: int, settled: int) -> None:
    stamp, force, usable = session(seconds)
    prediction = force + 0.1
    prediction[: 1000 * settled] = 1e3
    # One sample at the boundary: the middle lies half a sample before its index.
    assert output_error(stamp, force, prediction, usable).newton == pytest.approx(0.1)


def test_samples_that_are_not_usable_do_not_count() -> None:
    stamp, force, usable = session(40)
    prediction = force.copy()
    prediction[20_000:21_000] += 1.0
    usable[20_000:21_000] = False
    force[20_500] = 1e6
    assert output_error(stamp, force, prediction, usable) == (0.0, 0.0)


def test_a_clock_that_jumps_back_takes_no_time_off() -> None:
    stamp, force, usable = session(40)
    stamp[20_000:] -= 20_000_000_000
    prediction = force.copy()
    prediction[:9_000] += 1.0
    assert output_error(stamp, force, prediction, usable).newton == 0.0


def test_nothing_usable_has_no_error() -> None:
    stamp, force, usable = session(1)
    error = output_error(stamp, force, force, ~usable)
    assert math.isnan(error.newton)
    assert math.isnan(error.of_range)
