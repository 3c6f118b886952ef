# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A file that begins amid stimulation: its first force is that of pulses that are not in it."""

from dataclasses import replace

import numpy as np

from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import PulseTrain

WARNING = (
    'pulses come from the beginning, and the force is not at rest there: those before it are not '
    'in the file, and nothing is learnt while they may act; better begin at rest'
)
# The first pulse comes within so many intervals of the pulses after it.
_INTERVALS = 1.5
_FEWEST_PULSES = 5
# Share of the range of the force by which rest is left, at either end: a pull may be negative.
_SHARE = 0.15
# The same in standard deviations of the noise.
_NOISE = 6.0


def begins_amid(pulses: PulseTrain, forces: ForceTrace) -> bool:
    """Return whether stimulation was going on before the first sample, as far as a file shows.

    Parameters
    ----------
    pulses : PulseTrain
        Ascending.
    forces : ForceTrace
        Ascending.
    """
    known = np.isfinite(forces.force)
    force = forces.force[known]
    if len(pulses) < _FEWEST_PULSES or len(force) < 3:
        return False
    first_ns = int(forces.stamp_ns[0])
    interval = float(np.median(np.diff(pulses.onset_ns[: 10 * _FEWEST_PULSES])))
    if not 0.0 <= pulses.onset_ns[0] - first_ns < _INTERVALS * interval:
        return False
    # no pulse of the file acts on these
    before = force[forces.stamp_ns[known] <= pulses.onset_ns[0]]
    if not len(before):
        return False
    low, high = np.percentile(force, [1.0, 99.0])
    noise = float(np.median(np.abs(np.diff(force, 2)))) / (0.6745 * np.sqrt(6.0))
    least = max(_SHARE * (high - low), _NOISE * noise)
    level = float(np.median(before))
    return bool(low + least < level < high - least)


def numbered_on(pulses: PulseTrain) -> PulseTrain:
    """Return the pulses with sequence numbers that say that there were pulses before them."""
    return replace(pulses, sequence=pulses.sequence + 1)
