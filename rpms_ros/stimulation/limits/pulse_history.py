# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Books of the pulses that were fired, in the quantities that limits are stated in.

Times are whole nanoseconds.  The shortest interval at a rate is the period in whole nanoseconds,
rounded downwards: onsets of a plan are rounded to the nearest, so no interval of a plan at exactly
its rate limit is shorter than that, whatever the rate.
"""

import math
from collections import deque
from collections.abc import Iterable
from copy import copy
from typing import Self

from rpms_ros.pulses import NANOSECONDS_PER_SECOND, nanoseconds
from rpms_ros.stimulation.limits.dose import BookedPulse
from rpms_ros.stimulation.limits.limits import Limits


def period_ns(rate_hz: float) -> int:
    """Return the shortest interval [ns] between two onsets at a rate."""
    return math.floor(NANOSECONDS_PER_SECOND / rate_hz)


class Books:
    """What was fired: the last pulse, its train, the window of the mean power, the session.

    Parameters
    ----------
    limits : Limits
        In whose terms it is counted.
    tolerance_s : float, optional
        Tolerance of an interval [s]; that of the limits if it is missing.

    Attributes
    ----------
    last_ns : int or None
        Onset of the last pulse [ns].
    last_intensity : float
        Its intensity (share).
    counted_ns : int
        When it was due at its rate limit: intervals are counted from there, so the tolerance of
        many pulses does not add up [ns].
    train_start_ns, train_pulses, train_energy_j : int, int, float
        First onset [ns], pulses and energy [J] of the train that it belongs to.
    window : deque of (int, float)
        Onset [ns] and energy [J] of the pulses within the window of the mean power.
    window_energy_j : float
        Their energy [J].
    known : deque of (int, float)
        Onsets [ns] and intensities (shares) that the subject knows, each stronger than all after
        it, so that the first is the strongest.
    session_pulses, session_energy_j : int, float
        Pulses and energy [J] of the session.
    """

    def __init__(self, limits: Limits, tolerance_s: float | None = None) -> None:
        self.limits = limits
        tolerance = limits.interval_tolerance_s if tolerance_s is None else tolerance_s
        self.tolerance_ns = nanoseconds(tolerance)
        self.pause_ns = nanoseconds(limits.minimum_pause_s)
        self.window_ns = nanoseconds(limits.energy_window_s)
        self.last_ns: int | None = None
        self.last_intensity = 0.0
        self.counted_ns = 0
        self.train_start_ns = 0
        self.train_pulses = 0
        self.train_energy_j = 0.0
        self.window: deque[tuple[int, float]] = deque()
        self.window_energy_j = 0.0
        self.rise_ns = nanoseconds(limits.rise_window_s)
        self.known: deque[tuple[int, float]] = deque()
        self.session_pulses = 0
        self.session_energy_j = 0.0

    def book(self, time_ns: int, intensity: float) -> None:
        """Count a pulse that is about to be fired: booked first, so that a fault counts too."""
        self._book(time_ns, intensity, self.limits.energy_j(intensity))

    def book_history(self, pulses: Iterable[BookedPulse]) -> None:
        """Count what earlier processes fired, oldest first.

        Rest, trains and power count whatever this device or this patient had; the session is the
        patient's.  No intensity counts as known: the subject may be another one, or have rested.
        """
        for pulse in pulses:
            session = self.session_pulses, self.session_energy_j
            # clocks of two processes agree to some microseconds: time does not go back here
            latest = pulse.time_ns if self.last_ns is None else max(pulse.time_ns, self.last_ns)
            self._book(latest, pulse.intensity, pulse.energy_j)
            if not pulse.on_patient:
                self.session_pulses, self.session_energy_j = session
        self.known.clear()

    def _book(self, time_ns: int, intensity: float, energy_j: float) -> None:
        if self.starts_train(time_ns):
            self.train_start_ns, self.train_pulses, self.train_energy_j = time_ns, 0, 0.0
            self.counted_ns = time_ns
        else:
            due = self.rate_due_ns(intensity)[0]
            # what was booked against the limit leaves no debt to the next one
            early = time_ns < due - self.tolerance_ns
            self.counted_ns = time_ns if early else max(time_ns, due)
        self.train_pulses += 1
        self.train_energy_j += energy_j
        self.window.append((time_ns, energy_j))
        self.window_energy_j += energy_j
        self.last_ns, self.last_intensity = time_ns, intensity
        while self.known and self.known[-1][1] <= intensity:
            self.known.pop()
        self.known.append((time_ns, intensity))
        self.session_pulses += 1
        self.session_energy_j += energy_j
        self.forget(time_ns)

    def book_more(self, time_ns: int, energy_j: float) -> None:
        """Count energy [J] that pulses turn out at ``time_ns`` [ns] to have had besides."""
        self.train_energy_j += energy_j
        self.window.append((time_ns, energy_j))
        self.window_energy_j += energy_j
        self.session_energy_j += energy_j

    def correct(self, time_ns: int) -> None:
        """Move the last pulse to when the device gave it [ns], if that was later than booked."""
        if self.last_ns is None or time_ns <= self.last_ns:
            return
        if self.train_pulses == 1:
            self.train_start_ns = time_ns
        self.last_ns = time_ns
        self.counted_ns = max(self.counted_ns, time_ns)
        self.window[-1] = (time_ns, self.window[-1][1])

    def forget(self, time_ns: int) -> None:
        """Forget what has left the windows of mean power and of rise at ``time_ns`` [ns]."""
        while self.window and self.window[0][0] <= time_ns - self.window_ns:
            self.window_energy_j -= self.window.popleft()[1]
        if not self.window:
            self.window_energy_j = 0.0
        while self.known and self.known[0][0] < time_ns - self.rise_ns:
            self.known.popleft()

    def starts_train(self, time_ns: int) -> bool:
        """Return whether a pulse at ``time_ns`` [ns] would be the first of a train."""
        return self.last_ns is None or time_ns - self.last_ns >= self.pause_ns

    def rate_due_ns(self, intensity: float) -> tuple[int, float]:
        """Return when the next pulse is due at its rate limit [ns], and that rate [Hz]."""
        # both pulses of an interval take part: the stronger one decides
        rate = self.limits.highest_rate_hz(max(intensity, self.last_intensity))
        return self.counted_ns + period_ns(rate), rate

    def earliest_ns(self, intensity: float) -> int:
        """Return when the rate limits let a pulse of this intensity come [ns]; 0 for at once."""
        if self.last_ns is None:
            return 0
        return max(self.last_ns + 1, self.rate_due_ns(intensity)[0] - self.tolerance_ns)

    @property
    def wait_s(self) -> float:
        """Silence that the train so far has to be followed by [s]; 0 before the first pulse."""
        if self.last_ns is None:
            return 0.0
        span = (self.last_ns - self.train_start_ns) / NANOSECONDS_PER_SECOND
        return self.limits.wait_s(self.train_pulses, self.train_energy_j, span)

    def copied(self) -> Self:
        """Return books with the same entries, for a trial."""
        other = copy(self)
        other.window = deque(self.window)
        other.known = deque(self.known)
        return other
