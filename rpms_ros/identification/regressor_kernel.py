# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Separable regressors of one force sample from the pulses that act on it, Eqs. (15) and (16).

Of every pulse the basis at its lag is needed, which does not depend on the nonlinear parameters,
and its recruitment, which does.  The basis is evaluated once a sample and used again for the
regressors of a trial step.
"""

import numba

from rpms_ros.identification.basis import distorted_sines
from rpms_ros.muscle.identified_form import arctan_recruitment
from rpms_ros.muscle.identified_form import arctan_recruitment_with_gradient
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray


@numba.njit(cache=True)
def basis_of_pulses(
    stamp_ns: int,
    onset_ns: IntArray,
    first: int,
    last: int,
    shape: FloatArray,
    values: FloatArray,
) -> None:
    """Write the raw basis of pulses first..last-1 into rows 0.. of `values`.

    Parameters
    ----------
    stamp_ns : int
        Time of the sample [ns].
    onset_ns : ndarray of int64, shape (pulses,)
        Onsets [ns].
    first, last : int
        The pulses that can act.
    shape : ndarray (3,)
        Tap [ns], memory [taps], form factor [taps].
    values : ndarray (rows, functions)
        Zero where a pulse lies outside the support.
    """
    for pulse in range(first, last):
        row = pulse - first
        tap = (stamp_ns - onset_ns[pulse]) / shape[0]
        if not distorted_sines(tap, shape[1], shape[2], values[row]):
            values[row, :] = 0.0


@numba.njit(cache=True)
def regress(
    intensity: FloatArray,
    first: int,
    last: int,
    theta: FloatArray,
    values: FloatArray,
    raw: FloatArray,
) -> None:
    """Write ``sum_q rho(theta, u_q) r~(lag_q)`` into `raw` (functions,)."""
    offset = arctan_recruitment(0.0, theta)
    raw[:] = 0.0
    for pulse in range(first, last):
        rho = arctan_recruitment(intensity[pulse], theta) - offset
        for function in range(len(raw)):
            raw[function] += rho * values[pulse - first, function]


@numba.njit(cache=True)
def regress_with_gradient(
    intensity: FloatArray,
    first: int,
    last: int,
    theta: FloatArray,
    values: FloatArray,
    raw: FloatArray,
    raw_gradient: FloatArray,
    scratch: FloatArray,
) -> bool:
    """Write the sums of `regress` and of its derivatives; return whether any pulse recruits.

    Parameters
    ----------
    raw : ndarray (functions,)
        As in `regress`.
    raw_gradient : ndarray (parameters, functions)
        ``sum_q d rho / d theta_j r~(lag_q)`` for the leading parameters of theta.
    scratch : ndarray (2, 4)
        Overwritten.
    """
    offset = arctan_recruitment_with_gradient(0.0, theta, scratch[0])
    raw[:] = 0.0
    raw_gradient[:] = 0.0
    recruits = False
    for pulse in range(first, last):
        rho = arctan_recruitment_with_gradient(intensity[pulse], theta, scratch[1]) - offset
        recruits = recruits or rho != 0.0
        for function in range(len(raw)):
            raw[function] += rho * values[pulse - first, function]
        for place in range(len(raw_gradient)):
            slope = scratch[1, place] - scratch[0, place]
            for function in range(len(raw)):
                raw_gradient[place, function] += slope * values[pulse - first, function]
    return recruits


@numba.njit(cache=True)
def mix(mixing: FloatArray, raw: FloatArray, regressor: FloatArray) -> None:
    """Write ``mixing raw`` (functions,), mixing lower triangular, into `regressor`."""
    for function in range(len(raw)):
        total = 0.0
        for other in range(function + 1):
            total += mixing[function, other] * raw[other]
        regressor[function] = total
