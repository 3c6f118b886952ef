# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Forecast: what a schedule would do to a device, before its first pulse.

The same limits as in `limiter`, for all pulses of a plan at once: a plan of some hundred thousand
pulses has to be judged while the executor's signs of life are awaited.

A whole plan held against the limits, vectorised; what `limiter` does pulse by pulse.

A plan has no jitter, so intervals have no tolerance and are counted from onset to onset.  What
breaks a limit counts all the same: the driver would have stopped there, but a plan is to be seen
as a whole.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from rpms_ros.printable import told_apart
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray
from rpms_ros.stimulation.limits import refusals
from rpms_ros.stimulation.limits.coil_temperature import CoilTemperature, CoilThermal
from rpms_ros.stimulation.limits.device_specification import DeviceSpecification
from rpms_ros.stimulation.limits.limiter import ENERGY_ROUNDING
from rpms_ros.stimulation.limits.pulse_history import Books
from rpms_ros.stimulation.limits.refusals import Refusal, too_quiet
from rpms_ros.stimulation.schedule.schedule import Plan, Schedule


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


CUTOUT = 'coil_cutout'


@dataclass(frozen=True)
class Violation:
    """A limit that a schedule breaks.

    Attributes
    ----------
    limit : str
        Name of the limit.
    reason : str
        What was expected and what came, at its first pulse.
    time_s : float
        When it is first broken, from the start of the schedule [s].
    pulses : int
        How many pulses break it.
    """

    limit: str
    reason: str
    time_s: float
    pulses: int


@dataclass(frozen=True)
class Forecast:
    """What a schedule comes to on a device.

    Attributes
    ----------
    violations : tuple of Violation
        Empty if it can be delivered.
    pulses : int
        Number of pulses.
    duration_s : float
        Length [s].
    energy_j : float
        Energy of all pulses [J].
    mean_power_w : float
        Energy over the length [W].
    max_rate_hz : float
        Largest rate between two pulses [Hz].
    waits_s : tuple of float
        Silence that has to follow each train [s].
    temperature : ndarray of float64, shape (pulses,)
        Coil temperature after each pulse [Celsius]; empty without thermal figures.
    """

    violations: tuple[Violation, ...]
    pulses: int
    duration_s: float
    energy_j: float
    mean_power_w: float
    max_rate_hz: float
    waits_s: tuple[float, ...]
    temperature: FloatArray

    @property
    def deliverable(self) -> bool:
        """Whether no limit is broken."""
        return not self.violations

    @property
    def highest_temperature(self) -> float | None:
        """Highest coil temperature [Celsius], None without thermal figures."""
        return float(self.temperature.max()) if len(self.temperature) else None


def forecast(schedule: Schedule, specification: DeviceSpecification) -> Forecast:
    """Return what ``schedule`` comes to on a rested device that was armed right before."""
    return forecast_plan(schedule.plan, schedule.width_s, *_rested(specification))


def forecast_plan(
    plan: Plan,
    width_s: float,
    books: Books,
    coil: CoilTemperature | None,
    start_ns: int = 0,
    silent_since_ns: int | None = None,
) -> Forecast:
    """Return what a plan comes to.

    Parameters
    ----------
    plan : Plan
        The pulses.
    width_s : float
        Their duration [s].
    books : Books
        What was fired before.
    coil : CoilTemperature or None
        The coil as warm as it is; only read.
    start_ns : int
        Beginning of the plan on the clock of books and coil [ns].
    silent_since_ns : int, optional
        When the device was armed, or fired last, on that clock [ns]; ``start_ns`` if missing.
    """
    check = PlanCheck(plan, width_s, books, start_ns)
    celsius = np.empty(0) if coil is None else coil.forecast(check.time_ns, check.energy_j)
    silent_since = start_ns if silent_since_ns is None else silent_since_ns
    found = [*check.broken(), *_silences(check, plan, start_ns, silent_since)]
    if coil is not None:
        found.append(_too_warm(coil.thermal, celsius))
    found = [broken for broken in found if broken.at.any()]
    found.sort(key=lambda broken: int(broken.at.argmax()))
    gaps = np.diff(plan.onset_ns)
    duration = plan.duration_ns / NANOSECONDS_PER_SECOND
    energy = float(check.energy_j.sum())
    return Forecast(
        violations=tuple(_violation(broken, plan) for broken in found),
        pulses=len(plan),
        duration_s=duration,
        energy_j=energy,
        mean_power_w=energy / duration,
        max_rate_hz=NANOSECONDS_PER_SECOND / float(gaps.min()) if len(gaps) else 0.0,
        waits_s=tuple(check.waits_s.tolist()),
        temperature=celsius,
    )


def _rested(specification: DeviceSpecification) -> tuple[Books, CoilTemperature | None]:
    thermal = specification.thermal
    return Books(specification.limits), CoilTemperature(thermal) if thermal else None


def _violation(broken: Broken, plan: Plan) -> Violation:
    first = int(broken.at.argmax())
    # one place more than there are pulses: the end
    onset_ns = int(plan.onset_ns[first]) if first < len(plan) else plan.duration_ns
    refusal = broken.refusal(first)
    time_s = onset_ns / NANOSECONDS_PER_SECOND
    return Violation(refusal.limit, refusal.reason, time_s, int(broken.at[: len(plan)].sum()))


def _silences(
    check: PlanCheck, plan: Plan, start_ns: int, silent_since_ns: int
) -> tuple[Broken, ...]:
    """Hold the time before each pulse, and before the end, against the idle limit."""
    moments = np.concatenate([[silent_since_ns], check.time_ns, [start_ns + plan.duration_ns]])
    silence_s = np.diff(moments) / NANOSECONDS_PER_SECOND
    limits = check.limits
    at = silence_s > limits.idle_disarm_s
    return (Broken(at, lambda first: too_quiet(limits, float(silence_s[first]))),)


def _too_warm(thermal: CoilThermal, celsius: FloatArray) -> Broken:
    def refusal(first: int) -> Refusal:
        most, found = told_apart(thermal.cutout, float(celsius[first]))
        return Refusal(CUTOUT, f'expected a coil of at most {most} Celsius, got {found} forecast')

    return Broken(celsius > thermal.cutout, refusal)


@dataclass(frozen=True)
class Offer:
    """A change that makes a schedule deliverable.

    Attributes
    ----------
    change : str
        In plain words.
    factor : float
        Of what is changed.
    """

    change: str
    factor: float


def offers(schedule: Schedule, specification: DeviceSpecification) -> tuple[Offer, ...]:
    """Return what would be deliverable: weaker, slower, or only the beginning.

    Each is the largest factor that passes, found by halving the interval to 0.1 %.
    """
    changes: tuple[tuple[str, Callable[[Plan, float], Plan]], ...] = (
        ('every intensity times {:.3f}', _weaker),
        ('every rate times {:.3f}', _slower),
        ('only its first {:.1f} s', _shorter),
    )
    found = []
    for text, change in changes:
        factor = _largest(partial(_passes, change, schedule, specification))
        if factor > 0.0:
            shown = factor * schedule.length_s if change is _shorter else factor
            # rounded downwards: what is shown passes as well
            found.append(Offer(text.format(math.floor(shown * 1000) / 1000), factor))
    return tuple(found)


def _weaker(plan: Plan, factor: float) -> Plan:
    return dataclasses.replace(plan, intensity=plan.intensity * factor)


def _slower(plan: Plan, factor: float) -> Plan:
    onset = np.rint(plan.onset_ns / factor).astype(np.int64)
    return dataclasses.replace(plan, onset_ns=onset, duration_ns=round(plan.duration_ns / factor))


def _shorter(plan: Plan, factor: float) -> Plan:
    end = round(plan.duration_ns * factor)
    count = int(np.searchsorted(plan.onset_ns, end))
    return Plan(plan.onset_ns[:count], plan.intensity[:count], plan.segment[:count], end)


def _passes(
    change: Callable[[Plan, float], Plan],
    schedule: Schedule,
    specification: DeviceSpecification,
    factor: float,
) -> bool:
    plan = change(schedule.plan, factor)
    if not len(plan):
        return False
    return forecast_plan(plan, schedule.width_s, *_rested(specification)).deliverable


def _largest(passes: Callable[[float], bool]) -> float:
    """Return the largest factor below 1 that passes, 0 if none does."""
    low, high = 0.0, 1.0
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if passes(middle) else (low, middle)
    return low
