# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The limiter: every pulse passes it, right before the device is told to fire.

The limiter remembers what was fired, so that rates, trains, energy and totals hold whatever gave
the pulses: one schedule, several in a row, or a fault.  It outlives disarming and a device that
was closed and opened again; with a dose ledger it outlives the process.
"""

import math
from collections.abc import Iterator

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.stimulation.limits import refusals
from rpms_ros.stimulation.limits.pulse_history import Books
from rpms_ros.stimulation.limits.refusals import Refusal

# relative rounding of a sum of thousands of energies
ENERGY_ROUNDING = 1e-9


class PulseLimiter(Books):
    """Holds pulses, one by one, against limits."""

    def refusal(self, time_ns: int, intensity: float, width_s: float) -> Refusal | None:
        """Return why a pulse may not be fired, or None if it may.

        Parameters
        ----------
        time_ns : int
            Its onset [ns], on a clock that never jumps.
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
            self._by_rise(time_ns, intensity),
            self._by_interval(time_ns, intensity),
            self._by_train(time_ns),
            self._by_energy(time_ns, intensity),
            self._by_session(intensity),
        ):
            if found is not None:
                yield found

    def _by_shape(self, intensity: float, width_s: float) -> Refusal | None:
        limits = self.limits
        # written so that NaN fails
        if not 0.0 <= intensity <= limits.maximum_intensity:
            return refusals.too_strong(limits, intensity)
        if not limits.minimum_width_s <= width_s <= limits.maximum_width_s:
            return refusals.wrong_width(limits, width_s)
        return None

    def _by_step(self, time_ns: int, intensity: float) -> Refusal | None:
        before = 0.0 if self.starts_train(time_ns) else self.last_intensity
        # the difference of two shares is rounded once
        if abs(intensity - before) <= self.limits.maximum_intensity_step + math.ulp(1.0):
            return None
        return refusals.too_steep(self.limits, before, intensity)

    def _by_rise(self, time_ns: int, intensity: float) -> Refusal | None:
        self.forget(time_ns)
        known = self.known[0][1] if self.known else 0.0
        # the difference of two shares is rounded once
        if intensity - known <= self.limits.maximum_intensity_rise + math.ulp(1.0):
            return None
        return refusals.too_new(self.limits, known, intensity)

    def _by_interval(self, time_ns: int, intensity: float) -> Refusal | None:
        if self.last_ns is None or time_ns >= self.earliest_ns(intensity):
            return None
        rate = self.rate_due_ns(intensity)[1]
        gap = (time_ns - self.last_ns) / NANOSECONDS_PER_SECOND
        return refusals.too_soon(self.limits, rate, max(intensity, self.last_intensity), gap)

    def _by_train(self, time_ns: int) -> Refusal | None:
        if self.last_ns is None:
            return None
        if not self.starts_train(time_ns):
            if self.train_pulses < self.limits.maximum_train_pulses:
                return None
            return refusals.too_many_in_a_train(self.limits)
        gap_ns = time_ns - self.last_ns
        if gap_ns >= math.floor(self.wait_s * NANOSECONDS_PER_SECOND):
            return None
        gap_s = gap_ns / NANOSECONDS_PER_SECOND
        return refusals.too_short_a_wait(
            self.wait_s, self.train_pulses, self.train_energy_j, gap_s
        )

    def _by_energy(self, time_ns: int, intensity: float) -> Refusal | None:
        self.forget(time_ns)
        energy = self.window_energy_j + self.limits.energy_j(intensity)
        if energy <= self.limits.window_energy_j * (1.0 + ENERGY_ROUNDING):
            return None
        return refusals.too_much_power(self.limits, energy)

    def _by_session(self, intensity: float) -> Refusal | None:
        if self.session_pulses >= self.limits.session_pulses:
            return refusals.too_many(self.limits)
        energy = self.session_energy_j + self.limits.energy_j(intensity)
        if energy <= self.limits.session_energy_j:
            return None
        return refusals.too_much_energy(self.limits, energy)
