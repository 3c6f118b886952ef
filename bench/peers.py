# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a lab would write by itself: other estimators of the curve, and the bound of all of them.

Each peer takes (time, force, onset, intensity) as `rpms_ros.from_arrays` does and returns the
curve at the intensities `U`, at 20 Hz.  `scipy` knows the family of the muscle, recruitment and
twitch, and fits its eight parameters to all samples.  `polynomial` is a Hammerstein model that is
linear in its parameters, powers of the intensity times Laguerre functions: the least squares that
recursive least squares approach.  `ekf` is an extended Kalman filter of the muscle's three states
and seven parameters; the latency, which it cannot estimate, is 10 ms for it.
"""

import math

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.interpolate import BSpline
from scipy.optimize import least_squares

RATE = 20.0
U = np.linspace(0.0, 1.0, 101)
START = np.array([0.45, 0.8, math.log(6.0), math.log(6.0), math.log(40e-3), 10e-3])


def recruited(u, p):
    """Return Eq. (9) without the factor, p = thr, sat, logarithms of both alphas."""

    def shape(v):
        low, high = v - p[0], v - p[1]
        return low * np.arctan(np.exp(p[2]) * low) - high * np.arctan(np.exp(p[3]) * high)

    return shape(u) - shape(0.0 * u)


def twitches(time, onset, size, constant, latency):
    """Return the sum of third-order twitches of area 1."""
    force, step = np.zeros(len(time)), time[1] - time[0]
    length = math.ceil(0.9 / step)
    for at, each in zip(onset, size, strict=True):
        first = np.searchsorted(time, at + latency)
        lag = (time[first : first + length] - at - latency) / constant
        force[first : first + length] += each * lag**2 * np.exp(-lag) / (2.0 * constant)
    return force


def modelled(p, time, onset, intensity):
    """Return the force of p = (recruitment, log time constant, latency, gain, baseline)."""
    size = p[6] * recruited(intensity, p)
    return p[7] + twitches(time, onset, size, math.exp(p[4]), p[5])


def slopes(p, time, onset, intensity):
    """Return the derivatives of `modelled` by p (samples, 8)."""
    columns = []
    for place, width in enumerate((1e-4, 1e-4, 1e-3, 1e-3, 1e-4, 1e-5, 1e-4 * p[6], 1e-3)):
        step = np.zeros(8)
        step[place] = width
        ends = (modelled(p + way * step, time, onset, intensity) for way in (1.0, -1.0))
        columns.append(np.subtract(*ends) / (2.0 * width))
    return np.column_stack(columns)


def bound(p, time, onset, intensity, deviation):
    """Return the least standard deviation (101,) of the curve that an unbiased estimator has."""
    gradient = slopes(p, time, onset, intensity)
    scale = 1.0 / np.linalg.norm(gradient, axis=0)
    covariance = np.linalg.inv((gradient * scale).T @ (gradient * scale))
    covariance *= deviation**2 * np.outer(scale, scale)
    curve = np.zeros((len(U), 8))
    for place in (0, 1, 2, 3, 6):
        step = np.zeros(8)
        step[place] = 1e-5
        ends = (RATE * (p + way * step)[6] * recruited(U, p + way * step) for way in (1.0, -1.0))
        curve[:, place] = np.subtract(*ends) / 2e-5
    return np.sqrt(np.einsum('ij,jk,ik->i', curve, covariance, curve))


def free_bound(p, time, onset, intensity, deviation, coefficients=24, functions=6):
    """Return the same of one that is unbiased for any recruitment and any response.

    Any: cubic splines of so many coefficients, without force at zero; sums of so many functions.
    """
    ends = np.repeat([0.0, 1.0], 3)
    knots = np.sort(np.concatenate((ends, np.linspace(0.0, 1.0, coefficients - 2))))
    given, seen = (
        BSpline.design_matrix(np.clip(u, 0.0, 1.0 - 1e-9), knots, 3).toarray()[:, 1:]
        for u in (intensity, U)
    )
    place, length = np.searchsorted(time, onset), next_fast_len(2 * len(time))
    lag = np.maximum(time[time < 0.9 + time[0]] - time[0] - p[5], 0.0) / math.exp(p[4])
    gammas = [
        lag**order * np.exp(-lag) / math.factorial(order) / math.exp(p[4])
        for order in range(1, functions + 1)
    ]

    def force(size, response):
        drive = np.zeros(len(time))
        np.add.at(drive, place, size)
        return irfft(rfft(drive, length) * rfft(response, length), length)[: len(time)]

    sizes = p[6] * recruited(intensity, p)
    gradient = np.column_stack(
        [force(one, gammas[1]) for one in given.T]
        + [force(sizes, one) for one in gammas]
        + [np.ones(len(time))]
    )
    if not gradient.any(axis=0).all():
        # a part of the curve at which no pulse was has none
        return np.full(len(U), np.nan)
    scale = 1.0 / np.linalg.norm(gradient, axis=0)
    # a factor of the recruitment is one of the response: the curve is their product
    covariance = np.linalg.pinv((gradient * scale).T @ (gradient * scale), 1e-12)
    covariance *= deviation**2 * np.outer(scale, scale)
    whole = RATE * p[6] * recruited(U, p)
    by = np.column_stack((RATE * seen, *[whole] * functions, 0.0 * U))
    return np.sqrt(np.einsum('ij,jk,ik->i', by, covariance, by))


def by_scipy(time, force, onset, intensity):
    gain = np.ptp(force) / (RATE * np.ptp(recruited(U, START)))
    start = np.concatenate((START, [gain, float(force.min())]))
    found = least_squares(
        lambda p: modelled(p, time, onset, intensity) - force,
        start,
        lambda p: slopes(p, time, onset, intensity),
        bounds=([0, 0, 0, 0, math.log(5e-3), 0, 0, -np.inf], [1, 1.5, 5, 5, 0, 0.05, 1e3, np.inf]),
        x_scale=[0.1, 0.1, 0.5, 0.5, 0.3, 5e-3, gain, 1.0],
        max_nfev=60,
    ).x
    return RATE * found[6] * recruited(U, found)


def by_polynomial(time, force, onset, intensity, powers=5, functions=6, constant=25e-3):
    lag = np.arange(0.0, 0.9, time[1] - time[0])
    late = lag - 8e-3
    kernels = [
        np.where(late > 0.0, late**order * np.exp(-np.maximum(late, 0.0) / constant), 0.0)
        / (math.factorial(order) * constant ** (order + 1))
        for order in range(1, functions + 1)
    ]
    place = np.searchsorted(time, onset)
    drive = np.zeros((powers, len(time)))
    for power in range(powers):
        drive[power, place] = intensity ** (power + 1)
    columns = [np.convolve(one, kernel)[: len(time)] for one in drive for kernel in kernels] + [
        np.ones(len(time))
    ]
    found = np.linalg.lstsq(np.column_stack(columns), force, rcond=None)[0]
    area = found[:-1].reshape(powers, functions).sum(axis=1)
    return RATE * sum(size * U ** (power + 1) for power, size in enumerate(area))


def by_ekf(time, force, onset, intensity, latency=10e-3):
    step = 4 * (time[1] - time[0])
    force, time = force[::4], time[::4]
    # three states of the twitch, recruitment (4), logarithms of time constant and gain, baseline
    gain = math.log(np.ptp(force) / (RATE * np.ptp(recruited(U, START))))
    x = np.concatenate((np.zeros(3), START[:5], [gain, float(force.min())]))
    covariance = np.diag([0.0, 0.0, 0.0, 0.01, 0.01, 0.1, 0.1, 0.1, 0.1, 0.01])
    drift = np.diag([0.0, 0.0, 0.0, *np.full(6, 1e-8), 1e-8])
    noise = 4.0 * float(np.std(np.diff(force, 2)) / math.sqrt(6.0)) ** 2
    due = np.searchsorted(time, onset + latency)

    def advanced(x, pulse):
        y = x.copy()
        rate = math.exp(-x[7])
        a, b = math.exp(-step * rate), step * rate
        if pulse is not None:
            y[0] += math.exp(x[8]) * rate * recruited(np.array([pulse]), x[3:7])[0]
        y[2] = a * (y[2] + b * y[1] + 0.5 * b * b * y[0])
        y[1] = a * (y[1] + b * y[0])
        y[0] *= a
        return y

    pulse_at = dict(zip(due.tolist(), intensity.tolist(), strict=False))
    measured = np.zeros(10)
    measured[2] = measured[9] = 1.0
    for index, one in enumerate(force):
        pulse = pulse_at.get(index)
        after = advanced(x, pulse)
        jacobian = np.empty((10, 10))
        for place in range(10):
            moved = x.copy()
            moved[place] += 1e-6
            jacobian[:, place] = (advanced(moved, pulse) - after) / 1e-6
        covariance = jacobian @ covariance @ jacobian.T + drift
        gain = covariance @ measured / (measured @ covariance @ measured + noise)
        x = after + gain * (one - after[2] - after[9])
        x[3:9] = np.clip(x[3:9], [0.05, 0.3, 0, 0, -5, -5], [0.95, 1.4, 4, 4, -2, 6])
        covariance -= np.outer(gain, measured @ covariance)
    return RATE * math.exp(x[8]) * recruited(U, x[3:7])
