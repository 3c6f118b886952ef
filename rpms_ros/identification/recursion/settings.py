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
        Basis, start, prior, bounds, `by_rate` and level of the intervals; its settings of horizon
        and knots are not used.
    memory_time : float
        Time constant with which samples are forgotten, in time during which pulses act [s].
    memory_after_change : float
        Weight of the memory after a change of unknown kind, in seconds of samples [s].
    memory_kept : float
        The same after a change of known kind, for the part that is still valid [s].
    drift : float
        Standard deviation of the random walk of the baseline in a second, relative to that of
        the noise of a sample.
    step_period : float
        Shortest time between two steps of the parameters [s].

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    model: ProjectionSettings = field(default_factory=_model)
    memory_time: float = 40.0
    memory_after_change: float = 0.25
    memory_kept: float = 5.0
    drift: float = 0.1
    step_period: float = 0.04

    def __post_init__(self) -> None:
        for name in ('memory_time', 'memory_after_change', 'memory_kept', 'drift', 'step_period'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise IdentificationError(f'expected {name} above 0, got {value}')
        if not self.memory_after_change < self.memory_time:
            raise IdentificationError(
                'expected memory_after_change below memory_time, got '
                f'{self.memory_after_change} and {self.memory_time}'
            )


PEOPLE = ExactRecursionSettings()
"""For people: latency of 8 ms, alpha_thr free, memory of 40 s."""
