# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A whole plan held against the limits, vectorised; what `limiter` does pulse by pulse.

A plan has no jitter, so intervals have no tolerance and are counted from onset to onset.  What
breaks a limit counts all the same: the driver would have stopped there, but a plan is to be seen
as a whole.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.stimulation import refusals
from rpms_ros.stimulation.books import Books
from rpms_ros.stimulation.limiter import ENERGY_ROUNDING
from rpms_ros.stimulation.refusals import Refusal
from rpms_ros.stimulation.schedule import Plan


class Broken(NamedTuple):
    """Where a plan breaks a limit.

    Attributes
    ----------
    at : ndarray of bool, shape (pulses,)
        Which pulses break it.
    refusal : callable
        Returns what the pulse of an index is told.
    """

    at: BoolArray
    refusal: Callable[[int], Refusal]


class PlanCheck:
    """Pulses of a plan in the terms of limits.

    Parameters
    ----------
    plan : Plan
        The pulses.
    width_s : float
        Their duration [s].
    books : Books
        What was fired before; they are only read.
    start_ns : int
        Beginning of the plan on the clock of the books [ns].

    Attributes
    ----------
    time_ns : ndarray of int64, shape (pulses,)
        Onsets on that clock [ns].
    energy_j : ndarray of float64, shape (pulses,)
        Energies [J].
    waits_s : ndarray of float64, shape (trains,)
        Silence that has to follow each train [s].
    """

    def __init__(self, plan: Plan, width_s: float, books: Books, start_ns: int) -> None:
        self.limits = books.limits
        self.time_ns = start_ns + plan.onset_ns
        self.energy_j = self.limits.pulse_energy_j * np.square(plan.intensity)
        self._intensity = plan.intensity
        self._width_s = width_s
        self._books = books
        rested = books.last_ns is None
        # long before, so that a rested device begins a train without a wait
        first = self.time_ns[:1] if rested else np.array([books.last_ns])
        self._gap_ns = np.diff(self.time_ns, prepend=first)
        self._before = np.concatenate([[books.last_intensity], plan.intensity])[: len(plan)]
        self._new_train = self._gap_ns >= books.pause_ns
        self._new_train[:1] |= rested
        self._split_trains()

    def broken(self) -> tuple[Broken, ...]:
        """Return where each limit is broken, if it is."""
        return (
            *self._shapes(),
            *self._rises(),
            *self._intervals(),
            *self._trains(),
            *self._energies(),
        )

    def _split_trains(self) -> None:
        """Number the pulses of each train; add up pulses, energy and wait of each."""
        count, books = len(self.time_ns), self._books
        starts = np.flatnonzero(self._new_train)
        goes_on = count > 0 and not self._new_train[0]
        if goes_on:
            starts = np.concatenate([[0], starts])
        begin_ns = self.time_ns[starts]
        sizes = np.diff(starts, append=count)
        energies = np.add.reduceat(self.energy_j, starts) if count else np.empty(0)
        before = np.zeros_like(sizes)
        if goes_on:
            begin_ns[0], before[0] = books.train_start_ns, books.train_pulses
            energies[0] += books.train_energy_j
        self._train = np.repeat(np.arange(len(starts)), sizes)
        self._place = np.arange(count) - np.repeat(starts - before, sizes)
        self._train_pulses, self._train_energy_j = sizes + before, energies
        self.waits_s = self._waits(starts, sizes, begin_ns)

    def _waits(self, starts: IntArray, sizes: IntArray, begin_ns: IntArray) -> FloatArray:
        pulses = self._train_pulses
        span_s = (self.time_ns[starts + sizes - 1] - begin_ns) / NANOSECONDS_PER_SECOND
        # n/f: a train of n pulses lasts one period longer than the time between its ends
        lasted_s = span_s * pulses / np.maximum(pulses - 1, 1)
        by_power = self._train_energy_j / self.limits.continuous_power_w - lasted_s
        waits: FloatArray = np.maximum(by_power, self.limits.minimum_pause_s)
        return waits

    def _shapes(self) -> tuple[Broken, ...]:
        limits, intensity = self.limits, self._intensity
        # written so that NaN fails
        strong = ~((intensity >= 0.0) & (intensity <= limits.maximum_intensity))
        width = limits.minimum_width_s <= self._width_s <= limits.maximum_width_s
        before = np.where(self._new_train, 0.0, self._before)
        # the difference of two shares is rounded once
        steepest = limits.maximum_intensity_step + math.ulp(1.0)
        return (
            Broken(strong, lambda i: refusals.too_strong(limits, float(intensity[i]))),
            Broken(~strong & (not width), lambda _: refusals.wrong_width(limits, self._width_s)),
            Broken(
                ~(np.abs(intensity - before) <= steepest),
                lambda i: refusals.too_steep(limits, float(before[i]), float(intensity[i])),
            ),
        )

    def _rises(self) -> tuple[Broken, ...]:
        """Hold each pulse against the strongest of the window before it."""
        limits, books, count = self.limits, self._books, len(self.time_ns)
        if not count or limits.maximum_intensity_rise >= 1.0:
            return ()
        times = np.array([*(time for time, _ in books.known), *self.time_ns.tolist()])
        earlier = len(books.known)
        values = np.concatenate([[share for _, share in books.known], self._intensity])
        first = np.searchsorted(times, self.time_ns - books.rise_ns, side='left')
        known = _highest(values, first, np.arange(count) + earlier)
        rise = self._intensity - known
        # the difference of two shares is rounded once
        far = ~(rise <= limits.maximum_intensity_rise + math.ulp(1.0))
        return (
            Broken(
                far, lambda i: refusals.too_new(limits, float(known[i]), float(self._intensity[i]))
            ),
        )

    def _intervals(self) -> tuple[Broken, ...]:
        if not len(self.time_ns):
            return ()
        limits, books = self.limits, self._books
        strongest = np.maximum(self._intensity, self._before)
        edges = np.searchsorted(limits.rate_intensities, strongest, side='left')
        rates = np.array([*limits.rate_limits_hz, limits.rate_limits_hz[-1]])[edges]
        rates = np.minimum(rates, limits.maximum_rate_hz)
        period_ns = np.floor(NANOSECONDS_PER_SECOND / rates).astype(np.int64)
        soon = self._gap_ns < period_ns
        # the pulse before may have been late: it counts from when it was due
        rested = books.last_ns is None
        soon[0] = not rested and self.time_ns[0] < books.counted_ns + int(period_ns[0])
        fastest = rates == limits.maximum_rate_hz

        def refusal(i: int) -> Refusal:
            gap_s = float(self._gap_ns[i]) / NANOSECONDS_PER_SECOND
            return refusals.too_soon(limits, float(rates[i]), float(strongest[i]), gap_s)

        return Broken(soon & fastest, refusal), Broken(soon & ~fastest, refusal)

    def _trains(self) -> tuple[Broken, ...]:
        limits, books = self.limits, self._books
        long = ~self._new_train & (self._place >= limits.maximum_train_pulses)
        # of the train before each; of what was fired before for the first
        waits = np.concatenate([[books.wait_s], self.waits_s])[self._train]
        wait_ns = np.floor(waits * NANOSECONDS_PER_SECOND)
        soon = self._new_train & (self._gap_ns < wait_ns)
        soon[:1] &= books.last_ns is not None
        pulses = np.concatenate([[books.train_pulses], self._train_pulses])
        energy = np.concatenate([[books.train_energy_j], self._train_energy_j])

        def refusal(i: int) -> Refusal:
            train, gap_s = self._train[i], float(self._gap_ns[i]) / NANOSECONDS_PER_SECOND
            return refusals.too_short_a_wait(
                float(waits[i]), int(pulses[train]), float(energy[train]), gap_s
            )

        return Broken(long, lambda _: refusals.too_many_in_a_train(limits)), Broken(soon, refusal)

    def _energies(self) -> tuple[Broken, ...]:
        limits, books = self.limits, self._books
        earlier = np.array([time for time, _ in books.window], dtype=np.int64)
        times = np.concatenate([earlier, self.time_ns])
        total = np.cumsum([0.0, *(energy for _, energy in books.window), *self.energy_j])
        first = np.searchsorted(times, self.time_ns - books.window_ns, side='right')
        window = total[len(earlier) + 1 :] - total[first]
        session = books.session_energy_j + np.cumsum(self.energy_j)
        many = books.session_pulses + np.arange(len(self.time_ns)) >= limits.session_pulses
        return (
            Broken(
                ~(window <= limits.window_energy_j * (1.0 + ENERGY_ROUNDING)),
                lambda i: refusals.too_much_power(limits, float(window[i])),
            ),
            Broken(many, lambda _: refusals.too_many(limits)),
            Broken(
                ~many & ~(session <= limits.session_energy_j),
                lambda i: refusals.too_much_energy(limits, float(session[i])),
            ),
        )


def _highest(values: FloatArray, first: IntArray, end: IntArray) -> FloatArray:
    """Return the highest value from ``first`` to before ``end``, 0 where there is none.

    A table of the highest of 1, 2, 4 ... values in a row: two of them cover any stretch.
    """
    table = [values]
    while 2 ** len(table) <= len(values):
        before, half = table[-1], 2 ** (len(table) - 1)
        table.append(np.maximum(before[:-half], before[half:]))
    highest = np.zeros(len(first))
    size = end - first
    for power, row in enumerate(table):
        fits = (size >= 2**power) & (size < 2 ** (power + 1))
        highest[fits] = np.maximum(row[first[fits]], row[end[fits] - 2**power])
    return highest
