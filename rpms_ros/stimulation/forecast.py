# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Forecast: what a schedule would do to a device, before its first pulse.

The same limits as in `limiter`, for all pulses of a plan at once: a plan of some hundred thousand
pulses has to be judged while the executor's signs of life are awaited.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from rpms_ros.printable import told_apart
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.stimulation.books import Books
from rpms_ros.stimulation.device_specification import DeviceSpecification
from rpms_ros.stimulation.plan_check import Broken
from rpms_ros.stimulation.plan_check import PlanCheck
from rpms_ros.stimulation.refusals import Refusal
from rpms_ros.stimulation.refusals import too_quiet
from rpms_ros.stimulation.schedule import Plan
from rpms_ros.stimulation.schedule import Schedule
from rpms_ros.stimulation.thermal import CoilTemperature
from rpms_ros.stimulation.thermal import CoilThermal

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
