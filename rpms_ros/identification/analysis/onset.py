# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Onset of a twitch as in the paper (Sec. 2.1): by the derivative of a filtered force.

A moving average of nine samples, divided by nine (the printed filter lacks the division), is
applied forwards and backwards; the onset is the last instant at which the derivative passes zero
upwards before the steepest rise.  The paper says 'the last positive zero crossing'; noise causes
more of them near the flat top, which are no onsets.

The average, applied twice, extends over eight samples on either side: it moves the onset earlier
by up to that much, and noise moves the crossing later.  The joint fit has neither bias;
`docs/analysis.md` has the figures.
"""

import numpy as np

from rpms_ros.pulses import FloatArray


def smoothed(force: FloatArray, samples: int) -> FloatArray:
    """Return the force after a moving average forwards and backwards, shape (samples,).

    Parameters
    ----------
    force : ndarray, shape (samples,)
        Force [N], evenly sampled.
    samples : int
        Length of the average; before its beginning the force is taken as constant.
    """
    once = _averaged(force, samples)
    back: FloatArray = _averaged(once[::-1], samples)[::-1]
    return back


def _averaged(force: FloatArray, samples: int) -> FloatArray:
    padded = np.concatenate((np.full(samples - 1, force[0]), force))
    total = np.concatenate(([0.0], np.cumsum(padded - force[0])))
    mean: FloatArray = (total[samples:] - total[:-samples]) / samples + force[0]
    return mean


def crossing_onset(lag: FloatArray, force: FloatArray, samples: int) -> float:
    """Return the onset by the derivative [s], or NaN if there is no upward crossing.

    Parameters
    ----------
    lag : ndarray, shape (samples,)
        Time since the stimulus [s], evenly spaced; only an onset after 0 is returned.
    force : ndarray, shape (samples,)
        Force [N].
    samples : int
        Length of the moving average.

    Returns
    -------
    float
        Lag at which the derivative passes zero, interpolated between samples [s].
    """
    filtered = smoothed(force, samples)
    slope = np.diff(filtered)
    middle = 0.5 * (lag[1:] + lag[:-1])
    after = np.flatnonzero(middle > 0)
    if len(after) < 2:
        return float('nan')
    peak = after[0] + int(np.argmax(filtered[after[0] + 1 :]))
    steepest = after[0] + int(np.argmax(slope[after[0] : peak + 1]))
    before = slope[after[0] : steepest + 1]
    upward = np.flatnonzero((before[:-1] <= 0) & (before[1:] > 0))
    if not len(upward):
        return float('nan')
    at = after[0] + int(upward[-1])
    share = -slope[at] / (slope[at + 1] - slope[at])
    return float(middle[at] + share * (middle[at + 1] - middle[at]))
