# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the recursion for people."""

import math
from dataclasses import dataclass
from dataclasses import field

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.projection.settings import ProjectionSettings
from rpms_ros.muscle.identified_form import RecruitmentParameters


def _model() -> ProjectionSettings:
    return ProjectionSettings(start=RecruitmentParameters(0.50, 0.90, 6.0, 5.5))


@dataclass(frozen=True)
class ExactRecursionSettings:
    """Model and memory of the recursion for people.

    Attributes
    ----------
    model : ProjectionSettings
        Basis, start, prior, bounds, law of the rate and level of the intervals; what it says of
        horizons and knots is not used.
    memory_time : float
        Longest time constant with which samples are forgotten, of the time in which pulses act
        [s].  Until so much has come nearly everything counts: the memory grows by itself.
    memory_after_change : float
        What is kept of a muscle that has changed, as seconds of samples [s].
    drift : float
        Standard deviation of the baseline's walk in a second, in units of that of a sample.
    step_period : float
        Shortest time between two steps of the parameters [s].
    """

    model: ProjectionSettings = field(default_factory=_model)
    memory_time: float = 40.0
    memory_after_change: float = 0.25
    drift: float = 0.1
    step_period: float = 0.04

    def __post_init__(self) -> None:
        for name in ('memory_time', 'memory_after_change', 'drift', 'step_period'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise IdentificationError(f'expected {name} above 0, got {value}')
        if not self.memory_after_change < self.memory_time:
            raise IdentificationError(
                'expected memory_after_change below memory_time, got '
                f'{self.memory_after_change} and {self.memory_time}'
            )


PEOPLE = ExactRecursionSettings()
"""For people: response from 8 ms after a pulse on, alpha_thr free, memory of 40 s."""
