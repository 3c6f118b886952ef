# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the page calls the quantities of an estimate, and in which unit it shows them."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from rpms_ros.report.named import RATE_WORDS
from rpms_ros.report.named import label


class Label(NamedTuple):
    """How a quantity is shown: its name with its unit, and what its value is multiplied by."""

    text: str
    factor: float = 1.0


PARAMETERS: Mapping[str, Label] = MappingProxyType(
    {
        **{name: Label(label(name)) for name in ('u_thr', 'u_sat', 'alpha_sat', 'alpha_thr')},
        'twitch_time_constant_s': Label(f'{label("twitch_time_constant_s")} [ms]', 1e3),
        'latency_s': Label(f'{label("latency_s")} [ms]', 1e3),
        'order': Label(label('order')),
        'twitch_peak_n': Label(f'{label("twitch_peak_n")} [{{unit}}]'),
    }
)
"""Labels of the parameters and of what is derived from them; `{unit}` is that of the sensor."""

RATES: Mapping[str, Label] = {name: Label(words) for name, words in RATE_WORDS.items()}
"""Labels of the rates of change per minute."""


def label_of(name: str, labels: Mapping[str, Label], unit: str) -> Label:
    """Return how a quantity is shown; one of somebody else's estimator keeps its name."""
    known = labels.get(name)
    return known._replace(text=known.text.replace('{unit}', unit)) if known else Label(name)
