# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stop buttons by presence: each says its state at a rate; one that is silent counts as pressed.

A button is known by the identity of its publisher.  One that is pressed, that has fallen silent,
or that is there and has said nothing yet stands against every pulse, whatever the others say.  One
that was named beforehand stands against every pulse while it is not there, too.

Whether a joystick's button is held, or a key that its terminal repeats.
"""

import enum
import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rpms_ros.pulses import nanoseconds

UNCOUNTED = 2**64 - 1
"""Number of every message where the middleware does not count them (Cyclone DDS)."""


class ButtonState(enum.IntEnum):
    """State of one button; values as in rpms_msgs/DriverStatus."""

    RELEASED = 0
    PRESSED = 1
    SILENT = 2
    UNKNOWN = 3


@dataclass
class _Button:
    """What one publisher said last.

    ``seen_ns`` is None until it has said something that was not kept for those who come late;
    ``noted`` is the newest message of a press that was noted; ``name`` is kept when it has gone.
    """

    sequence: int
    pressed: bool
    seen_ns: int | None = None
    noted: int = -1
    name: str = ''


class StopButtons:
    """Takes what buttons say and tells whether a pulse is possible; any thread may call it.

    Parameters
    ----------
    timeout_s : float
        Longest silence of a button [s].
    required : bool
        Whether there has to be a button at all.
    names : iterable of str
        Nodes of the buttons that have to be there, whatever is forgotten: full names, or the last
        parts of them.
    """

    def __init__(self, timeout_s: float, required: bool = True, names: Iterable[str] = ()) -> None:
        self._timeout_ns = nanoseconds(timeout_s)
        self._required, self._must_be = required, tuple(names)
        self._lock = threading.Lock()
        self._buttons: dict[bytes, _Button] = {}
        self._names: dict[bytes, str] = {}
        self._unheard = 0
        self._overrun = self._press = ''

    def heard(
        self, identity: bytes, sequence: int, pressed: bool, now_ns: int, kept: bool = False
    ) -> None:
        """Take what a button says; of its state the newest counts, of a press every one.

        Parameters
        ----------
        identity : bytes
            Of its publisher.
        sequence : int
            Counts what this publisher says.
        pressed : bool
            Its state.
        now_ns : int
            Now, monotonic clock [ns].
        kept : bool
            Whether it may have been said long ago and was kept: that is no sign of life.
        """
        with self._lock:
            if identity not in self._buttons and identity in self._names:
                self._unheard = max(0, self._unheard - 1)
            button = self._buttons.setdefault(identity, _Button(sequence, pressed=False))
            # one that was kept may be long over, unless something live came before it
            new = not kept or (button.seen_ns is not None and sequence > button.sequence)
            if pressed and new:
                unnoted = sequence > button.noted or sequence == UNCOUNTED
                if unnoted and not button.pressed:
                    self._press = f'emergency stop is pressed ({self._name(identity)})'
                button.noted = max(button.noted, sequence)
            if sequence < button.sequence:
                return
            button.sequence, button.pressed = sequence, pressed
            if not kept:
                button.seen_ns = now_ns

    def overrun(self, reason: str) -> None:
        """Note that messages may have been lost: the newest of a button is not known."""
        with self._lock:
            self._overrun = reason

    def present(self, names: Mapping[bytes, str]) -> None:
        """Take over which publishers there are, with a name for each to show."""
        with self._lock:
            self._names = dict(names)
            for identity in names.keys() & self._buttons.keys():
                self._buttons[identity].name = names[identity]
            self._count_unheard()

    def states(self, now_ns: int) -> list[tuple[str, ButtonState]]:
        """Return name and state of each button; those of one node have one name."""
        with self._lock:
            states = [
                (self._name(identity), self._judged(identity, now_ns)[0])
                for identity in self._buttons
            ]
            if self._unheard:
                states += [
                    (name, ButtonState.UNKNOWN)
                    for identity, name in self._names.items()
                    if identity not in self._buttons
                ]
            return states

    @property
    def pressed(self) -> bool:
        """Whether a button said last that it is pressed."""
        with self._lock:
            return any(button.pressed for button in self._buttons.values())

    def taken_press(self) -> str:
        """Return that a button was pressed since this was last asked; empty if none was.

        It may be released again: two messages can come between two looks at them.
        """
        with self._lock:
            press, self._press = self._press, ''
            return press

    def problem(self, now_ns: int) -> str | None:
        """Return why no pulse is possible, None if every button says that it is released."""
        with self._lock:
            if self._overrun:
                return self._overrun
            for identity in self._buttons:
                if problem := self._judged(identity, now_ns)[1]:
                    return problem
            if self._unheard:
                return f'expected every stop button to speak, got {self._unheard} still unknown'
            if self._required and not self._buttons:
                return 'expected a stop button that says its state at a rate, got none'
            # every button that is known is released by now
            known = {self._names.get(identity, '') for identity in self._buttons}
            known |= {name.rpartition('/')[2] for name in known}
            for name in self._must_be:
                if name not in known:
                    return (
                        f'expected stop button {name} on the graph, speaking and released, '
                        'got none'
                    )
            return None

    def forget_gone(self) -> None:
        """Forget released buttons that have left the graph; part of a reset.

        One that said it is pressed and went away stays: only `clear` lets go of it.
        """
        with self._lock:
            self._overrun = ''
            for identity in [*self._buttons]:
                if identity not in self._names and not self._buttons[identity].pressed:
                    del self._buttons[identity]
            # with one gone fewer are known: one that came meanwhile counts from now on
            self._count_unheard()

    def clear(self) -> None:
        """Forget every button; they have to say their state again."""
        with self._lock:
            self._buttons.clear()
            self._overrun = ''
            self._count_unheard()

    def _count_unheard(self) -> None:
        # counted, not compared: some middlewares show another identity than they send
        self._unheard = max(0, len(self._names) - len(self._buttons))

    def _judged(self, identity: bytes, now_ns: int) -> tuple[ButtonState, str]:
        """Return the state of a button, and why it stands against a pulse, empty if not."""
        button, name = self._buttons[identity], self._name(identity)
        if button.pressed:
            return ButtonState.PRESSED, f'emergency stop is pressed ({name})'
        expected = f'expected stop button {name} to say its state'
        if button.seen_ns is None:
            return ButtonState.UNKNOWN, f'{expected}, got nothing yet'
        silent_ns = now_ns - button.seen_ns
        if silent_ns > self._timeout_ns:
            limit_s, age_s = self._timeout_ns / 1e9, silent_ns / 1e9
            silence = f'{expected} every {limit_s:g} s, got silence for {age_s:.3g} s'
            return ButtonState.SILENT, silence
        return ButtonState.RELEASED, ''

    def _name(self, identity: bytes) -> str:
        button = self._buttons.get(identity)
        return self._names.get(identity) or (button.name if button else '') or identity.hex()


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
        last_ns = self._last_ns
        return self._repeated and last_ns is not None and now_ns - last_ns <= self._repeat_ns


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
