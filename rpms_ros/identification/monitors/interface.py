# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Interface of every monitor of a stream.

Monitors receive the stream in cells: consecutive intervals of a fixed grid of the stamps, 0.1 s
long or shorter, each once and complete.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.saved_state import Restorable
from rpms_ros.identification.saved_state import State
from rpms_ros.identification.saved_state import remembered
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray


@dataclass(frozen=True)
class Window:
    """A cell before the estimator learns from it, with the samples around it.

    Attributes
    ----------
    stamp_ns, force : ndarray (samples,)
        Samples of the cell, and those up to a tenth of a second before and after it [ns], [N].
    first, last : int
        The samples of the cell itself are ``first .. last - 1``.
    found : ndarray of bool (last - first,)
        Samples of the cell in which a monitor before this one has found a fault.
    prediction : ndarray (last - first,) or None
        Prediction of them before the estimator has learnt from any of them [N]; None if the
        estimator cannot, or `StreamSettings.pulse_look_ahead` is too short.
    """

    stamp_ns: IntArray
    force: FloatArray
    first: int
    last: int
    found: BoolArray
    prediction: FloatArray | None


@dataclass(frozen=True)
class ProcessedSamples:
    """A cell after it was processed.

    Attributes
    ----------
    stamp_ns, force, prediction : ndarray (samples,)
        Samples and their a-priori prediction [ns], [N], [N].
    usable : ndarray of bool (samples,)
        Whether each was learnt from.
    onset_ns, intensity : ndarray (pulses,)
        Pulses added to the estimator meanwhile, ascending [ns], share of the maximum.
    """

    stamp_ns: IntArray
    force: FloatArray
    prediction: FloatArray
    usable: BoolArray
    onset_ns: IntArray
    intensity: FloatArray


class Monitor(Restorable):
    """Receives samples, predictions and estimates of a stream; override what you need.

    Every method is called with cells, in order and each cell once, so that the result cannot
    depend on how messages arrive or are cut into blocks.  A monitor that raises is removed, and
    `monitor_failed` is counted.

    Attributes that are kept between calls are annotated in the body of the class, so that they
    are part of a saved state (`rpms_ros.identification.saved_state`).

    Attributes
    ----------
    faults : mapping of str to str
        Further faults that the monitor counts besides those of `rpms_ros.identification.faults`,
        each with its meaning.
    doubtful : mapping of str to float
        Faults that make estimates doubtful if they affect a larger share of the samples than
        this, of the last half minute or of all.
    """

    faults: ClassVar[Mapping[str, str]] = {}
    doubtful: ClassVar[Mapping[str, float]] = {}

    def state(self) -> State:
        """Return the state; an attribute that is not annotated is an error."""
        further = sorted(set(vars(self)) - set(remembered(type(self))))
        if further:
            raise IdentificationError(
                f'expected annotations of all that {type(self).__name__} remembers, '
                f'got none of {", ".join(further)}'
            )
        return super().state()

    def examine(self, window: Window) -> Mapping[str, BoolArray]:
        """Return which samples of the cell (last - first,) must not be learnt from, by fault."""
        del window
        return {}

    def processed(self, samples: ProcessedSamples) -> Mapping[str, int]:
        """Receive a processed cell; return how many of its samples have each fault."""
        del samples
        return {}

    def estimated(self, estimate: Estimate) -> None:
        """Receive an estimate."""

    def restart(self) -> None:
        """Forget earlier stamps: the clock has jumped back."""
