# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the page shows of a stimulator driver."""

from typing import Any

from rpms_ros.live.numbers import MOST_NAMES
from rpms_ros.live.numbers import number
from rpms_ros.live.numbers import text

STATES = ('unconfigured', 'disarmed', 'armed', 'running', 'stopped', 'fault')
BUTTONS = ('released', 'pressed', 'silent', 'unknown')
STOPPED = 'stopped'


def driver_view(message: Any) -> dict[str, Any]:
    """Return an rpms_msgs/DriverStatus as JSON takes it."""
    return {
        'state': _word(STATES, message.state),
        'reason': text(message.reason),
        'schedule': text(message.schedule),
        'segment': int(message.segment) + 1 if message.segments else 0,
        'segments': int(message.segments),
        'time_left': number(message.time_left),
        'commanded': int(message.pulses_commanded),
        'delivered': int(message.pulses_delivered),
        'dropped': int(message.pulses_dropped),
        'unverified': int(message.pulses_unverified),
        'coil_energy': number(message.coil_energy),
        'coil_temperature': number(message.coil_temperature),
        'lateness_max': number(message.lateness_max),
        'device': text(message.device),
        'maximum_intensity': number(message.maximum_intensity),
        'operator': text(message.operator_id),
        'enabled': bool(message.enabled),
        'dose_pulses': int(message.dose_pulses),
        'dose_energy': number(message.dose_energy),
        'faults': _pairs(message.fault_names, [int(count) for count in message.fault_counts]),
        'buttons': _pairs(
            message.button_names, [_word(BUTTONS, state) for state in message.button_states]
        ),
    }


def _word(words: tuple[str, ...], value: int) -> str:
    return words[value] if 0 <= value < len(words) else f'state {int(value)}'


def _pairs(names: Any, values: list[Any]) -> list[list[Any]]:
    return [[text(name), value] for name, value in zip(names, values, strict=False)][:MOST_NAMES]
