# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the page calls the quantities of an estimate, and in which unit it shows them."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple


class Label(NamedTuple):
    """How a quantity is shown: its name with its unit, and what its value is multiplied by."""

    text: str
    factor: float = 1.0


PARAMETERS: Mapping[str, Label] = MappingProxyType(
    {
        'u_thr': Label('threshold u_thr'),
        'u_sat': Label('saturation u_sat'),
        'alpha_sat': Label('bend at the saturation alpha_sat'),
        'alpha_thr': Label('bend at the threshold alpha_thr'),
        'twitch_time_constant_s': Label('time constant T_a [ms]', 1e3),
        'latency_s': Label('latency of the model [ms]', 1e3),
        'order': Label('order of the response'),
        'twitch_peak_n': Label('peak after one pulse [{unit}]'),
    }
)
"""Labels of the parameters and of what is derived from them; `{unit}` is that of the sensor."""

RATES: Mapping[str, Label] = MappingProxyType(
    {
        'force_percent': Label('steady force [%]'),
        'time_constant_percent': Label('time constant T_a [%]'),
        'u_thr': Label('threshold u_thr'),
        'u_sat': Label('saturation u_sat'),
    }
)
"""Labels of the rates of change per minute."""


def label_of(name: str, labels: Mapping[str, Label], unit: str) -> Label:
    """Return how a quantity is shown; one of somebody else's estimator keeps its name."""
    known = labels.get(name)
    return known._replace(text=known.text.replace('{unit}', unit)) if known else Label(name)
