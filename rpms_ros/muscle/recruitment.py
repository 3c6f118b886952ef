# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recruitment: the share of the muscle that is activated, by intensity and repetition rate.

``rho(u, f) = rho_u(u) rho_f(f)`` (Eq. 8).  Eq. (9) is printed with beta_2 inside the product
with beta_1; only outside does Table 3 give rho_u(0) = 0 and rho_u(1) = 1.

In the form that is identified, Eq. (30), the gain is 1 (it is part of the linear dynamics) and the
offset that for which rho(0) = 0::

    rho(u) = T(u - u_thr, a_thr) - T(u - u_sat, a_sat) - T(-u_thr, a_thr) + T(-u_sat, a_sat)
    T(x, a) = x atan(a x)

With ``B(x, a) = dT/dx = atan(a x) + a x / (1 + (a x)^2)`` and
``A(x, a) = dT/da = x^2 / (1 + (a x)^2)`` the four derivatives are differences of two terms.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt
from scipy.special import expit, ndtr

from rpms_ros.errors import MuscleError, check_number
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray

REFRACTORY_NS = 1_000_000
"""A motor axon is absolutely refractory for about a millisecond: no interval counts as shorter."""
SMALLEST_SEPARATION = 0.05
"""A muscle whose u_sat is not this far above its u_thr is nothing that can be identified."""


def _pools(u: FloatArray, threshold: FloatArray, saturation: FloatArray) -> FloatArray:
    return 0.55 * expit((u - threshold) / 0.025) + 0.45 * expit((u - saturation + 0.15) / 0.03)


OTHER_SHAPES: dict[str, Callable[[FloatArray, FloatArray, FloatArray], FloatArray]] = {
    'boltzmann': lambda u, thr, sat: expit((u - 0.5 * (thr + sat)) * 7.0 / (sat - thr)),
    'gauss': lambda u, thr, sat: ndtr((u - 0.5 * (thr + sat)) * 4.0 / (sat - thr)),
    'weibull': lambda u, thr, sat: (
        1.0 - np.exp(-((np.maximum(u - thr + 0.15, 0.0) / (0.7 * (sat - thr))) ** 2.2))
    ),
    'unsaturated': lambda u, thr, _: np.maximum(u - thr + 0.1, 0.0) ** 1.4,
    'pools': _pools,
}
"""Curves of other kinds than Eq. (9), for simulations, by intensity, u_thr and u_sat: Boltzmann's,
a cumulative normal distribution, Weibull's, one that does not saturate, and two pools of units."""


@dataclass(frozen=True)
class IntensityRecruitment:
    """Recruitment by intensity, rho_u of Eq. (9); the defaults are Table 3.

    Attributes
    ----------
    threshold, saturation : float
        u_thr and u_sat, share of the maximum intensity.
    threshold_slope, saturation_slope : float
        alpha_thr and alpha_sat: how sharply the curve bends there.
    gain, offset : float
        beta_1 and beta_2.
    shape : str
        ``arctan``, that of Eq. (9), or one of `OTHER_SHAPES` between the same two intensities.
    """

    threshold: float = 0.48
    saturation: float = 0.98
    threshold_slope: float = 5.0
    saturation_slope: float = 4.0
    gain: float = 0.738
    offset: float = 0.539
    shape: str = 'arctan'

    def __post_init__(self) -> None:
        if self.shape not in ('arctan', *OTHER_SHAPES):
            known = ', '.join(('arctan', *OTHER_SHAPES))
            raise MuscleError(f'expected a recruitment of {known}, got {self.shape!r}')
        for name in ('threshold', 'gain', 'offset'):
            check_number(MuscleError, name, getattr(self, name))
        check_number(MuscleError, 'saturation', self.saturation, self.threshold, above=True)
        for name in ('threshold_slope', 'saturation_slope'):
            check_number(MuscleError, name, getattr(self, name), 0, above=True)

    def __call__(self, intensity: npt.ArrayLike) -> FloatArray:
        """Return rho_u at ``intensity`` (shape (...), share 0..1), same shape."""
        u = np.asarray(intensity, dtype=np.float64)
        return self.gain * self.bend(u, self.threshold, self.saturation) + self.offset

    def bend(
        self, u: FloatArray, threshold: FloatArray | float, saturation: FloatArray | float
    ) -> FloatArray:
        """Return the curve without gain and offset for another u_thr and u_sat; all (...)."""
        above, beyond = u - threshold, u - saturation
        if self.shape != 'arctan':
            return OTHER_SHAPES[self.shape](u, u - above, u - beyond)
        bent: FloatArray = above * np.arctan(self.threshold_slope * above)
        return bent - beyond * np.arctan(self.saturation_slope * beyond)

    @property
    def rises(self) -> bool:
        """Whether the curve rises monotonically over 0..1; for gains above 0.

        The slope is ``B(alpha_thr (u - u_thr)) - B(alpha_sat (u - u_sat))`` with the rising
        function ``B(z) = atan z + z / (1 + z^2)``, so its sign is that of a difference which is
        linear in u: the two ends of the range decide.
        """
        slopes = (self.threshold_slope, self.saturation_slope)
        at_zero = slopes[1] * self.saturation - slopes[0] * self.threshold
        at_one = slopes[0] * (1.0 - self.threshold) - slopes[1] * (1.0 - self.saturation)
        return at_zero >= 0.0 and at_one >= 0.0

    def normalised(self) -> 'IntensityRecruitment':
        """Return the same shape with rho_u(0) = 0, exactly, and rho_u(1) = 1, to rounding.

        Raises
        ------
        MuscleError
            If the shape is not higher at intensity 1 than at 0.
        """
        unit = replace(self, gain=1.0, offset=0.0)
        low, high = (float(value) for value in unit(np.array([0.0, 1.0])))
        if not high > low:
            raise MuscleError(f'expected rho_u(1) > rho_u(0), got {high} and {low}')
        gain = 1.0 / (high - low)
        return replace(self, gain=gain, offset=-gain * low)


@dataclass(frozen=True)
class RateRecruitment:
    """Recruitment by repetition rate, rho_f of Eq. (10); the defaults are Table 3.

    Measured from 15 Hz (`lowest_rate`) to 35 Hz.

    Attributes
    ----------
    saturation : float
        f_sat [Hz].
    slope : float
        gamma_sat [1/Hz].
    gain : float
        delta_1 [1/Hz].
    offset : float
        delta_2.
    lowest_rate : float
        Lowest rate at which it was measured [Hz].
    """

    saturation: float = 25.0
    slope: float = 0.05
    gain: float = 0.0597
    offset: float = -0.321
    lowest_rate: float = 15.0

    def __post_init__(self) -> None:
        for name in ('saturation', 'offset'):
            check_number(MuscleError, name, getattr(self, name))
        for name in ('lowest_rate', 'slope', 'gain'):
            check_number(MuscleError, name, getattr(self, name), 0, above=True)
        # rho_f rises, so this keeps every pulse's weight above zero.
        name = f'rho_f at {self.lowest_rate} Hz'
        check_number(MuscleError, name, float(self(self.lowest_rate)), 0, above=True)

    def __call__(self, rate_hz: npt.ArrayLike) -> FloatArray:
        """Return rho_f at ``rate_hz`` (shape (...), Hz), same shape."""
        rate = np.asarray(rate_hz, dtype=np.float64)
        excess = rate - self.saturation
        bend = np.arctan(self.slope * excess) / np.pi + 0.5
        return self.gain * (rate - excess * bend) + self.offset

    def per_pulse(self, rate_hz: npt.ArrayLike) -> FloatArray:
        """Return rho_f(f) / f, the weight of one pulse at rate f, shape (...) [s].

        Eq. (11) divides rho_f by the steady mean of the train, which is proportional to f.
        Towards f = 0 that is 0/0, spoiled by the rounding of delta_2, and below the lowest
        measured rate it is extrapolation; twitches that far apart do not influence each other,
        so lower rates get the weight of the lowest measured one.  Above the highest measured rate
        Eq. (10) is extrapolated: it levels off, so the weight falls with 1/f.
        """
        rate = np.maximum(np.asarray(rate_hz, dtype=np.float64), self.lowest_rate)
        return self(rate) / rate

    def of_train(
        self, onset_ns: IntArray, rate_hz: float, last_ns: int | None = None
    ) -> FloatArray:
        """Return the weights (pulses,) by the intervals before pulses, 1 at the rate `rate_hz`.

        Parameters
        ----------
        onset_ns : ndarray of int64 (pulses,)
            Ascending onsets [ns].
        rate_hz : float
            Rate at which the weight is 1 [Hz].
        last_ns : int or None
            Onset of the pulse before them [ns]; None: there was none.
        """
        interval = np.diff(onset_ns, prepend=onset_ns[:1] if last_ns is None else [last_ns])
        rate = NANOSECONDS_PER_SECOND / np.maximum(interval, REFRACTORY_NS)
        if last_ns is None:
            rate[:1] = 0.0
        return self.per_pulse(rate) / float(self.per_pulse(rate_hz))


@dataclass(frozen=True)
class RecruitmentField:
    """The recruitment field rho(u, f) of Eq. (8)."""

    by_intensity: IntensityRecruitment = IntensityRecruitment()
    by_rate: RateRecruitment = RateRecruitment()

    def __call__(self, intensity: npt.ArrayLike, rate_hz: npt.ArrayLike) -> FloatArray:
        """Return rho at intensities and rates (Hz) that broadcast together."""
        return self.by_intensity(intensity) * self.by_rate(rate_hz)


class RecruitmentParameters(NamedTuple):
    """Nonlinear parameters theta_rho of Eq. (30), in the order of the start values.

    Attributes
    ----------
    u_thr, u_sat : float
        Threshold and saturation, share of the maximum intensity.
    alpha_sat, alpha_thr : float
        Sharpness of the two bends.
    """

    u_thr: float
    u_sat: float
    alpha_sat: float
    alpha_thr: float = 6.0


PARAMETER_NAMES = RecruitmentParameters._fields


@numba.njit(cache=True)
def arctan_recruitment(intensity: float, theta: FloatArray) -> float:
    """Return ``T(u - u_thr, a_thr) - T(u - u_sat, a_sat)``; rho(u) is this less its value at 0.

    Parameters
    ----------
    intensity : float
        u.
    theta : ndarray (4,)
        u_thr, u_sat, alpha_sat, alpha_thr.
    """
    above = intensity - theta[0]
    beyond = intensity - theta[1]
    value: float = above * math.atan(theta[3] * above) - beyond * math.atan(theta[2] * beyond)
    return value


@numba.njit(cache=True)
def arctan_recruitment_with_gradient(
    intensity: float, theta: FloatArray, gradient: FloatArray
) -> float:
    """Return `arctan_recruitment` and write its derivatives by theta into `gradient` (4,)."""
    above = intensity - theta[0]
    beyond = intensity - theta[1]
    thr = theta[3] * above
    sat = theta[2] * beyond
    thr_atan = math.atan(thr)
    sat_atan = math.atan(sat)
    thr_norm = 1.0 / (1.0 + thr * thr)
    sat_norm = 1.0 / (1.0 + sat * sat)
    gradient[0] = -(thr_atan + thr * thr_norm)
    gradient[1] = sat_atan + sat * sat_norm
    gradient[2] = -beyond * beyond * sat_norm
    gradient[3] = above * above * thr_norm
    value: float = above * thr_atan - beyond * sat_atan
    return value


@numba.njit(cache=True)
def _evaluate_all(intensity: FloatArray, theta: FloatArray) -> FloatArray:
    """Return rho (n,) at intensities (n,)."""
    offset = arctan_recruitment(0.0, theta)
    return np.array([arctan_recruitment(one, theta) - offset for one in intensity])


def identified_recruitment(
    parameters: RecruitmentParameters, intensity: npt.ArrayLike
) -> FloatArray:
    """Return rho(theta, u) of Eq. (30).

    Parameters
    ----------
    parameters : RecruitmentParameters
        theta_rho and alpha_thr.
    intensity : array_like, shape (...)
        Share of the maximum intensity.

    Returns
    -------
    ndarray, shape (...)
        Recruitment, without the gain, which is part of the linear dynamics; 0 at intensity 0.
    """
    values = np.asarray(intensity, dtype=np.float64)
    rho = _evaluate_all(values.ravel(), np.array(parameters, dtype=np.float64))
    return rho.reshape(values.shape)
