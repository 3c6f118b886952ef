# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Subjects: the parameters of one stimulated muscle.

The presets are the averages of the paper; `random_subject` draws from its ranges, so that a
method can be tried on people who differ as much as the subjects of the paper.
"""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
import numpy.typing as npt

from rpms_ros.errors import MuscleError, check_number, check_seed
from rpms_ros.muscle.recruitment import IntensityRecruitment, RateRecruitment
from rpms_ros.muscle.twitch import twitch_area
from rpms_ros.pulses import FloatArray

REFERENCE_RATE = 20.0


class Modality(Enum):
    """How the nerve is stimulated."""

    MAGNETIC = 'rpms'
    ELECTRICAL = 'fes'


@dataclass(frozen=True)
class Subject:
    """A muscle under isometric stimulation, Eq. (11).

    Attributes
    ----------
    time_constant : float
        T_a of the twitch [s].
    latency : float
        T_1 from the pulse to the onset of the twitch [s].
    order : int
        Number of equal real poles of the twitch.
    recruitment : IntensityRecruitment
        rho_u.
    rate_recruitment : RateRecruitment
        rho_f.
    maximum_force : float
        Steady mean force at full recruitment, rho_u = 1, and `REFERENCE_RATE` [N].

    Raises
    ------
    MuscleError
        If a value is not possible.
    """

    time_constant: float = 38.44e-3
    latency: float = 9.45e-3
    order: int = 3
    recruitment: IntensityRecruitment = field(default_factory=IntensityRecruitment)
    rate_recruitment: RateRecruitment = field(default_factory=RateRecruitment)
    maximum_force: float = 10.0

    def __post_init__(self) -> None:
        check_number(MuscleError, 'latency', self.latency, 0, unit='s')
        if self.order not in range(1, 7):
            raise MuscleError(f'expected a whole order from 1 to 6, got {self.order}')
        check_number(MuscleError, 'maximum force', self.maximum_force, 0, above=True, unit='N')
        twitch_area(self.time_constant, self.order)

    def pulse_weight(self, intensity: npt.ArrayLike, rate_hz: npt.ArrayLike) -> FloatArray:
        """Return the peak force [N] of the twitch that one pulse adds, Eq. (11).

        ``rho(u, f) F_max / Fbar(f)`` with Fbar of Eq. (7); `intensity` and `rate_hz` [Hz]
        broadcast together.
        """
        area = twitch_area(self.time_constant, self.order)
        by_rate = self.rate_recruitment.per_pulse
        share = self.recruitment(intensity) * by_rate(rate_hz)
        # Table 3 gives rho_f(20 Hz) = 0.9990; with this F_max is exact at that rate.
        reference = REFERENCE_RATE * float(by_rate(REFERENCE_RATE))
        return share * (self.maximum_force / reference / area)

    def steady_force(self, intensity: npt.ArrayLike, rate_hz: npt.ArrayLike) -> FloatArray:
        """Return the steady mean force [N] of a train, rho(u, f) F_max (Eq. 8).

        Below the lowest measured rate `pulse_weight` is constant, so this falls with the rate.
        """
        mean = np.asarray(rate_hz, dtype=np.float64) * twitch_area(self.time_constant, self.order)
        return self.pulse_weight(intensity, rate_hz) * mean


def average_subject(modality: Modality = Modality.MAGNETIC) -> Subject:
    """Return the paper's average subject: Tables 1 to 3."""
    if modality is Modality.ELECTRICAL:
        return Subject(time_constant=36.62e-3, latency=24.4e-3)
    return Subject()


def simulation_subject() -> Subject:
    """Return the plant of the simulated identification: Sec. 3.3.3 and Eq. (30), no latency."""
    shape = IntensityRecruitment(0.48, 0.98, threshold_slope=6.0, saturation_slope=4.0)
    return Subject(latency=0.0, recruitment=shape.normalised())


def random_subject(
    generator: np.random.Generator, modality: Modality = Modality.MAGNETIC
) -> Subject:
    """Return a subject drawn uniformly from the ranges of Tables 1, 2 and 6.

    Latency and time constant come from Tables 1 and 2 of the modality, threshold, saturation
    and its slope from Table 6 widened to include Table 3, the force from 5 to 50 N.  Draws whose
    curve does not rise over the whole range of intensity are repeated.
    """
    latencies = {Modality.MAGNETIC: (6.28, 14.63), Modality.ELECTRICAL: (20.83, 28.24)}
    constants = {Modality.MAGNETIC: (26.71, 49.81), Modality.ELECTRICAL: (22.58, 53.22)}
    while True:
        shape = IntensityRecruitment(
            threshold=generator.uniform(0.45, 0.70),
            saturation=generator.uniform(0.80, 1.00),
            threshold_slope=generator.uniform(4.5, 7.0),
            saturation_slope=generator.uniform(3.5, 17.0),
        )
        if shape.rises:
            break
    return Subject(
        time_constant=1e-3 * generator.uniform(*constants[modality]),
        latency=1e-3 * generator.uniform(*latencies[modality]),
        recruitment=shape.normalised(),
        maximum_force=generator.uniform(5.0, 50.0),
    )


SUBJECTS = {
    'rpms': lambda: average_subject(Modality.MAGNETIC),
    'fes': lambda: average_subject(Modality.ELECTRICAL),
    'simulation': simulation_subject,
}
"""Presets by name, for command lines and node parameters."""


def subject_by_name(name: str, seed: int = 0) -> Subject:
    """Return a preset of `SUBJECTS`, or a muscle that is drawn: ``random``.

    Raises
    ------
    MuscleError
        If there is no such subject, or the seed of a random one is none.
    """
    if name == 'random':
        check_seed(seed, MuscleError)
        return random_subject(np.random.default_rng(seed))
    if name not in SUBJECTS:
        raise MuscleError(f'expected a subject of {", ".join(SUBJECTS)}, random, got {name!r}')
    return SUBJECTS[name]()
