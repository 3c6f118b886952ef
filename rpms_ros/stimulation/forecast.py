"""Forecast: what a schedule would do to a device, before its first pulse."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.stimulation.device_specification import DeviceSpecification
from rpms_ros.stimulation.limiter import PulseLimiter
from rpms_ros.stimulation.limiter import Refusal
from rpms_ros.stimulation.limits import Limits
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


class _Tally:
    """Violations by limit: the first of each kind in full, the others counted."""

    def __init__(self) -> None:
        self._first: dict[str, Violation] = {}

    def add(self, refusal: Refusal, onset_ns: int) -> None:
        found = self._first.get(refusal.limit)
        if found is None:
            time_s = onset_ns / NANOSECONDS_PER_SECOND
            found = Violation(refusal.limit, refusal.reason, time_s, 0)
        self._first[refusal.limit] = dataclasses.replace(found, pulses=found.pulses + 1)

    def all(self) -> tuple[Violation, ...]:
        return tuple(self._first.values())


def forecast(schedule: Schedule, specification: DeviceSpecification) -> Forecast:
    """Return what ``schedule`` comes to on a rested device of ``device_specification``."""
    limiter = PulseLimiter(specification.limits, tolerance_s=0.0)
    coil = CoilTemperature(specification.thermal) if specification.thermal else None
    return forecast_plan(schedule.plan, schedule.width_s, limiter, coil)


def forecast_plan(
    plan: Plan,
    width_s: float,
    limiter: PulseLimiter,
    coil: CoilTemperature | None,
    start_ns: int = 0,
    to_the_end: bool = True,
) -> Forecast:
    """Return what a plan comes to; limiter and coil are used up.

    Parameters
    ----------
    plan : Plan
        The pulses.
    width_s : float
        Their duration [s].
    limiter : PulseLimiter
        A trial limiter, with the memory of what was fired before.
    coil : CoilTemperature or None
        The coil as warm as it is at ``start_ns``.
    start_ns : int
        Beginning of the plan on the clock of limiter and coil [ns].
    to_the_end : bool
        Whether to go on after the first violation.
    """
    tally = _Tally()
    waits: list[float] = []
    celsius: list[float] = []
    energy_before = limiter.session_energy_j
    last_ns: int | None = None
    pause_ns = round(limiter.limits.minimum_pause_s * NANOSECONDS_PER_SECOND)
    for onset, intensity in zip(plan.onset_ns.tolist(), plan.intensity.tolist(), strict=True):
        if last_ns is not None and onset - last_ns >= pause_ns:
            waits.append(limiter.wait_s)
        _check(tally, limiter, onset, intensity, width_s, start_ns, last_ns)
        if coil is not None:
            celsius.append(coil.heat(start_ns + onset, limiter.limits.energy_j(intensity)))
            if celsius[-1] > coil.thermal.cutout:
                tally.add(_too_warm(coil.thermal, celsius[-1]), onset)
        last_ns = onset
        if not to_the_end and tally.all():
            break
    if last_ns is not None:
        waits.append(limiter.wait_s)
    return _summary(plan, tally, waits, celsius, limiter.session_energy_j - energy_before)


def _check(
    tally: _Tally,
    limiter: PulseLimiter,
    onset: int,
    intensity: float,
    width_s: float,
    start_ns: int,
    last_ns: int | None,
) -> None:
    """Hold one pulse against limiter and idle limit; what is refused is booked all the same."""
    for refusal in limiter.refusals(start_ns + onset, intensity, width_s):
        tally.add(refusal, onset)
    limiter.book(start_ns + onset, intensity)
    silence_s = (onset - (last_ns or 0)) / NANOSECONDS_PER_SECOND
    if silence_s > limiter.limits.idle_disarm_s:
        tally.add(_too_quiet(limiter.limits, silence_s), onset)


def _too_warm(thermal: CoilThermal, celsius: float) -> Refusal:
    return Refusal(
        CUTOUT,
        f'expected a coil of at most {thermal.cutout:g} Celsius, got {celsius:.3g} forecast',
    )


def _too_quiet(limits: Limits, silence_s: float) -> Refusal:
    return Refusal(
        'idle_disarm_s',
        f'expected at most {limits.idle_disarm_s:g} s without a pulse, got {silence_s:.4g} s',
    )


def _summary(
    plan: Plan, tally: _Tally, waits: list[float], celsius: list[float], energy: float
) -> Forecast:
    gaps = np.diff(plan.onset_ns)
    duration = plan.duration_ns / NANOSECONDS_PER_SECOND
    return Forecast(
        violations=tally.all(),
        pulses=len(plan),
        duration_s=duration,
        energy_j=energy,
        mean_power_w=energy / duration,
        max_rate_hz=NANOSECONDS_PER_SECOND / float(gaps.min()) if len(gaps) else 0.0,
        waits_s=tuple(waits),
        temperature=np.array(celsius),
    )


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
    limiter = PulseLimiter(specification.limits, tolerance_s=0.0)
    coil = CoilTemperature(specification.thermal) if specification.thermal else None
    return forecast_plan(plan, schedule.width_s, limiter, coil, to_the_end=False).deliverable


def _largest(passes: Callable[[float], bool]) -> float:
    """Return the largest factor below 1 that passes, 0 if none does."""
    low, high = 0.0, 1.0
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if passes(middle) else (low, middle)
    return low
