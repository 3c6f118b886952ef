# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is held: a key that repeats, a button of a joystick that speaks."""

from rpms_ros.stimulation.held import HeldKey
from rpms_ros.stimulation.held import JoystickButton


def test_a_key_is_held_while_it_repeats() -> None:
    key = HeldKey(0.5)
    assert not key.held(0)
    key.came(0)
    assert key.held(500_000_000)
    assert not key.held(500_000_001)


def test_a_joystick_button_counts_while_the_joystick_speaks() -> None:
    button = JoystickButton(1, 0.5)
    assert button.used
    assert button.down(0) is None
    button.heard([0], 0)
    assert button.down(0) is None
    button.heard([0, 1], 0)
    assert button.down(500_000_000) is True
    assert button.down(500_000_001) is None
    button.heard([1, 0], 1)
    assert button.down(1) is False
    assert not JoystickButton(-1, 0.5).used
