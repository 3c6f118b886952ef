# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Variance of what a fit leaves of the samples of a window, and how much neighbours are alike."""

import numba
import numpy as np

from rpms_ros.identification.projection.fit import LEAST_ENERGY
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.tracking.assembly import Point
from rpms_ros.identification.tracking.assembly import at_ages
from rpms_ros.identification.tracking.intervals import Intervals
from rpms_ros.identification.tracking.knowledge import coordinates
from rpms_ros.identification.tracking.stretching import stretched
from rpms_ros.pulses import FloatArray

# The model's error is at least this share of the force's mean square, for so many samples.
_MODEL_ERROR = 1e-4
_MODEL_ERROR_SAMPLES = 200.0


@numba.njit(cache=True)
def _left(
    intervals: Intervals,
    theta: FloatArray,
    point: Point,
    gain: FloatArray,
    delay: FloatArray,
    age: FloatArray,
    levels: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return what the linear model after a step leaves: scores (intervals, columns) and squares.

    `theta` is the step of theta, `point` is after it; gain, logarithm of the relative time
    constant and age (counted in intervals) have a value for each interval.
    """
    count, columns = intervals.right.shape
    functions = len(point.linear)
    scores = np.zeros((count, columns))
    squares = np.zeros(count)
    coefficients = np.zeros(columns)
    for index in range(count):
        coefficients[:PARAMETERS] = gain[index] * theta
        for slope in range(len(point.slope)):
            coefficients[slope] += gain[index] * age[index] * point.slope[slope]
        response = stretched(point.linear, delay[index])
        for function in range(functions):
            coefficients[PARAMETERS + function] = gain[index] * response[function]
        coefficients[columns - 2] = levels[index]
        coefficients[columns - 1] = levels[index + 1]
        squares[index] = intervals.energy[index]
        for row in range(columns):
            total = intervals.right[index, row]
            for column in range(columns):
                total -= intervals.gram[index, row, column] * coefficients[column]
            scores[index, row] = total
            squares[index] -= coefficients[row] * (intervals.right[index, row] + total)
    return scores, squares


def noise_of(
    intervals: Intervals,
    before: Point,
    point: Point,
    levels: FloatArray,
    now: float,
    spacing: float,
    unknowns: int,
) -> tuple[float, float]:
    """Return the variance of the residuals [N^2], and a factor for those that are alike.

    Parameters
    ----------
    intervals : Intervals
        At `before`.
    before, point : Point
        Where the equations were linearised, and after the step.
    levels : ndarray (intervals + 1,)
        Disturbance at the ends of the intervals [N].
    now : float
        The muscle now, in intervals from the first one's beginning.
    spacing : float
        Distance of the knots of gain and slowing, in intervals.
    unknowns : int
        How many were fitted.

    Returns
    -------
    tuple
        Variance; factor of at least 1 by which neighbouring residuals tell less than independent
        ones.
    """
    local = PARAMETERS + len(before.linear)
    count = len(intervals.samples)
    total_samples = float(intervals.samples.sum())
    power = float(intervals.energy.sum()) / max(total_samples, 1.0)
    age = np.maximum(now - (np.arange(count) + 0.5), 0.0)
    gain = 1.0 + at_ages(point.gain, age / spacing)
    delay = at_ages(point.slowing, age / spacing)
    theta = coordinates(point.theta) - coordinates(before.theta)
    scores, squares = _left(intervals, theta, point, gain, delay, age, levels)
    total = max(float(squares.sum()), 0.0)
    freedom = max(total_samples - float(unknowns + 1), 1.0) + _MODEL_ERROR_SAMPLES
    floor = _MODEL_ERROR_SAMPLES * _MODEL_ERROR * power
    variance = (total + floor) / freedom + LEAST_ENERGY
    some = intervals.samples > 0.0
    scores = (gain[:, None] * scores)[some, :local]
    scatter = scores.T @ scores
    for lag in (1, 2, 3):
        cross = scores[lag:].T @ scores[:-lag]
        scatter += (1.0 - lag / 4.0) * (cross + cross.T)
    steady = np.einsum('j,jkl->kl', gain**2, intervals.gram[:, :local, :local])
    scale = 1.0 / np.sqrt(np.maximum(np.diag(steady), 1e-300))
    scaled = steady * np.outer(scale, scale) + 1e-6 * np.eye(local)
    ratio = np.trace(np.linalg.solve(scaled, scatter * np.outer(scale, scale)))
    return variance, max(1.0, float(ratio) / (local * variance))
