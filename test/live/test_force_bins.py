# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bins of the force: nothing is lost of its course, and stamps of anybody break nothing."""

import hypothesis.strategies as st
import numpy as np
from hypothesis import given

from rpms_ros.live.force_course import BIN_NS, KEPT, ForceBins

MILLISECOND = 1_000_000


def test_each_bin_has_the_smallest_and_largest_sample(start_ns):
    bins, force = ForceBins(), np.sin(np.arange(1000) / 20.0)
    for index, value in enumerate(force):
        bins.add(start_ns + index * MILLISECOND, float(value))
    low, high, modelled = bins.since(bins.oldest, bins.newest)
    parts = force[: 5 * len(low)].reshape(-1, 5)
    # start_ns is a multiple of the bin; comparisons and copies only, so equality is exact
    assert start_ns % BIN_NS == 0
    np.testing.assert_array_equal(low, parts.min(axis=1))
    np.testing.assert_array_equal(high, parts.max(axis=1))
    assert np.isnan(modelled).all()


def test_one_stray_stamp_changes_nothing_and_a_jump_of_the_clock_begins_anew(start_ns):
    bins = ForceBins()
    for index in range(10):
        bins.add(start_ns + index * BIN_NS, 1.0)
    bins.add(start_ns + 10**15, 5.0)
    bins.add(start_ns + 10 * BIN_NS, 1.0)
    assert (bins.stray, bins.epoch) == (1, 0)
    for index in range(10):
        bins.add(start_ns - 10**12 + index * BIN_NS, 2.0)
    assert bins.epoch == 1
    # the stamp from which on the clock is believed is the fifth
    assert bins.since(bins.oldest, bins.newest)[0].tolist() == [2.0] * 5


def test_a_slow_sensor_is_a_line_and_a_pause_a_hole(start_ns):
    """Of 100 Hz every other bin was a hole, and of such a line a browser drew nothing."""
    bins = ForceBins()
    for index in (*range(20), *range(40, 60)):
        bins.add(start_ns + index * 2 * BIN_NS, float(index))
    low, high, _ = bins.since(bins.oldest, bins.newest)
    np.testing.assert_array_equal(low[:39], np.arange(39) // 2)
    np.testing.assert_array_equal(low, high)
    assert np.isnan(low[39:80]).all()
    assert not np.isnan(low[80:]).any()


@given(
    st.lists(
        st.tuples(
            st.integers(-(2**31) * 10**9, 2**31 * 10**9),
            st.floats(allow_nan=True, allow_infinity=True),
        ),
        max_size=60,
    )
)
def test_whatever_comes_the_bins_stay_whole(samples):
    bins = ForceBins()
    for stamp_ns, force in samples:
        bins.add(stamp_ns, force)
        assert bins.oldest <= bins.newest + 1
        assert bins.newest - bins.oldest < KEPT
    if bins.newest >= bins.origin:
        low, high, _ = bins.since(bins.oldest, bins.newest)
        known = ~np.isnan(low)
        assert (low[known] <= high[known]).all()
        assert np.isfinite(high[known]).all()
