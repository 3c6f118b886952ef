# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a curve and a response can be those of the muscle that was measured.

An estimator can explain the force by numbers that no muscle has: a recursion that forgets within
a tenth of a second does so under a slow sinusoid, with an output error of 1 %.  What the force
itself says is simple: a muscle does not push, and one pulse does not pull harder than the most
that was measured while pulses of that intensity came.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.faults import MEANING
from rpms_ros.identification.saved_state import Restorable
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

CURVE_NEGATIVE = 'curve_negative'
CURVE_BEYOND_FORCE = 'curve_beyond_force'
RESPONSE_BEYOND_FORCE = 'response_beyond_force'
RESPONSE_NEGATIVE = 'response_negative'
BAND_WIDER_THAN_CURVE = 'band_wider_than_curve'

REASON: Mapping[str, str] = MappingProxyType(
    {
        CURVE_NEGATIVE: 'the curve is negative: a muscle does not push',
        CURVE_BEYOND_FORCE: 'the curve is far above the largest force that was measured',
        RESPONSE_BEYOND_FORCE: 'the response to one pulse is far above the largest force that was '
        'measured',
        RESPONSE_NEGATIVE: 'the response to one pulse is far below zero: the data do not show how '
        'it runs, or it begins before the functions of the model',
        BAND_WIDER_THAN_CURVE: 'the interval of the curve is wider than the curve is high',
    }
)
"""What is wrong, in plain words, by the name that stands among the doubts."""


def meaning_of_doubt(name: str) -> str:
    """Return what a name among the doubts of an estimate means; a monitor may bring others."""
    return REASON.get(name) or MEANING.get(name, 'said by a monitor')


# Of the largest force: noise and baseline may make this much of it.
_BEYOND = 1.5
_NEGATIVE = 0.2
# Of the largest value of the response: noise leaves a tenth.
_RESPONSE_NEGATIVE = 0.25
# Pulses this much slower than the rate of the curve never let its force appear.
_SLOWER = 0.7


class Seen(Restorable):
    """What force and pulses an estimator has seen, and what cannot be true after that."""

    largest_force: float
    largest_intensity: float
    _pulses: int
    _time_ns: int
    _last_ns: int | None

    def __init__(self) -> None:
        self.largest_force = 0.0
        self.largest_intensity = 0.0
        self._pulses = 0
        self._time_ns = 0
        self._last_ns = None

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Take pulses (pulses,), ascending."""
        if not len(onset_ns):
            return
        if self._last_ns is not None:
            self._time_ns += max(int(onset_ns[0]) - self._last_ns, 0)
        self._time_ns += int(onset_ns[-1] - onset_ns[0])
        self._last_ns = int(onset_ns[-1])
        self._pulses += len(onset_ns)
        self.largest_intensity = max(self.largest_intensity, float(intensity.max()))

    def add_forces(self, force: FloatArray, usable: BoolArray) -> None:
        """Take samples (samples,)."""
        largest = np.abs(force[usable]).max(initial=self.largest_force)
        self.largest_force = float(largest)

    @property
    def rate_hz(self) -> float:
        """Mean rate of the pulses [Hz]; infinite while there are less than two."""
        if not self._time_ns:
            return math.inf
        return (self._pulses - 1) * NANOSECONDS_PER_SECOND / self._time_ns

    def examine(self, estimate: Estimate) -> Estimate:
        """Return the estimate, with doubts and reasons where it cannot be that of the muscle."""
        if not estimate.curve_known:
            return estimate
        found = [name for name, wrong in self._wrong(estimate).items() if wrong]
        if not found:
            return estimate
        return replace(
            estimate,
            doubts=(*estimate.doubts, *found),
            reasons=(*estimate.reasons, *(REASON[name] for name in found)),
        )

    def _wrong(self, estimate: Estimate) -> dict[str, bool]:
        """Return what is wrong at intensities that were given."""
        given = estimate.curve_intensity <= self.largest_intensity + 1e-9
        curve = estimate.curve_force[given]
        full = float(estimate.curve_force[-1])
        # The response is one to full intensity, which need not have been given.
        share = abs(float(curve[-1]) / full) if full else 1.0
        highest = float(estimate.response_force.max(initial=0.0))
        lowest = float(estimate.response_force.min(initial=0.0))
        most = _BEYOND * self.largest_force
        fast = self.rate_hz > _SLOWER * estimate.repetition_rate
        wide = False
        if len(estimate.curve_upper):
            width = (estimate.curve_upper - estimate.curve_lower)[given].max()
            wide = bool(width > np.abs(curve).max())
        return {
            CURVE_NEGATIVE: bool(curve.min() < -_NEGATIVE * self.largest_force),
            CURVE_BEYOND_FORCE: bool(curve.max() > most and fast),
            RESPONSE_BEYOND_FORCE: min(share, 1.0) * highest > most,
            RESPONSE_NEGATIVE: lowest < -_RESPONSE_NEGATIVE * highest,
            BAND_WIDER_THAN_CURVE: wide,
        }
