# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether pulses and force overlap in time, and intensities are shares of the maximum."""

import numpy as np

from rpms_ros.identification.model.estimate import SMALLEST_INTENSITY_SPAN, recruiting_range
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray, PulseTrain

# Above a rounding error or an offset of shares, up to the maximum in per cent.
_PERCENT = (2.0, 100.0)


def no_overlap(onset_ns: IntArray, stamp_ns: IntArray) -> str | None:
    """Return a sentence if no pulse lies in the time of the force; None if they overlap.

    Parameters
    ----------
    onset_ns : ndarray of int64 (pulses,)
        Onsets of the pulses, in any order [ns].
    stamp_ns : ndarray of int64 (samples,)
        Stamps of the force, in any order [ns].
    """
    if not len(onset_ns) or not len(stamp_ns):
        return None
    pulses = int(onset_ns.min()), int(onset_ns.max())
    force = int(stamp_ns.min()), int(stamp_ns.max())
    if pulses[0] <= force[1] and force[0] <= pulses[1]:
        return None
    # people compare seconds more easily than nanoseconds since 1970
    first = min(pulses[0], force[0])
    spans = [
        f'{(begin - first) / NANOSECONDS_PER_SECOND:.1f} s to '
        f'{(end - first) / NANOSECONDS_PER_SECOND:.1f} s'
        for begin, end in (pulses, force)
    ]
    return f'pulses are from {spans[0]}, force from {spans[1]}: they do not overlap'


def outside_shares(intensity: FloatArray) -> BoolArray:
    """Return which intensities (pulses,) are no share of the maximum, NaN included."""
    outside: BoolArray = ~((intensity >= 0.0) & (intensity <= 1.0))
    return outside


def range_outside(intensity: FloatArray) -> str:
    """Return the range of the intensities (pulses,) outside 0 to 1, with a guess at their unit."""
    wrong = intensity[outside_shares(intensity) & np.isfinite(intensity)]
    if not len(wrong):
        return 'not finite'
    low, high = float(wrong.min()), float(wrong.max())
    if low > 0.0 and _PERCENT[0] < high <= _PERCENT[1]:
        return f'up to {high:.3g}: percent?'
    return f'{low:.3g}' if low == high else f'from {low:.3g} to {high:.3g}'


def of_one_intensity(pulses: PulseTrain, stamp_ns: IntArray) -> bool:
    """Return whether the pulses in the time of the force have nearly one intensity above 0.

    Parameters
    ----------
    pulses : PulseTrain
        Pulses; those with an intensity outside 0 to 1 are not used, and do not count.
    stamp_ns : ndarray of int64 (samples,)
        Stamps of the force, in any order [ns].
    """
    if not len(stamp_ns):
        return False
    used = (pulses.onset_ns >= stamp_ns.min()) & (pulses.onset_ns <= stamp_ns.max())
    used &= ~outside_shares(pulses.intensity)
    low, high = recruiting_range(pulses.intensity[used], (np.inf, -np.inf))
    return 0.0 <= high - low < SMALLEST_INTENSITY_SPAN
