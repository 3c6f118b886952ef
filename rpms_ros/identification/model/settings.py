# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the recursive estimator, with the paper's Tables 4 and 5 as presets."""

from dataclasses import dataclass, field, replace

from rpms_ros.errors import IdentificationError, check_number
from rpms_ros.identification.model.basis import DistortedSineBasis
from rpms_ros.muscle.recruitment import SMALLEST_SEPARATION, RecruitmentParameters

BOUNDS = {'u_thr': (0.0, 1.0), 'u_sat': (0.05, 1.5), 'alpha_sat': (0.5, 50.0)}
"""Lowest and highest value of nonlinear parameters.

u_sat is besides at least `SMALLEST_SEPARATION` above u_thr: without that the recursion can end in
the minimum with the two exchanged.
"""


def check_start(start: RecruitmentParameters) -> None:
    """Raise `IdentificationError` unless the parameters lie within the bounds."""
    ranges = zip(start[:3], BOUNDS.values(), strict=True)
    held = all(low <= value <= high for value, (low, high) in ranges)
    if not held or not start.u_sat >= start.u_thr + SMALLEST_SEPARATION:
        raise IdentificationError(
            f'expected a start within the bounds and u_thr < u_sat, got {start}'
        )


_POSITIVE = ('damping', 'damping_increment', 'hessian_scale', 'linear_covariance', 'force_scale')
SIMULATION_START = RecruitmentParameters(0.40, 0.90, 3.0)
EXPERIMENT_START = RecruitmentParameters(0.40, 0.90, 10.0)


@dataclass(frozen=True)
class PaperSettings:
    """Design parameters of the modified recursive Levenberg-Marquardt algorithm, Sec. 3.2.2.

    Attributes
    ----------
    basis : DistortedSineBasis
        Functions of the impulse response.
    start : RecruitmentParameters
        theta_rho[0] and the fixed alpha_thr.
    forgetting : float
        lambda, per sample.
    damping : float
        delta[0].
    damping_factor : float
        kappa.
    gain_ratio_margin : float
        zeta.
    condition_limit : float
        xi.
    damping_increment : float
        delta_s.
    hessian_scale : float
        Upper end of the uniform distribution of the entries of H[0].
    linear_covariance : float
        Diagonal of the initial covariance of the linear parameters; large, since nothing is known
        of them at the start, theta_h[0] = 0.
    force_scale : float
        Force that counts as one in H and delta, which are absolute numbers [N].  A tenth of the
        largest expected force is a good choice; a running measure of the force is not, since it is
        small while a schedule begins below the threshold, which makes steps too large.
    projected : bool
        Project the gradient off the linear regressors (variable projection); False takes the
        plain partial derivative at fixed linear parameters, which loses the curve under a
        sinusoidal intensity.

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    basis: DistortedSineBasis = field(default_factory=DistortedSineBasis)
    start: RecruitmentParameters = SIMULATION_START
    forgetting: float = 0.99
    damping: float = 1e-3
    damping_factor: float = 1.002
    gain_ratio_margin: float = 0.02
    condition_limit: float = 1000.0
    damping_increment: float = 0.01
    hessian_scale: float = 1e-4
    linear_covariance: float = 1e6
    force_scale: float = 1.0
    projected: bool = True

    def __post_init__(self) -> None:
        refused = IdentificationError
        check_number(refused, 'forgetting', self.forgetting, 0, 1, above=True)
        if not 0 <= self.gain_ratio_margin < 0.5:
            raise refused(f'expected 0 <= gain ratio margin < 0.5, got {self.gain_ratio_margin}')
        for name in ('damping_factor', 'condition_limit'):
            check_number(refused, name, getattr(self, name), 1, above=True)
        for name in _POSITIVE:
            check_number(refused, name, getattr(self, name), 0, above=True)
        check_number(refused, 'alpha_thr', self.start.alpha_thr, 0, above=True)
        check_start(self.start)


TABLE_4 = PaperSettings()
"""Simulated identification: Table 4, start [40 % 90 % 3]."""

TABLE_5 = replace(
    TABLE_4, basis=DistortedSineBasis(form_factor=45.0), start=EXPERIMENT_START, forgetting=0.999
)
"""Experimental identification: Table 5, start [40 % 90 % 10]."""

PAPER_PRESETS = {'paper_table_4': TABLE_4, 'paper_table_5': TABLE_5}
"""Tables 4 and 5 as printed, by name: to reproduce the paper, not for people."""

PEOPLE_PRESET = 'people'
PRESET_NAMES = (PEOPLE_PRESET, 'arctan', *PAPER_PRESETS)
"""Presets that command lines and node parameters accept."""
