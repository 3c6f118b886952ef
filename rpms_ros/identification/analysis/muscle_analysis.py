# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Results of the analysis of a recording."""

from collections.abc import Mapping
from dataclasses import dataclass

from rpms_ros.identification.analysis.artifact import Artifacts
from rpms_ros.identification.analysis.field_fit import FieldAnalysis
from rpms_ros.identification.analysis.steady import SteadyPoint
from rpms_ros.identification.analysis.summation import SummationAnalysis
from rpms_ros.identification.analysis.twitches import TwitchAnalysis


@dataclass(frozen=True)
class MuscleAnalysis:
    """Results of the analysis of a recording.

    Attributes
    ----------
    contents : mapping of str to int
        Groups of pulses by kind.
    pulses, samples : int
        Pulses within the force, and force samples.
    sample_rate_hz : float
        Median rate of the force [Hz].
    noise : float
        Standard deviation of the white noise of the sensor [N].
    artifacts : Artifacts or None
        Stimulation artifacts and the offset of the clocks; None without pulses.
    twitches : TwitchAnalysis or None
        From single pulses.
    summation : SummationAnalysis or None
        From trains.
    steady : tuple of SteadyPoint
        Steady forces of long levels.
    recruitment : FieldAnalysis or None
        From the steady forces.
    findings : tuple of str
        Irregularities, and why results are missing; a sentence each.
    unit : str
        Of every force: ``N``, or ``N m`` where the sensor measured a torque.
    """

    contents: Mapping[str, int]
    pulses: int
    samples: int
    sample_rate_hz: float
    noise: float
    artifacts: Artifacts | None
    twitches: TwitchAnalysis | None
    summation: SummationAnalysis | None
    steady: tuple[SteadyPoint, ...]
    recruitment: FieldAnalysis | None
    findings: tuple[str, ...]
    unit: str = 'N'
