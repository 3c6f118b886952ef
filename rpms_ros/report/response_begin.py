# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the response to one pulse begins, as far as a fitted one can tell.

Smooth functions that are fitted to a force cannot be zero until the muscle answers and rise then:
before that they swing to either side of zero, and data in which pulses follow one another closely
hardly contradict them.  What lies before the last change of sign ahead of the peak is therefore no
force that was seen.
"""

import numpy as np

from rpms_ros.pulses import FloatArray

# A swing that is smaller than this share of the peak is not seen in a figure.
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
