# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""When a basis is compared with others."""

import numpy as np

from rpms_ros.identification.estimation.basis_choice import BasisSchedule, Search

SECOND = 1_000_000_000


def comparisons(schedule: BasisSchedule, seconds: np.ndarray, alike: bool) -> dict[float, Search]:
    """Return the times at which it is due [s], and with which bases."""
    found = {one: schedule.due(round(one * SECOND), alike) for one in seconds.tolist()}
    return {one: search for one, search in found.items() if search is not None}


def test_a_basis_that_fits_is_compared_less_and_less_often() -> None:
    schedule = BasisSchedule()
    schedule.begin(0)
    found = comparisons(schedule, np.arange(0.0, 130.0, 0.25), alike=False)
    assert list(found) == [1.0, 3.0, 7.0, 16.0, 32.0, 64.0, 96.0, 128.0]
    assert set(list(found.values())[:4]) == {Search.EVERYWHERE}
    assert set(list(found.values())[4:]) == {Search.NEIGHBOURS}


def test_where_residuals_are_alike_it_is_compared_with_all_every_three_seconds() -> None:
    schedule = BasisSchedule()
    schedule.begin(0)
    found = comparisons(schedule, np.arange(40.0, 100.0, 0.25), alike=True)
    # the missed ones of the beginning first
    assert np.diff(list(found)).max() == 3.0
    assert set(found.values()) == {Search.EVERYWHERE}


def test_without_a_response_it_waits_for_stimulation() -> None:
    schedule = BasisSchedule()
    assert not comparisons(schedule, np.arange(0.0, 50.0), alike=True)
    onset_ns = SECOND * np.arange(50, 54, dtype=np.int64)
    schedule.add_pulses(onset_ns, np.array([0.0, 0.0, 0.4, 0.6]))
    found = comparisons(schedule, np.arange(50.0, 60.0, 0.25), alike=False)
    # two seconds after the first pulse that is not zero, and the first time then
    assert next(iter(found)) == 55.0
    assert not schedule.begun
    schedule.forget()
    assert not comparisons(schedule, np.arange(60.0, 100.0), alike=True)
