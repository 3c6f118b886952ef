# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Forecast: what a schedule would do to a device, before its first pulse.

The plan runs through a copy of the limiter.  A plan has no jitter, so intervals have no tolerance.
What breaks a limit counts all the same: the driver would have stopped there, but a plan is to be
seen as a whole.
"""

from collections import Counter
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass

import numpy as np

from rpms_ros.printable import told_apart
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.stimulation.limits.coil_temperature import CoilTemperature
from rpms_ros.stimulation.limits.device_specification import DeviceSpecification
from rpms_ros.stimulation.limits.limiter import (
    ENERGY_ROUNDING,
    DoseLimits,
    Limits,
    PulseLimiter,
    Refusal,
    too_quiet,
)
from rpms_ros.stimulation.schedule.schedule import Plan, Schedule

MOST_PULSES = 40_000
"""Of a schedule that a driver runs: each costs 5 us before the first one."""
# How long after it was armed a driver begins, at the least [ns].
_BEGINS_NS = 50_000_000


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
    highest_temperature : float or None
        Of the coil [Celsius]; None without thermal figures or pulses.
    """

    violations: tuple[Violation, ...]
    pulses: int
    duration_s: float
    energy_j: float
    mean_power_w: float
    max_rate_hz: float
    waits_s: tuple[float, ...]
    highest_temperature: float | None

    @property
    def deliverable(self) -> bool:
        """Whether no limit is broken."""
        return not self.violations


def forecast(
    schedule: Schedule, specification: DeviceSpecification, dose: DoseLimits | None = None
) -> Forecast:
    """Return what ``schedule`` comes to on a rested device that was armed right before.

    What a patient got before is not known here: the dose ledger counts it when it is run.
    """
    plan, limits, thermal = schedule.plan, specification.limits, specification.thermal
    trial = Trial(PulseLimiter(limits), CoilTemperature(thermal) if thermal else None, 0)
    found: dict[str, tuple[str, float]] = {}
    pulses: Counter[str] = Counter()
    for time_s, (limit, reason) in trial.refusals(plan, schedule.width_s, _BEGINS_NS):
        found.setdefault(limit, (reason, time_s))
        # the end is no pulse
        pulses[limit] += time_s < plan.duration_s
    broken = [Violation(name, *first, pulses[name]) for name, first in found.items()]
    if (more := len(plan) - MOST_PULSES) > 0:
        why = f'expected at most {MOST_PULSES} pulses in a schedule, got {len(plan)}'
        time_s = float(plan.onset_ns[MOST_PULSES]) / NANOSECONDS_PER_SECOND
        broken.append(Violation('schedule_pulses', why, time_s, more))
    if dose is not None:
        broken += _over_dose(plan, limits, dose)
    energy = limits.pulse_energy_j * float(np.square(plan.intensity).sum())
    return Forecast(
        violations=tuple(broken),
        pulses=len(plan),
        duration_s=plan.duration_s,
        energy_j=energy,
        mean_power_w=energy / plan.duration_s,
        max_rate_hz=plan.highest_rate_hz,
        waits_s=tuple(trial.waits_s),
        highest_temperature=max(trial.celsius, default=None),
    )


def _over_dose(plan: Plan, limits: Limits, dose: DoseLimits) -> Iterator[Violation]:
    energy_j = np.cumsum(limits.pulse_energy_j * plan.intensity**2)
    for limit, total, most, unit in (
        ('dose_pulses', np.arange(1, len(plan) + 1), dose.pulses, 'pulses'),
        ('dose_energy_j', energy_j, dose.energy_j * (1.0 + ENERGY_ROUNDING), 'J'),
    ):
        over = total > most
        if over.any():
            why = f'expected at most {most:g} {unit} in {dose.window_h:g} h, got {total[-1]:.6g}'
            time_s = float(plan.onset_ns[over.argmax()]) / NANOSECONDS_PER_SECOND
            yield Violation(limit, why, time_s, int(over.sum()))


class Trial:
    """Copies of a limiter and of a coil that a plan runs through, pulse by pulse.

    Parameters
    ----------
    limiter : PulseLimiter
        What was fired before.
    coil : CoilTemperature or None
        The coil as warm as it is.
    since_ns : int
        When the device was armed, or fired last, on the clock of both [ns].

    Attributes
    ----------
    limits : Limits
        Of the device.
    waits_s : list of float
        Silence that has to follow each train [s].
    celsius : list of float
        Coil temperature after each pulse [Celsius]; empty without thermal figures.
    """

    def __init__(self, limiter: PulseLimiter, coil: CoilTemperature | None, since_ns: int) -> None:
        self._limiter, self._coil, self._active_ns = limiter.copy(), copy(coil), since_ns
        # a plan has no jitter
        self._limiter.tolerance_ns = 0
        self.waits_s: list[float] = []
        self.celsius: list[float] = []

    def refusals(
        self, plan: Plan, width_s: float, start_ns: int
    ) -> Iterator[tuple[float, Refusal]]:
        """Book a plan that begins at ``start_ns`` [ns]; yield what stands against it.

        Each refusal comes with the time of its pulse, or of the end, from the start [s].
        """
        limiter, coil, begun = self._limiter, self._coil, False
        onsets_ns, intensities = plan.onset_ns.tolist(), plan.intensity.tolist()
        for onset_ns, intensity in zip(onsets_ns, intensities, strict=True):
            time_ns, time_s = start_ns + onset_ns, onset_ns / NANOSECONDS_PER_SECOND
            for refusal in limiter.refusals(time_ns, intensity, width_s):
                yield time_s, refusal
            if quiet := too_quiet(limiter.limits, time_ns - self._active_ns):
                yield time_s, quiet
            if begun and limiter.starts_train(time_ns):
                self.waits_s.append(max(limiter.wait_s, limiter.rest_s))
            limiter.book(time_ns, intensity)
            if coil is not None:
                self.celsius.append(coil.heat(time_ns, limiter.limits.energy_j(intensity)))
                if self.celsius[-1] > coil.thermal.cutout:
                    most, found = told_apart(coil.thermal.cutout, self.celsius[-1])
                    fault = f'expected a coil of at most {most} Celsius, got {found} forecast'
                    yield time_s, Refusal('coil_cutout', fault)
            self._active_ns, begun = time_ns, True
        if begun:
            self.waits_s.append(max(limiter.wait_s, limiter.rest_s))
        if quiet := too_quiet(limiter.limits, start_ns + plan.duration_ns - self._active_ns):
            yield plan.duration_s, quiet
