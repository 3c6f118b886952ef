# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Recruitment and summation of any shape: the paper's, and what the samples ask for besides.

**Recruitment.**  With A the arctangents of Eq. (30), less their value at intensity 0,

.. math:: \rho(u) = A(u) + A(1) \sum_{k=1}^{n} c_k \sin(k \pi u / 1.2) .

The sum is a Gaussian process with a Matern covariance of order 5/2 in the reduced-rank form of
Solin and Sarkka (2020): the c_k are independent, their variances are the spectral density of the
covariance at the frequencies of the sines.  The force at intensity 0 is 0 whatever they are.
Where the arctangents hold, the size of the deviation that makes the samples likeliest is nil.

**Summation.**  A pulse counts as much as the power kappa of the weight that Eq. (10) gives to it
by the interval before it: kappa is 1 if Eq. (10) holds and 0 for a muscle that adds its twitches.
One kappa is that of the intervals for which the weight is above 1, longer than those for which the
curve is stated, the other that of the shorter ones.
"""

import math

import numba
import numpy as np

from rpms_ros.muscle.recruitment import (
    PARAMETER_NAMES,
    arctan_recruitment,
    arctan_recruitment_with_gradient,
)
from rpms_ros.pulses import FloatArray

PARAMETERS = len(PARAMETER_NAMES)
"""Parameters of the arctangents: u_thr, u_sat, alpha_sat, alpha_thr."""
SINES, WINDOW_SINES, MOST_SINES = 20, 24, 32
"""Elements of c: of the recursion, of a window of a minute, and of a whole recording."""
SUMMATION = slice(-2, None)
"""Where kappa stands in theta, behind c: of longer and of shorter intervals."""
_LONGER, _SHORTER = -2, -1
# The sines vanish here, beyond every intensity.
_SPAN = 1.2
_FREQUENCY: FloatArray = np.arange(1.0, MOST_SINES + 1.0) * np.pi / _SPAN
_LEAST_WEIGHT = 1e-6


@numba.njit(cache=True)
def recruitment(intensity: float, theta: FloatArray) -> float:
    """Return rho at an intensity; `theta` is the arctangents (4,), or these and c (4 + sines,)."""
    offset = arctan_recruitment(0.0, theta)
    value: float = arctan_recruitment(intensity, theta) - offset
    if len(theta) > PARAMETERS:
        angle = math.pi * intensity / _SPAN
        before, sine, twice, total = 0.0, math.sin(angle), 2.0 * math.cos(angle), 0.0
        for place in range(PARAMETERS, len(theta)):
            total += theta[place] * sine
            before, sine = sine, twice * sine - before
        value += (arctan_recruitment(1.0, theta) - offset) * total
    return value


@numba.njit(cache=True)
def recruitment_with_gradient(intensity: float, theta: FloatArray, gradient: FloatArray) -> float:
    """Return `recruitment`; write its derivatives by theta, of its shape, into `gradient`.

    Those by alpha are by its logarithm.
    """
    zero, full = np.empty(PARAMETERS), np.empty(PARAMETERS)
    offset = arctan_recruitment_with_gradient(0.0, theta, zero)
    height = arctan_recruitment_with_gradient(1.0, theta, full) - offset
    value: float = arctan_recruitment_with_gradient(intensity, theta, gradient) - offset
    total = 0.0
    if len(theta) > PARAMETERS:
        angle = math.pi * intensity / _SPAN
        before, sine, twice = 0.0, math.sin(angle), 2.0 * math.cos(angle)
        for place in range(PARAMETERS, len(theta)):
            gradient[place] = height * sine
            total += theta[place] * sine
            before, sine = sine, twice * sine - before
        value += height * total
    for place in range(PARAMETERS):
        slope = gradient[place] - zero[place] + total * (full[place] - zero[place])
        gradient[place] = slope * (theta[place] if place >= 2 else 1.0)
    return value


@numba.njit(cache=True)
def counted(intensity: float, weight: float, theta: FloatArray) -> float:
    """Return the recruitment of a pulse times the weight by its interval.

    `theta` is the arctangents, c and kappa.
    """
    logarithm = math.log(max(weight, _LEAST_WEIGHT))
    power = theta[_LONGER] if logarithm > 0.0 else theta[_SHORTER]
    return math.exp(power * logarithm) * recruitment(intensity, theta[:-2])


@numba.njit(cache=True)
def counted_with_gradient(
    intensity: float, weight: float, theta: FloatArray, gradient: FloatArray
) -> float:
    """Return `counted`; write its derivatives by all of theta, alpha as logarithms."""
    logarithm = math.log(max(weight, _LEAST_WEIGHT))
    which = _LONGER if logarithm > 0.0 else _SHORTER
    factor = math.exp(theta[which] * logarithm)
    value: float = factor * recruitment_with_gradient(intensity, theta[:-2], gradient[:-2])
    for place in range(len(theta) - 2):
        gradient[place] *= factor
    gradient[-2:] = 0.0
    gradient[which] = value * logarithm
    return value


@numba.njit(cache=True)
def recruitment_curve(intensity: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rho (n,) and its derivatives (n, len(theta)), by the logarithms of alpha."""
    rho, slopes = np.empty(len(intensity)), np.empty((len(intensity), len(theta)))
    for index in range(len(intensity)):
        rho[index] = recruitment_with_gradient(intensity[index], theta, slopes[index])
    return rho, slopes


def deviation_variance(size: float, length: float) -> FloatArray:
    """Return the prior variances of c (`MOST_SINES`,).

    `size` is the standard deviation of the process, as a share of the recruitment at full
    intensity; `length` its length in units of the intensity.
    """
    peak = 2.0 * math.sqrt(math.pi) * math.gamma(3.0) * 5.0**2.5 / math.gamma(2.5) / length**5
    variance: FloatArray = (5.0 / length**2 + _FREQUENCY**2) ** -3
    result: FloatArray = size**2 * peak * 2.0 / _SPAN * variance
    return result


def coordinates(theta: FloatArray) -> FloatArray:
    """Return theta (n,) with alpha as logarithms."""
    return np.concatenate((theta[:2], np.log(theta[2:PARAMETERS]), theta[PARAMETERS:]))


def from_coordinates(values: FloatArray) -> FloatArray:
    """Return theta (n,) of its `coordinates`."""
    return np.concatenate((values[:2], np.exp(values[2:PARAMETERS]), values[PARAMETERS:]))
