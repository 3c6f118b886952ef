# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Monotone regression: a check of the shape of the recruitment that assumes no formula."""

import numpy as np

from rpms_ros.pulses import FloatArray

_ROUNDS = 200
_SETTLED = 1e-10


def rising(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the least-squares fit (points,) that never falls: pool adjacent violators.

    Parameters
    ----------
    values, weights : ndarray, shape (points,)
        Values and their weights, in the order of the abscissa.
    """
    means: list[float] = []
    sizes: list[float] = []
    counts: list[int] = []
    for value, weight in zip(values, weights, strict=True):
        means.append(float(value))
        sizes.append(float(weight))
        counts.append(1)
        while len(means) > 1 and means[-2] > means[-1]:
            total = sizes[-2] + sizes[-1]
            mean = (means[-2] * sizes[-2] + means[-1] * sizes[-1]) / max(total, 1e-300)
            means[-2:] = [mean]
            sizes[-2:] = [total]
            counts[-2:] = [counts[-2] + counts[-1]]
    return np.repeat(means, counts)


def rising_product(
    row: FloatArray, column: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Fit values at (row, column) with a product of two rising functions (Eq. 8).

    Alternates between the factors; each step is a weighted monotone regression of the ratios.

    Parameters
    ----------
    row, column : ndarray, shape (points,)
        Abscissae: intensity and rate.
    values : ndarray, shape (points,)
        Forces.

    Returns
    -------
    row_levels, row_factor : ndarray, shape (rows,)
        Distinct abscissae and the factor there, at most 1.
    column_levels, column_factor : ndarray, shape (columns,)
        The same for the other, in the unit of the values.
    """
    row_levels, row_of = np.unique(row, return_inverse=True)
    column_levels, column_of = np.unique(column, return_inverse=True)
    factor = np.linspace(0.0, 1.0, len(row_levels)) if len(row_levels) > 1 else np.ones(1)
    other = np.ones(len(column_levels))
    for _ in range(_ROUNDS):
        before = factor[row_of] * other[column_of]
        other = _factor(column_of, len(column_levels), factor[row_of], values)
        factor = _factor(row_of, len(row_levels), other[column_of], values)
        scale = max(float(np.abs(factor).max()), 1e-300)
        factor, other = factor / scale, other * scale
        change = np.abs(factor[row_of] * other[column_of] - before).max()
        if change <= _SETTLED * max(float(np.abs(values).max()), 1e-300):
            break
    return row_levels, factor, column_levels, other


def _factor(
    level_of: np.ndarray, levels: int, known: FloatArray, values: FloatArray
) -> FloatArray:
    weight = np.bincount(level_of, known**2, levels)
    product = np.bincount(level_of, known * values, levels)
    ratio = product / np.maximum(weight, 1e-300)
    return rising(np.where(weight > 0, ratio, 0.0), np.maximum(weight, 1e-12))
