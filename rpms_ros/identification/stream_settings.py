# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the alignment of samples and pulses."""

import math
from dataclasses import dataclass

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.monitors import MONITORS

LARGEST_FORCE = 10_000.0
"""No muscle and no sensor for people reaches it [N]."""


@dataclass(frozen=True)
class StreamSettings:
    """Settings of the alignment of samples and pulses.

    Attributes
    ----------
    reorder_delay : float
        How long a sample waits for late pulses, and for the samples after it that show whether it
        is an outlier [s]; below 20 ms samples are not checked before they are learnt from.
    pulse_look_ahead : float
        Up to this time after a sample pulses are checked before it is used [s]; a pulse may be
        late by the rest of `reorder_delay`.
    estimate_period : float
        Time between two estimates, by the stamps [s].
    longest_gap : float
        Longest pause of the force that does not count as a gap [s].
    largest_force : float
        Samples with a larger force, of either sign, are dropped [N].
    monitors : tuple of str
        Names of the monitors, of `rpms_ros.identification.monitors` or of other packages.

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    reorder_delay: float = 0.2
    pulse_look_ahead: float = 0.1
    estimate_period: float = 0.1
    longest_gap: float = 1.0
    largest_force: float = LARGEST_FORCE
    monitors: tuple[str, ...] = tuple(MONITORS)

    def __post_init__(self) -> None:
        if not 0 <= self.pulse_look_ahead <= self.reorder_delay < math.inf:
            raise IdentificationError(
                'expected 0 <= pulse_look_ahead <= reorder_delay, got '
                f'{self.pulse_look_ahead} and {self.reorder_delay}'
            )
        if not (0 < self.estimate_period < math.inf and 0 < self.longest_gap < math.inf):
            raise IdentificationError(
                'expected an estimate period and a longest gap above 0 s, got '
                f'{self.estimate_period} and {self.longest_gap}'
            )
        if not 0 < self.largest_force < math.inf:
            raise IdentificationError(
                f'expected a largest force above 0 N, got {self.largest_force}'
            )
