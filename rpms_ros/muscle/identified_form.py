# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recruitment curve in the form that is identified, Eq. (30), with its derivatives.

Its gain is 1 (the gain is part of the linear dynamics), its offset that for which rho(0) = 0::

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
def _evaluate_all(
    intensity: FloatArray,
    theta: FloatArray,
    rho: FloatArray,
    gradient: FloatArray,
) -> None:
    """Write rho (n,) and its derivatives (n, 4) at intensities (n,)."""
    origin = np.empty(len(theta))
    offset = arctan_recruitment_with_gradient(0.0, theta, origin)
    for index in range(len(intensity)):
        rho[index] = (
            arctan_recruitment_with_gradient(intensity[index], theta, gradient[index]) - offset
        )
        for place in range(len(theta)):
            gradient[index, place] -= origin[place]


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
        Recruitment, without the gain, which is part of the linear dynamics; 0 at intensity 0.
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
    _evaluate_all(flat, np.array(parameters, dtype=np.float64), rho, gradient)
    return rho.reshape(values.shape), gradient.reshape((*values.shape, len(PARAMETER_NAMES)))
