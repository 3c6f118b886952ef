# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a muscle as people read them: what they are, in which unit, with an interval."""

import math
from collections.abc import Mapping
from statistics import NormalDist
from typing import Any

from rpms_ros.report.text import with_interval

_SHARE = ' of the maximum'
# A wider interval is everything.
_MOST_LOGARITHM = 50.0
_WORDS = {
    'u_thr': 'threshold u_thr',
    'u_sat': 'saturation u_sat',
    'alpha_thr': 'sharpness alpha_thr',
    'alpha_sat': 'sharpness alpha_sat',
    'twitch_time_constant_s': 'time constant T_a',
    'latency_s': 'delay of the model',
    'order': 'order of the twitch',
    'twitch_peak_n': 'peak of the twitch',
}
RATE_WORDS = {
    'force_percent': 'steady force, % a minute',
    'time_constant_percent': 'T_a of the twitch, % a minute',
    'u_thr': 'threshold, share of the maximum a minute',
    'u_sat': 'saturation, share of the maximum a minute',
}
"""Rates of change, by name."""

NOT_A_TWITCH = (
    'not the course of a twitch of the model: the twitch stated is the closest to it; rely on '
    'neither peak'
)


def is_no_twitch(result: Mapping[str, Any]) -> bool:
    """Return whether the intervals of two peaks have nothing in common.

    They are that of the identified response and that of the twitch which was fitted to it.

    Parameters
    ----------
    result : mapping
        The JSON of `rpms identify`.
    """
    twitch = result.get('physiology', {}).get('twitch_peak_n')
    response = result['impulse_response']
    if twitch is None or 'lower' not in response:
        return False
    place = response['force'].index(max(response['force']))
    return bool(
        twitch['upper'] < response['lower'][place] or response['upper'][place] < twitch['lower']
    )


def label(name: str) -> str:
    """Return what a parameter is; its name if that is not known."""
    return _WORDS.get(name, name)


def interval_of(
    name: str, value: float, deviation: float | None, confidence: float | None
) -> tuple[float, float] | None:
    """Return the ends of the interval of a parameter of the recruitment curve, if there is one.

    Those of the sharpness alpha are symmetric in their logarithm, in which they are estimated.

    Parameters
    ----------
    name : str
        Of the parameter.
    value, deviation : float
        Estimate and its standard deviation, None or NaN if that is not known.
    confidence : float
        Level of the interval, None if the estimator states none.
    """
    if deviation is None or not confidence or not math.isfinite(deviation):
        return None
    width = NormalDist().inv_cdf(0.5 + 0.5 * confidence) * deviation
    if not (name.startswith('alpha') and value > 0):
        return value - width, value + width
    factor = math.exp(min(width / value, _MOST_LOGARITHM))
    return value / factor, value * factor


def recruitment_shown(
    name: str,
    value: float | None,
    deviation: float | None = None,
    confidence: float | None = None,
    flag: str | None = None,
) -> str:
    """Return a parameter of the recruitment curve with its interval, and how well it is known.

    Parameters
    ----------
    name, value, deviation, confidence
        As in `interval_of`.
    flag : str
        One of `rpms_ros.report.result.IDENTIFIABILITY`.
    """
    if value is None or not math.isfinite(value):
        return 'the data do not determine it'
    lower, upper = interval_of(name, value, deviation, confidence) or (None, None)
    text = shown(name, {'value': value, 'lower': lower, 'upper': upper}, '')
    return f'{text}, known roughly' if flag == 'informed' else text


def shown(name: str, found: Mapping[str, float | None], unit: str) -> str:
    """Return a parameter in its unit, with its interval.

    Parameters
    ----------
    name : str
        Of the parameter.
    found : mapping
        ``value``, ``lower``, ``upper``, in the unit of the name.
    unit : str
        Of every force: N or N m.
    """
    if name.startswith('u_'):
        return with_interval(found, after=_SHARE)
    if name.endswith('_s'):
        return with_interval(found, 1e3, ' ms')
    return with_interval(found, unit=f' {unit}' if name.endswith('_n') else '')
