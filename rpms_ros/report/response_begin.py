# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From which time on a fitted response to one pulse is determined by the data.

Smooth functions cannot be zero until the muscle responds and then rise:
before that they oscillate around zero, and data in which pulses follow one another closely
hardly contradict them.  So the response before its last change of sign ahead of the peak is not
determined.
"""

import numpy as np

from rpms_ros.pulses import FloatArray

# Smaller oscillations, as a share of the peak, are not visible in a figure.
_SEEN = 2e-3


def begin_of_response(force: FloatArray) -> int:
    """Return from which sample on a response (times,) is determined; 0 if all of it is.

    Parameters
    ----------
    force : ndarray, shape (times,)
        Force after one pulse [N].
    """
    peak = int(np.argmax(force))
    top = float(force[peak])
    if not top > 0.0:
        return 0
    below = np.flatnonzero(force[:peak] <= 0.0)
    begin = int(below[-1]) if len(below) else 0
    swing = float(np.abs(force[: begin + 1]).max(initial=0.0))
    return begin if swing > _SEEN * top else 0
