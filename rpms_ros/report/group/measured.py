# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Numbers of several recordings with their intervals: how they differ, and how they spread."""

from collections.abc import Iterable
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
from statistics import NormalDist
from typing import Any

import numpy as np

from rpms_ros.axis import QUANTITIES as QUANTITY_OF_UNIT

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Quantity:
    """A column of the table of a study that is compared.

    Attributes
    ----------
    column : str
        Its name; the ends of the interval are ``..._lower`` and ``..._upper``.
    label, unit : str
        For people.
    scale : float
        How many of `unit` a one in the column is.
    """

    column: str
    label: str
    unit: str
    scale: float = 1.0


QUANTITIES = (
    Quantity('u_thr', 'Threshold', '%', 100.0),
    Quantity('steady_force_50', 'Force at 50 %', 'N'),
    Quantity('steady_force_100', 'Force at 100 %', 'N'),
    Quantity('twitch_time_constant_s', 'T_a', 'ms', 1e3),
    Quantity('train_peak_force', 'Peak of trains', 'N'),
)
"""Those that no recording has are left out of a page."""


def quantities_of(rows: Iterable[Row]) -> tuple[Quantity, ...]:
    """Return the quantities of a study: torques in N m where torques were measured."""
    unit = next((str(row['unit']) for row in rows if row.get('unit')), 'N')
    if unit == 'N':
        return QUANTITIES
    what = QUANTITY_OF_UNIT.get(unit, 'force').capitalize()
    return tuple(
        replace(one, label=one.label.replace('Force', what), unit=unit) if one.unit == 'N' else one
        for one in QUANTITIES
    )


@dataclass(frozen=True)
class Measured:
    """A number with its interval, whose ends are None if there is none."""

    value: float
    lower: float | None = None
    upper: float | None = None

    @property
    def half_width(self) -> float | None:
        """Half of the interval's width; None without one."""
        if self.lower is None or self.upper is None:
            return None
        return 0.5 * (self.upper - self.lower)


@dataclass(frozen=True)
class Spread:
    """How a number spreads over recordings.

    Attributes
    ----------
    count : int
        Recordings that have it.
    mean, median, lowest, highest : float
        Over them.
    deviation : float or None
        Standard deviation of the numbers; None of fewer than two.
    between : float or None
        The part of it that the intervals of the recordings do not explain; None where fewer than
        two have intervals.
    """

    count: int
    mean: float
    median: float
    lowest: float
    highest: float
    deviation: float | None
    between: float | None


def usable(row: Row) -> bool:
    """Return whether the numbers of a recording may be used."""
    return bool(row['status'] == 'ok' and row['verdict'] != 'no')


def measured(row: Row, quantity: Quantity) -> Measured | None:
    """Return a number of a recording in its unit; None if it has none or must not be used."""
    value = row.get(quantity.column)
    if not usable(row) or value is None:
        return None
    ends = (row.get(f'{quantity.column}_{end}') for end in ('lower', 'upper'))
    return Measured(value * quantity.scale, *_scaled(ends, quantity.scale))


def _scaled(ends: Any, scale: float) -> list[float | None]:
    return [None if one is None else float(one) * scale for one in ends]


def change(now: Measured, before: Measured) -> Measured:
    """Return how much more there is now, with the interval of two independent numbers."""
    difference = now.value - before.value
    widths = now.half_width, before.half_width
    if widths[0] is None or widths[1] is None:
        return Measured(difference)
    width = float(np.hypot(widths[0], widths[1]))
    return Measured(difference, difference - width, difference + width)


def spread_of(found: Sequence[Measured], confidence: float = 0.95) -> Spread | None:
    """Return how numbers spread; None without any.

    The spread between recordings is the moment estimate of DerSimonian and Laird (1986),
    Controlled Clinical Trials 7:177, with weights ``1 / s^2`` of the recordings' standard errors.

    Parameters
    ----------
    found : sequence of Measured
        One a recording.
    confidence : float
        Level of their intervals.
    """
    if not found:
        return None
    values = np.array([one.value for one in found])
    known = [one for one in found if one.half_width]
    return Spread(
        len(found),
        float(values.mean()),
        float(np.median(values)),
        float(values.min()),
        float(values.max()),
        float(values.std(ddof=1)) if len(values) > 1 else None,
        _between(known, confidence) if len(known) > 1 else None,
    )


def _between(found: Sequence[Measured], confidence: float) -> float:
    quantile = NormalDist().inv_cdf(0.5 + 0.5 * confidence)
    values = np.array([one.value for one in found])
    error = np.array([one.half_width for one in found], dtype=np.float64) / quantile
    weight = 1.0 / error**2
    mean = np.sum(weight * values) / np.sum(weight)
    excess = np.sum(weight * (values - mean) ** 2) - (len(values) - 1)
    scale = np.sum(weight) - np.sum(weight**2) / np.sum(weight)
    return float(np.sqrt(max(excess / scale, 0.0)))
