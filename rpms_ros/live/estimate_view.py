# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the page shows of an estimate."""

from collections.abc import Iterable
from collections.abc import Iterator
from collections.abc import Mapping
from typing import Any

import numpy as np

from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.faults import MEANING
from rpms_ros.identification.plausibility import meaning_of_doubt
from rpms_ros.live.numbers import MOST_NAMES
from rpms_ros.live.numbers import number
from rpms_ros.live.numbers import numbers
from rpms_ros.live.numbers import text
from rpms_ros.live.numbers import texts
from rpms_ros.live.numbers import thinned
from rpms_ros.live.words import PARAMETERS
from rpms_ros.live.words import RATES
from rpms_ros.live.words import Label
from rpms_ros.live.words import label_of
from rpms_ros.pulses import FloatArray
from rpms_ros.report.named import interval_of

IDENTIFIABILITY = ('not in the data', 'still moving', 'settled')
"""Words for `NOT_INFORMED`, `INFORMED` and `CONVERGED`."""

MOST_POINTS = 101
"""Points of a curve that are sent."""

_NANOSECONDS = 1e-9


def estimate_view(estimate: Estimate, origin_ns: int) -> dict[str, Any]:
    """Return an estimate as JSON takes it; times in s after `origin_ns`.

    Each parameter is a row of label, value, lower and upper bound, and what the data say of it. A
    value that the data do not bound is None: it is the value that the estimator began with.
    """
    stamp = (estimate.stamp_ns - origin_ns) * _NANOSECONDS
    unit = text(estimate.unit) or 'N'
    meanings = [_plain(meaning_of_doubt(name)) for name in estimate.doubts[:MOST_NAMES]]
    return {
        'estimator': text(estimate.estimator),
        'unit': unit,
        'stamp': number(stamp),
        'samples': estimate.samples,
        'pulses': estimate.pulses,
        'output_error': number(estimate.output_error),
        'confidence': number(estimate.confidence),
        'rate': number(estimate.repetition_rate),
        'curve': _curve(
            estimate.curve_intensity,
            estimate.curve_force,
            estimate.curve_lower,
            estimate.curve_upper,
        ),
        'response': _curve(
            estimate.response_time,
            estimate.response_force,
            estimate.response_lower,
            estimate.response_upper,
        ),
        'parameters': _parameters(estimate, unit),
        'physiology': _rows(
            _labels(estimate.physiology_names, PARAMETERS, unit),
            estimate.physiology,
            estimate.physiology_lower,
            estimate.physiology_upper,
        ),
        'rates': _rows(
            _labels(estimate.rate_names, RATES, unit),
            estimate.rate,
            estimate.rate_lower,
            estimate.rate_upper,
        ),
        'changes': estimate.changes,
        'marks': [
            [text(kind), number(stamp - ago)]
            for kind, ago in zip(estimate.change_kinds, estimate.change_ago, strict=False)
        ][-MOST_NAMES:],
        'disturbance': number(estimate.disturbance),
        'disturbance_deviation': number(estimate.disturbance_deviation),
        'doubts': [
            [text(name), meaning]
            for name, meaning in zip(estimate.doubts[:MOST_NAMES], meanings, strict=True)
        ],
        # some are the meaning of a doubt, which is shown with its name
        'reasons': texts(one for one in estimate.reasons if _plain(one) not in meanings),
        'faults': [
            [text(name), int(count), _plain(MEANING.get(name, ''))]
            for name, count in list(estimate.faults.items())[:MOST_NAMES]
        ],
    }


def _curve(
    along: FloatArray, force: FloatArray, lower: FloatArray, upper: FloatArray
) -> dict[str, Any] | None:
    if not len(force) or len(force) != len(along):
        return None
    shown = thinned(len(along), MOST_POINTS)
    parts = {
        name: line[shown]
        for name, line in (('along', along), ('force', force), ('lower', lower), ('upper', upper))
        if len(line) == len(along)
    }
    values = numbers(np.concatenate(list(parts.values())))
    count = len(values) // len(parts)
    each = {name: values[place * count :][:count] for place, name in enumerate(parts)}
    return {'lower': None, 'upper': None, **each}


def _rows(
    labels: Iterable[Label], values: FloatArray, lower: FloatArray, upper: FloatArray
) -> list[list[Any]]:
    """Return rows of label, value and bounds, None where there are none."""
    bounded = len(lower) == len(upper) == len(values)
    return [
        [
            text(label.text),
            number(label.factor * value),
            number(label.factor * lower[place]) if bounded else None,
            number(label.factor * upper[place]) if bounded else None,
        ]
        for place, (label, value) in enumerate(zip(labels, values, strict=False))
    ][:MOST_NAMES]


def _labels(names: Iterable[str], labels: Mapping[str, Label], unit: str) -> Iterator[Label]:
    return (label_of(name, labels, unit) for name in names)


def _plain(meaning: str) -> str:
    """Return a meaning as a page shows it: names in it are not marked as in documents."""
    return meaning.replace('`', '')


def _parameters(estimate: Estimate, unit: str) -> list[list[Any]]:
    values, flags = estimate.nonlinear, estimate.nonlinear_identifiability
    variance = np.diag(estimate.nonlinear_covariance)
    bounds = np.full((2, len(values)), np.nan)
    if len(variance) == len(values) and 0.5 < 0.5 + 0.5 * estimate.confidence < 1.0:
        deviations = np.sqrt(np.where(variance >= 0.0, variance, np.nan))
        known = zip(estimate.nonlinear_names[:MOST_NAMES], values, deviations, strict=False)
        for place, (name, value, deviation) in enumerate(known):
            ends = interval_of(name, value, deviation, estimate.confidence)
            bounds[:, place] = ends or np.nan
    rows = _rows(_labels(estimate.nonlinear_names, PARAMETERS, unit), values, *bounds)
    for row, flag in zip(rows, flags, strict=False):
        row.append(IDENTIFIABILITY[flag] if 0 <= flag < len(IDENTIFIABILITY) else '')
        if flag == 0:
            row[1:4] = [None, None, None]
    return rows
