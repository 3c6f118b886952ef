# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Numbers and texts of anybody as the page can carry them: valid JSON of bounded length."""

from collections.abc import Iterable

import numpy as np

from rpms_ros.pulses import FloatArray

LONGEST_TEXT = 300
MOST_NAMES = 60
_DIGITS = 5
# The largest double is infinite with five digits, which JSON does not have.
_LARGEST = 1e300


def number(value: float) -> float | None:
    """Return a number with five digits, None if it is not finite or beyond `_LARGEST`."""
    value = float(value)
    return float(f'{value:.{_DIGITS}g}') if abs(value) <= _LARGEST else None


def numbers(values: Iterable[float]) -> list[float | None]:
    """Return what `number` makes of each."""
    return [number(value) for value in values]


def text(value: object) -> str:
    """Return a text without control characters, cut where it is too long."""
    shown = ''.join(sign if sign.isprintable() else ' ' for sign in str(value)[: LONGEST_TEXT + 1])
    return shown if len(shown) <= LONGEST_TEXT else f'{shown[:LONGEST_TEXT]} …'


def texts(values: Iterable[object]) -> list[str]:
    """Return the first texts of many."""
    return [text(value) for _, value in zip(range(MOST_NAMES), values, strict=False)]


def thinned(length: int, most: int) -> slice | FloatArray:
    """Return which of `length` elements to show so that there are at most `most`, ends included.

    Returns
    -------
    slice or ndarray of int, shape (most,)
        An index of an array.
    """
    if length <= most:
        return slice(None)
    return np.unique(np.linspace(0, length - 1, most).astype(np.int64))
