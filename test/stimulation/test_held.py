# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is held: a key that repeats, a button of a joystick that speaks."""

from rpms_ros.stimulation.driver.stop_buttons import HeldKey, JoystickButton

MILLISECOND = 1_000_000


def test_a_key_is_held_from_its_first_repetition_on() -> None:
    key = HeldKey(0.5, 0.2)
    assert not key.held(0)
    key.came(0)
    assert not key.held(0)
    key.came(500 * MILLISECOND)
    assert key.held(700 * MILLISECOND)
    assert not key.held(700 * MILLISECOND + 1)


def test_a_tap_is_not_a_hold_however_often() -> None:
    key = HeldKey(0.5, 0.2)
    for tap in range(5):
        key.came(501 * MILLISECOND * tap)
        assert not key.held(501 * MILLISECOND * tap)


def test_after_a_release_the_key_has_to_repeat_again() -> None:
    key = HeldKey(0.5, 0.2)
    for now in (0, 400, 430, 460):
        key.came(now * MILLISECOND)
    assert key.held(660 * MILLISECOND)
    # within the time of a first repetition, but it is none
    key.came(700 * MILLISECOND)
    assert not key.held(700 * MILLISECOND)
    key.came(1100 * MILLISECOND)
    assert key.held(1100 * MILLISECOND)


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
