# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What every monitor of a stream offers."""

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
    """A cell of the stamps' grid before it is learnt from, with its surroundings.

    Attributes
    ----------
    stamp_ns, force : ndarray (samples,)
        Samples of the cell, and those up to a tenth of a second before and after it [ns], [N].
    first, last : int
        The samples of the cell itself are ``first .. last - 1``.
    found : ndarray of bool (last - first,)
        Samples of the cell that a monitor before this one has named.
    prediction : ndarray (last - first,) or None
        What the estimator foretells of them before it has learnt from any of them [N]; None if it
        does not, or `StreamSettings.pulse_look_ahead` is too short to know the pulses.
    """

    stamp_ns: IntArray
    force: FloatArray
    first: int
    last: int
    found: BoolArray
    prediction: FloatArray | None


@dataclass(frozen=True)
class ProcessedSamples:
    """A cell of the stamps' grid after it was processed.

    Attributes
    ----------
    stamp_ns, force, prediction : ndarray (samples,)
        Samples and their a-priori prediction [ns], [N], [N].
    usable : ndarray of bool (samples,)
        Whether each was learnt from.
    onset_ns, intensity : ndarray (pulses,)
        Pulses that the estimator was given meanwhile, ascending [ns], share of the maximum.
    """

    stamp_ns: IntArray
    force: FloatArray
    prediction: FloatArray
    usable: BoolArray
    onset_ns: IntArray
    intensity: FloatArray


class Monitor(Restorable):
    """Looks at everything that passes a stream; override what you need.

    Every method is called with cells of one grid of the stamps, in order and each cell once, so
    that what a monitor finds cannot depend on how messages arrive or are cut into blocks.  A
    monitor that raises is taken out, and `monitor_failed` is counted.

    What it remembers between calls is annotated in the body of the class, so that it is part of a
    saved state (`rpms_ros.identification.saved_state`).

    Attributes
    ----------
    faults : mapping of str to str
        Faults that the monitor counts and that `rpms_ros.identification.faults` does not name,
        each with its meaning.
    doubtful : mapping of str to float
        Faults that put estimates in doubt when they concern a larger share of the samples than
        this, of the last half minute or of all.
    """

    faults: ClassVar[Mapping[str, str]] = {}
    doubtful: ClassVar[Mapping[str, float]] = {}

    def state(self) -> State:
        """Return what is remembered; an attribute that is not annotated is refused."""
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
        """Take what was processed; return how many samples of it each fault concerns."""
        del samples
        return {}

    def estimated(self, estimate: Estimate) -> None:
        """Take an estimate."""

    def restart(self) -> None:
        """Forget the stamps so far: the clock has jumped back."""
