# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimates as a table: one row each, with the columns that any of them has."""

import json
from collections.abc import Sequence
from itertools import chain

import numpy as np

from rpms_ros.identification import Estimate
from rpms_ros.pulses import FloatArray
from rpms_ros.recording.exporting import EstimateTable
from rpms_ros.report.result import IDENTIFIABILITY

_SHARES = (25, 50, 75, 100)


def estimate_table(estimates: Sequence[Estimate]) -> EstimateTable:
    """Return estimates as a table.

    Columns: the parameters by their names, each with its standard deviation and whether the data
    determine it; steady force at a quarter, half, three quarters and all of the intensity and the
    numbers of the response, each with the ends of its interval; rates of change, disturbance,
    output error, counts; name of the estimator, faults and doubts.

    Parameters
    ----------
    estimates : sequence of Estimate
        In their order.
    """
    rows = [_numbers(one) for one in estimates]
    texts = [_texts(one) for one in estimates]
    numbers = dict.fromkeys(chain.from_iterable(rows))
    words = dict.fromkeys(chain.from_iterable(texts))
    return EstimateTable(
        np.array([one.stamp_ns for one in estimates], dtype=np.int64),
        {name: np.array([row.get(name, np.nan) for row in rows]) for name in numbers},
        {name: [row.get(name, '') for row in texts] for name in words},
    )


def _numbers(one: Estimate) -> dict[str, float]:
    found: dict[str, float] = {}
    variance = np.diag(one.nonlinear_covariance)
    for index, (name, value) in enumerate(
        zip(one.nonlinear_names, one.nonlinear.tolist(), strict=False)
    ):
        found[name] = value
        if index < len(variance) and variance[index] >= 0.0:
            found[f'{name}_deviation'] = float(np.sqrt(variance[index]))
    for share in _SHARES:
        curves = (one.curve_force, one.curve_lower, one.curve_upper)
        found |= _banded(f'steady_force_{share}', *(_at(one, share, curve) for curve in curves))
    bands = (one.physiology, one.physiology_lower, one.physiology_upper)
    found |= _listed(one.physiology_names, *bands)
    found |= _listed(one.rate_names, one.rate, one.rate_lower, one.rate_upper)
    return found | {
        'disturbance': one.disturbance,
        'disturbance_deviation': one.disturbance_deviation,
        'output_error': one.output_error,
        'confidence': one.confidence,
        'repetition_rate_hz': one.repetition_rate,
        'samples': float(one.samples),
        'pulses': float(one.pulses),
        'changes': float(one.changes),
    }


def _at(one: Estimate, share: int, curve: FloatArray) -> float:
    if not len(curve) or len(curve) != len(one.curve_intensity):
        return float('nan')
    return float(np.interp(share / 100.0, one.curve_intensity, curve))


def _listed(
    names: Sequence[str], values: FloatArray, lower: FloatArray, upper: FloatArray
) -> dict[str, float]:
    """Return values with their intervals by names; NaN where an array is shorter."""
    found: dict[str, float] = {}
    for index, name in enumerate(names):
        ends = (
            float(one[index]) if index < len(one) else float('nan')
            for one in (values, lower, upper)
        )
        found |= _banded(name, *ends)
    return found


def _banded(name: str, value: float, lower: float, upper: float) -> dict[str, float]:
    return {name: value, f'{name}_lower': lower, f'{name}_upper': upper}


def _texts(one: Estimate) -> dict[str, str]:
    flags = one.nonlinear_identifiability.tolist()
    return {
        'estimator': one.estimator,
        'faults': json.dumps(dict(one.faults), sort_keys=True),
        'doubts': '; '.join(one.doubts),
        **{
            f'{name}_determined': IDENTIFIABILITY.get(flag, '')
            for name, flag in zip(one.nonlinear_names, flags, strict=False)
        },
    }
