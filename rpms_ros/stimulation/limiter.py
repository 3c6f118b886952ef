"""The limiter: every pulse passes it, right before the device is told to fire.

The limiter remembers what was fired, so that rates, trains, energy and totals hold whatever gave
the pulses: one schedule, several in a row, or a fault.  It outlives disarming and a device that
was closed and opened again; only a new driver begins a new session.
"""

import math
from collections import deque
from collections.abc import Iterator
from copy import copy
from typing import NamedTuple

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.stimulation.limits import Limits

# Onsets are whole nanoseconds: a planned interval may be short by the rounding of both its ends.
_ROUNDING_NS = 2


class Refusal(NamedTuple):
    """Why a pulse may not be fired.

    Attributes
    ----------
    limit : str
        Name of the limit, as in `Limits` or in a device specification.
    reason : str
        What was expected and what came, in plain words.
    """

    limit: str
    reason: str


TIMING_LIMITS = ('maximum_rate_hz', 'rate_limits_hz')
"""Limits that a pulse can break by the jitter of the one before it alone."""


class PulseLimiter:
    """Holds pulses, one by one, against limits.

    Parameters
    ----------
    limits : Limits
        What no pulse may go beyond.
    tolerance_s : float, optional
        Tolerance of an interval [s]; that of the limits if it is missing.
    """

    def __init__(self, limits: Limits, tolerance_s: float | None = None) -> None:
        self.limits = limits
        tolerance = limits.interval_tolerance_s if tolerance_s is None else tolerance_s
        self._tolerance_ns = round(tolerance * NANOSECONDS_PER_SECOND) + _ROUNDING_NS
        self._pause_ns = round(limits.minimum_pause_s * NANOSECONDS_PER_SECOND)
        self._window_ns = round(limits.energy_window_s * NANOSECONDS_PER_SECOND)
        self._last_ns: int | None = None
        self._last_intensity = 0.0
        # when the last pulse was due at its rate limit: intervals are counted from there, so the
        # tolerance of many pulses does not add up
        self._counted_ns = 0
        self._train_start_ns = 0
        self._train_pulses = 0
        self._train_energy_j = 0.0
        self._window: deque[tuple[int, float]] = deque()
        self._window_energy_j = 0.0
        self.session_pulses = 0
        self.session_energy_j = 0.0

    def refusal(self, time_ns: int, intensity: float, width_s: float) -> Refusal | None:
        """Return why a pulse may not be fired, or None if it may.

        Parameters
        ----------
        time_ns : int
            When it would be fired [ns], on a clock that never jumps.
        intensity : float
            Share of the maximum, 0..1.
        width_s : float
            Duration [s].
        """
        return next(self.refusals(time_ns, intensity, width_s), None)

    def refusals(self, time_ns: int, intensity: float, width_s: float) -> Iterator[Refusal]:
        """Yield everything that stands against a pulse, as `refusal` does the first."""
        for found in (
            self._by_shape(intensity, width_s),
            self._by_step(time_ns, intensity),
            self._by_interval(time_ns, intensity),
            self._by_train(time_ns),
            self._by_energy(time_ns, intensity),
            self._by_session(intensity),
        ):
            if found is not None:
                yield found

    def book(self, time_ns: int, intensity: float) -> None:
        """Count a pulse that is about to be fired: booked first, so that a fault counts too."""
        energy = self.limits.energy_j(intensity)
        if self._last_ns is None or self._new_train(time_ns):
            self._train_start_ns, self._train_pulses, self._train_energy_j = time_ns, 0, 0.0
            self._counted_ns = time_ns
        else:
            earliest = self._earliest_ns(intensity)[0]
            # a pulse that a forecast books against the limit leaves no debt to the next one
            early = time_ns < earliest - self._tolerance_ns
            self._counted_ns = time_ns if early else max(time_ns, earliest)
        self._train_pulses += 1
        self._train_energy_j += energy
        self._window.append((time_ns, energy))
        self._window_energy_j += energy
        self._last_ns, self._last_intensity = time_ns, intensity
        self.session_pulses += 1
        self.session_energy_j += energy

    def correct(self, time_ns: int) -> None:
        """Move the last pulse to when the device gave it [ns], if that was later than booked."""
        if self._last_ns is not None and time_ns > self._last_ns:
            self._last_ns = time_ns
            self._counted_ns = max(self._counted_ns, time_ns)

    def earliest_ns(self, intensity: float) -> int:
        """Return when the rate limits let a pulse of this intensity come [ns]; 0 for at once."""
        if self._last_ns is None:
            return 0
        return max(self._last_ns + 1, self._earliest_ns(intensity)[0] - self._tolerance_ns)

    def trial(self) -> 'PulseLimiter':
        """Return a limiter with the same memory that tolerates no jitter: plans have none."""
        other = copy(self)
        other._window = deque(self._window)
        other._tolerance_ns = _ROUNDING_NS
        return other

    @property
    def wait_s(self) -> float:
        """Silence that the train so far has to be followed by [s]; 0 before the first pulse."""
        if self._last_ns is None:
            return 0.0
        span = (self._last_ns - self._train_start_ns) / NANOSECONDS_PER_SECOND
        return self.limits.wait_s(self._train_pulses, self._train_energy_j, span)

    def _new_train(self, time_ns: int) -> bool:
        return self._last_ns is None or time_ns - self._last_ns >= self._pause_ns

    def _earliest_ns(self, intensity: float) -> tuple[int, float]:
        """Return when the next pulse is due at its rate limit [ns], and that rate [Hz]."""
        # both pulses of an interval take part: the stronger one decides
        rate = self.limits.highest_rate_hz(max(intensity, self._last_intensity))
        return self._counted_ns + round(NANOSECONDS_PER_SECOND / rate), rate

    def _by_shape(self, intensity: float, width_s: float) -> Refusal | None:
        limits = self.limits
        # written so that NaN fails
        if not 0.0 <= intensity <= limits.maximum_intensity:
            return Refusal(
                'maximum_intensity',
                f'expected an intensity in [0, {limits.maximum_intensity:g}], got {intensity:g}',
            )
        if limits.minimum_width_s <= width_s <= limits.maximum_width_s:
            return None
        which = 'minimum_width_s' if width_s < limits.minimum_width_s else 'maximum_width_s'
        return Refusal(
            which,
            f'expected a width in [{limits.minimum_width_s:g}, {limits.maximum_width_s:g}] s, '
            f'got {width_s:g} s',
        )

    def _by_step(self, time_ns: int, intensity: float) -> Refusal | None:
        before = 0.0 if self._new_train(time_ns) else self._last_intensity
        step = abs(intensity - before)
        # the difference of two shares is rounded once
        if step <= self.limits.maximum_intensity_step + math.ulp(1.0):
            return None
        return Refusal(
            'maximum_intensity_step',
            f'expected a step of at most {self.limits.maximum_intensity_step:g} from {before:g}, '
            f'got {intensity:g}',
        )

    def _by_interval(self, time_ns: int, intensity: float) -> Refusal | None:
        if self._last_ns is None:
            return None
        if time_ns >= self.earliest_ns(intensity):
            return None
        rate = self._earliest_ns(intensity)[1]
        gap = (time_ns - self._last_ns) / NANOSECONDS_PER_SECOND
        strongest = max(intensity, self._last_intensity)
        which = 'maximum_rate_hz' if rate == self.limits.maximum_rate_hz else 'rate_limits_hz'
        return Refusal(
            which,
            f'expected at most {rate:g} Hz at intensity {strongest:.3g}, '
            f'got {gap:.4g} s after the pulse before',
        )

    def _by_train(self, time_ns: int) -> Refusal | None:
        if self._last_ns is None:
            return None
        if not self._new_train(time_ns):
            if self._train_pulses < self.limits.maximum_train_pulses:
                return None
            return Refusal(
                'maximum_train_pulses',
                f'expected a pause of {self.limits.minimum_pause_s:g} s after at most '
                f'{self.limits.maximum_train_pulses} pulses, got one pulse more',
            )
        gap_ns = time_ns - self._last_ns
        if gap_ns + _ROUNDING_NS >= self.wait_s * NANOSECONDS_PER_SECOND:
            return None
        return Refusal(
            'wait',
            f'expected a wait of {self.wait_s:.3g} s after a train of {self._train_pulses} pulses '
            f'and {self._train_energy_j:.4g} J, got {gap_ns / NANOSECONDS_PER_SECOND:.3g} s',
        )

    def _by_energy(self, time_ns: int, intensity: float) -> Refusal | None:
        while self._window and self._window[0][0] <= time_ns - self._window_ns:
            self._window_energy_j -= self._window.popleft()[1]
        if not self._window:
            self._window_energy_j = 0.0
        energy = self._window_energy_j + self.limits.energy_j(intensity)
        most = self.limits.window_energy_j
        # relative rounding of a sum of thousands of pulses
        if energy <= most * (1.0 + 1e-9):
            return None
        return Refusal(
            'continuous_power_w',
            f'expected at most {most:.4g} J in {self.limits.energy_window_s:g} s '
            f'({self.limits.continuous_power_w:g} W), got {energy:.4g} J',
        )

    def _by_session(self, intensity: float) -> Refusal | None:
        if self.session_pulses >= self.limits.session_pulses:
            return Refusal(
                'session_pulses',
                f'expected at most {self.limits.session_pulses} pulses a session, got one more',
            )
        energy = self.session_energy_j + self.limits.energy_j(intensity)
        if energy <= self.limits.session_energy_j:
            return None
        return Refusal(
            'session_energy_j',
            f'expected at most {self.limits.session_energy_j:g} J a session, got {energy:.6g} J',
        )
