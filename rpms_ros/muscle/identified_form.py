"""The recruitment curve in the form that is identified, Eq. (30), with its derivatives.

Gain 1 (the linear dynamics carry it) and the offset for which rho(0) = 0::

    rho(u) = T(u - u_thr, a_thr) - T(u - u_sat, a_sat) - T(-u_thr, a_thr) + T(-u_sat, a_sat)
    T(x, a) = x atan(a x)

With ``B(x, a) = dT/dx = atan(a x) + a x / (1 + (a x)^2)`` and
``A(x, a) = dT/da = x^2 / (1 + (a x)^2)`` the four derivatives are differences of two terms.
"""

import math
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from rpms_ros.pulses import FloatArray

PARAMETER_NAMES = ('u_thr', 'u_sat', 'alpha_sat', 'alpha_thr')


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


@numba.njit(cache=True)
def evaluate_with_gradient(
    intensity: float,
    u_thr: float,
    u_sat: float,
    alpha_sat: float,
    alpha_thr: float,
    gradient: FloatArray,
) -> float:
    """Return rho and write its derivatives by the four parameters into `gradient` (4,)."""
    above = intensity - u_thr
    beyond = intensity - u_sat
    above_bend = alpha_thr * above
    beyond_bend = alpha_sat * beyond
    thr_bend = alpha_thr * u_thr
    sat_bend = alpha_sat * u_sat
    above_atan = math.atan(above_bend)
    beyond_atan = math.atan(beyond_bend)
    thr_atan = math.atan(thr_bend)
    sat_atan = math.atan(sat_bend)
    above_norm = 1.0 / (1.0 + above_bend * above_bend)
    beyond_norm = 1.0 / (1.0 + beyond_bend * beyond_bend)
    thr_norm = 1.0 / (1.0 + thr_bend * thr_bend)
    sat_norm = 1.0 / (1.0 + sat_bend * sat_bend)
    gradient[0] = -(above_atan + above_bend * above_norm) - (thr_atan + thr_bend * thr_norm)
    gradient[1] = (beyond_atan + beyond_bend * beyond_norm) + (sat_atan + sat_bend * sat_norm)
    gradient[2] = u_sat * u_sat * sat_norm - beyond * beyond * beyond_norm
    gradient[3] = above * above * above_norm - u_thr * u_thr * thr_norm
    bends = above * above_atan - beyond * beyond_atan
    return bends - u_thr * thr_atan + u_sat * sat_atan


@numba.njit(cache=True)
def _evaluate_all(
    intensity: FloatArray,
    u_thr: float,
    u_sat: float,
    alpha_sat: float,
    alpha_thr: float,
    rho: FloatArray,
    gradient: FloatArray,
) -> None:
    """Write rho (n,) and its derivatives (n, 4) at intensities (n,)."""
    for index in range(len(intensity)):
        rho[index] = evaluate_with_gradient(
            intensity[index], u_thr, u_sat, alpha_sat, alpha_thr, gradient[index]
        )


def identified_recruitment(
    parameters: RecruitmentParameters,
    intensity: npt.ArrayLike,
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
        Recruitment up to the gain that the linear dynamics carry; 0 at intensity 0.
    """
    return identified_recruitment_with_gradient(parameters, intensity)[0]


def identified_recruitment_with_gradient(
    parameters: RecruitmentParameters,
    intensity: npt.ArrayLike,
) -> tuple[FloatArray, FloatArray]:
    """Return rho(theta, u), shape (...), and its derivatives, shape (..., 4).

    The last axis is in the order of `PARAMETER_NAMES`.
    """
    values = np.asarray(intensity, dtype=np.float64)
    flat = np.atleast_1d(values).ravel()
    rho = np.empty(len(flat))
    gradient = np.empty((len(flat), len(PARAMETER_NAMES)))
    _evaluate_all(flat, *(float(value) for value in parameters), rho, gradient)
    return rho.reshape(values.shape), gradient.reshape((*values.shape, len(PARAMETER_NAMES)))
