# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulation of a whole session: samples and true state for given pulses, muscle and sensor."""

from collections.abc import Callable

import numpy as np

from rpms_ros.muscle.state import Muscle
from rpms_ros.muscle.surroundings import Surroundings
from rpms_ros.muscle.truth import Truth
from rpms_ros.muscle.truth import truth_at
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain

# Samples: enough that the overhead of a block is small, few enough for a smooth progress bar.
_BLOCK = 20_000


def simulate_session(
    muscle: Muscle,
    surroundings: Surroundings,
    pulses: PulseTrain,
    stamp_ns: IntArray,
    truth_rate: float = 0.0,
    advance: Callable[[int], None] = lambda _: None,
) -> tuple[ForceTrace, list[Truth]]:
    """Return the samples of the force sensor in a session, and the true states meanwhile.

    Parameters
    ----------
    muscle : Muscle
        The muscle, before any pulse.
    surroundings : Surroundings
        Efforts and sensor.
    pulses : PulseTrain
        Ascending in onset.
    stamp_ns : ndarray of int64, shape (samples,)
        Ascending times of the samples [ns]; the session starts at the first.
    truth_rate : float
        How often the true state is recorded [Hz]; 0 for never.
    advance : callable
        Called with the number of samples simulated since the last call.
    """
    if len(stamp_ns):
        muscle.begin(int(stamp_ns[0]))
        surroundings.begin(int(stamp_ns[0]))
    traces: list[ForceTrace] = []
    truths: list[Truth] = []
    done = 0
    for part in _blocks(stamp_ns, truth_rate):
        due = int(np.searchsorted(pulses.onset_ns, part[-1], side='right'))
        muscle.add_pulses(pulses.onset_ns[done:due], pulses.intensity[done:due])
        # the artifact of the last pulse before this block may extend into it
        traces.append(
            surroundings.measured(part, muscle.force(part), pulses[max(0, done - 1) : due])
        )
        if truth_rate > 0.0:
            truths.append(truth_at(muscle, surroundings, int(part[-1])))
        done = due
        advance(len(part))
    stamps = [trace.stamp_ns for trace in traces]
    force = [trace.force for trace in traces]
    empty = ForceTrace(np.empty(0, dtype=np.int64), np.empty(0))
    return (
        ForceTrace(np.concatenate(stamps), np.concatenate(force)) if traces else empty,
        truths,
    )


def _blocks(stamp_ns: IntArray, truth_rate: float) -> list[IntArray]:
    """Return the stamps in blocks, each of which ends where the truth is noted."""
    if truth_rate <= 0.0 or not len(stamp_ns):
        edges = np.arange(0, len(stamp_ns), _BLOCK)
    else:
        period_ns = NANOSECONDS_PER_SECOND / truth_rate
        number = np.floor((stamp_ns - stamp_ns[0]) / period_ns)
        edges = np.flatnonzero(np.diff(number, prepend=-1.0))
    return [part for part in np.split(stamp_ns, edges[1:]) if len(part)]
