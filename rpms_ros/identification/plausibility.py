# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a curve and a response are possible for the muscle that was measured.

An estimator can explain the force by impossible parameters: a recursion that forgets within a
tenth of a second does so under a slow sinusoid, with an output error of 1 %.  But a muscle does
not push, and the twitch of one pulse is not larger than the largest force that was measured while
such pulses were given.
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
NO_CONSTANT_MUSCLE = 'no_constant_muscle'
RESPONSE_MISFIT = 'response_misfit'
RESIDUALS_ALIKE = 'residuals_alike'
CLOCKS_DIFFER = 'clocks_differ'
FORCE_WITHOUT_PULSES = 'force_without_pulses'
OF_TIME = (CLOCKS_DIFFER, FORCE_WITHOUT_PULSES)
"""Doubts whether pulses and force belong together."""

REASON: Mapping[str, str] = MappingProxyType(
    {
        CURVE_NEGATIVE: 'the curve is negative: a muscle does not push',
        CURVE_BEYOND_FORCE: 'the curve is far above the largest force that was measured',
        RESPONSE_BEYOND_FORCE: 'the response to one pulse is far above the largest force that was '
        'measured',
        RESPONSE_NEGATIVE: 'the response to one pulse is far below zero: the data do not show how '
        'it runs, or it begins before the functions of the model',
        BAND_WIDER_THAN_CURVE: 'the interval of the curve is wider than the curve is high',
        NO_CONSTANT_MUSCLE: 'no constant muscle explains the whole recording: it tired, the coil '
        'moved or the patient tensed it, and the numbers are a mixture',
        RESPONSE_MISFIT: 'the prediction errors follow the pulses: the response is not one of the '
        'model, or the muscle changes',
        RESIDUALS_ALIKE: 'what the muscle leaves of neighbouring samples is alike, as with a '
        'sensor that filters its noise: the curve may be wrong by more than its interval',
        CLOCKS_DIFFER: 'the stamps of force and pulses do not belong together',
        FORCE_WITHOUT_PULSES: 'the force goes on at the rate of the pulses where there are none',
    }
)
"""Explanation of each doubt, by its name."""


def stated_doubt(estimate: Estimate, name: str) -> str:
    """Return a doubt of an estimate by name, with its own reason or else what it means."""
    own = (reason for reason in estimate.reasons if reason.startswith(f'{name}: '))
    return next(own, f'{name}: {meaning_of_doubt(name)}')


def meaning_of_doubt(name: str) -> str:
    """Return the explanation of a doubt of an estimate; monitors may add others."""
    return REASON.get(name) or MEANING.get(name, 'reported by a monitor')


# Limits as shares of the largest force, with room for noise and baseline.
_BEYOND = 1.5
_NEGATIVE = 0.2
# Limit as a share of the largest value of the response; noise causes a tenth.
_RESPONSE_NEGATIVE = 0.25
# Pulses slower than this share of the rate of the curve never reach the force of the curve.
_SLOWER = 0.7


class PlausibilityCheck(Restorable):
    """Compares an estimate with the largest force and intensity that the estimator was given."""

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
        """Add pulses (pulses,), ascending [ns, 1]."""
        if not len(onset_ns):
            return
        if self._last_ns is not None:
            self._time_ns += max(int(onset_ns[0]) - self._last_ns, 0)
        self._time_ns += int(onset_ns[-1] - onset_ns[0])
        self._last_ns = int(onset_ns[-1])
        self._pulses += len(onset_ns)
        self.largest_intensity = max(self.largest_intensity, float(intensity.max()))

    def add_forces(self, force: FloatArray, usable: BoolArray) -> None:
        """Add samples (samples,) [N]."""
        largest = np.abs(force[usable]).max(initial=self.largest_force)
        self.largest_force = float(largest)

    @property
    def rate_hz(self) -> float:
        """Mean rate of the pulses [Hz]; infinite with fewer than two."""
        if not self._time_ns:
            return math.inf
        return (self._pulses - 1) * NANOSECONDS_PER_SECOND / self._time_ns

    def examine(self, estimate: Estimate) -> Estimate:
        """Return the estimate, with doubts and reasons added where it is impossible."""
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
        """Return by the name of each doubt whether it applies, at intensities that were given."""
        given = estimate.curve_intensity <= self.largest_intensity + 1e-9
        curve = estimate.curve_force[given]
        full = float(estimate.curve_force[-1])
        # The response is to full intensity, which need not have been given.
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
