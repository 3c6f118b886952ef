# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a joystick's button is held, or a key that its terminal repeats."""

from collections.abc import Sequence

from rpms_ros.pulses import nanoseconds


class HeldKey:
    """A key is held while the terminal keeps repeating it, from the first repetition on.

    A terminal tells neither that a key goes down nor that it comes up.  So one that is tapped is
    not held, and one that is let go of is held until its next repetition is overdue.

    Parameters
    ----------
    delay_s : float
        Longest time from the key to its first repetition [s].
    repeat_s : float
        Longest time between two repetitions [s].
    """

    def __init__(self, delay_s: float, repeat_s: float) -> None:
        self._delay_ns, self._repeat_ns = nanoseconds(delay_s), nanoseconds(repeat_s)
        self._last_ns: int | None = None
        self._repeated = False

    def came(self, now_ns: int) -> None:
        """Note that the key came."""
        due_ns = self._repeat_ns if self._repeated else self._delay_ns
        self._repeated = self._last_ns is not None and now_ns - self._last_ns <= due_ns
        self._last_ns = now_ns

    def held(self, now_ns: int) -> bool:
        """Return whether it is held."""
        if not self._repeated or self._last_ns is None:
            return False
        return now_ns - self._last_ns <= self._repeat_ns


class JoystickButton:
    """A button of a joystick counts only while the joystick sends messages.

    Parameters
    ----------
    index : int
        Which button, from 0; negative for none.
    timeout_s : float
        Longest silence of the joystick [s].
    """

    def __init__(self, index: int, timeout_s: float) -> None:
        self._index = index
        self._timeout_ns = nanoseconds(timeout_s)
        self._last: tuple[int, bool] | None = None

    @property
    def used(self) -> bool:
        """Whether there is to be one."""
        return self._index >= 0

    def heard(self, buttons: Sequence[int], now_ns: int) -> None:
        """Take the state of all buttons."""
        if self._index < len(buttons):
            self._last = now_ns, bool(buttons[self._index])

    def down(self, now_ns: int) -> bool | None:
        """Return whether it is pressed; None if the joystick is silent or has no such button."""
        if self._last is None or now_ns - self._last[0] > self._timeout_ns:
            return None
        return self._last[1]
