# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Schedules fitted to a device and a patient: what a protocol asks for, as far as it is allowed.

Segment by segment: intensities are scaled to the strongest that is allowed, rates are kept while
the device gives them at an intensity that is still of use, pauses are put in where the coil has to
rest, ramps where an intensity is not known to the patient yet.  What then still breaks a limit is
weakened, shortened, or left out.  The result has passed the forecast, and every change is said.
"""

import dataclasses
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rpms_ros.errors import StimulationError
from rpms_ros.printable import counted
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.stimulation.limits.device_specification import DeviceSpecification
from rpms_ros.stimulation.limits.forecast import Forecast, Trial, Violation, forecast, rested
from rpms_ros.stimulation.limits.limits import DoseLimits, Limits
from rpms_ros.stimulation.limits.patient import Patient, for_session
from rpms_ros.stimulation.schedule.schedule import Pause, Plan, Repeat, Schedule, Segment
from rpms_ros.stimulation.schedule.segments import PulseBurst, Repetitive, Single

MOST_SEGMENTS = 1000
PAUSES_S = (0.0, 2.0, 4.0, 8.0, 16.0, 30.0)
WEAKER = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)
SHORTER = (1.0, 0.95, 0.9, 0.75, 0.5, 0.25)
RAMP_INTERVAL_S = 0.5
_SHARES = ('intensity', 'start', 'end', 'levels', 'low', 'high')
_RAMPED = frozenset({'maximum_intensity_rise'})


@dataclass(frozen=True)
class Fitted:
    """A schedule that a device can deliver.

    Attributes
    ----------
    schedule : Schedule
        What is left of the one that was asked for.
    changes : tuple of str
        What was changed, in plain words; empty if nothing was.
    """

    schedule: Schedule
    changes: tuple[str, ...]


def fitted(
    schedule: Schedule, specification: DeviceSpecification, patient: Patient | None = None
) -> Fitted:
    """Return a schedule as near to ``schedule`` as device and patient allow.

    Parameters
    ----------
    schedule : Schedule
        What is asked for.
    specification : DeviceSpecification
        Of the device.
    patient : Patient, optional
        Who is stimulated; the device's limits alone count without.

    Raises
    ------
    StimulationError
        If nothing of it is left, or nothing above the patient's motor threshold.
    """
    if patient is not None:
        specification = for_session(specification, patient)
    pieces = list(_unrolled(schedule.segments))
    if len(pieces) > MOST_SEGMENTS:
        raise StimulationError(
            f'expected at most {MOST_SEGMENTS} segments to fit, got {len(pieces)}'
        )
    asked = max((strongest(piece) for piece in pieces), default=0.0)
    limits = specification.limits
    # one factor for all, so that levels stay apart; the first pulse of a train is a step from zero
    allowed = min(limits.maximum_intensity, limits.maximum_intensity_step)
    fitter = _Fitter(schedule, specification, patient, min(1.0, allowed / max(asked, 1e-9)))
    for piece in pieces:
        fitter.add(piece)
    return fitter.result()


def forecast_within(
    schedule: Schedule, specification: DeviceSpecification, dose: DoseLimits | None
) -> Forecast:
    """Return what a schedule comes to on a rested device, a patient's dose included.

    What the patient got before is not known here; the dose ledger counts it when it is run.
    """
    ahead = forecast(schedule, specification)
    more = () if dose is None else _over_dose(schedule.plan, specification.limits, dose)
    return dataclasses.replace(ahead, violations=(*ahead.violations, *more))


def _over_dose(plan: Plan, limits: Limits, dose: DoseLimits) -> Iterator[Violation]:
    energy_j = np.cumsum(limits.pulse_energy_j * plan.intensity**2)
    number = np.arange(1, len(plan) + 1)
    for limit, total, most, unit in (
        ('dose_pulses', number, dose.pulses, 'pulses'),
        ('dose_energy_j', energy_j, dose.energy_j, 'J'),
    ):
        over = total > most
        if over.any():
            reason = (
                f'expected at most {most:g} {unit} in {dose.window_h:g} h, got {total[-1]:.6g}'
            )
            time_s = float(plan.onset_ns[over.argmax()]) / NANOSECONDS_PER_SECOND
            yield Violation(limit, reason, time_s, int(over.sum()))


def strongest(segment: Segment) -> float:
    """Return the highest intensity (share) that a segment can ask for."""
    values = [getattr(segment, name, 0.0) for name in _SHARES]
    return max(max(value) if isinstance(value, tuple) else value for value in values)


def scaled(segment: Segment, factor: float) -> Segment:
    """Return a segment with all intensities times ``factor``, rounded downwards to 0.001."""
    if factor == 1.0 or isinstance(segment, Pause):
        return segment
    changes: dict[str, Any] = {}
    for name in _SHARES:
        value = getattr(segment, name, None)
        if isinstance(value, tuple):
            changes[name] = tuple(_down(level * factor) for level in value)
        elif value is not None:
            changes[name] = _down(value * factor)
    return dataclasses.replace(segment, **changes)


def _down(share: float) -> float:
    # what is a whole number of thousandths but for rounding stays that
    return math.floor(share * 1000.0 + 1e-6) / 1000.0


def _unrolled(items: tuple[Segment | Repeat, ...]) -> Iterator[Segment]:
    for item in items:
        if isinstance(item, Repeat):
            for _ in range(min(item.times, MOST_SEGMENTS + 1)):
                yield from _unrolled(item.segments)
        else:
            yield item


@dataclass
class _Fitter:
    """Puts segments one after another, each as far as it passes."""

    asked: Schedule
    specification: DeviceSpecification
    patient: Patient | None
    scale: float
    # what was taken, its pulses and end, and the device after it
    taken: list[Segment] = field(default_factory=list)
    pulses: int = 0
    end_ns: int = 0
    after: Trial = field(init=False)
    limits: Limits = field(init=False)
    # how many segments what was done to
    done: Counter[str] = field(default_factory=Counter)
    paused_s: float = 0.0
    ramps: int = 0

    def __post_init__(self) -> None:
        self.limits = self.specification.limits
        self.after = rested(self.specification)

    def add(self, piece: Segment) -> None:
        """Take a segment in, changed if it has to be, or leave it out."""
        wanted = scaled(piece, self.scale)
        if isinstance(wanted, Pause):
            self._take([wanted])
            return
        kept = self._within_rates(wanted)
        for weak in WEAKER:
            for short in SHORTER if isinstance(kept, Repetitive) else (1.0,):
                if self._try(kept, weak, short):
                    return
        self.done['left out'] += 1

    def result(self) -> Fitted:
        """Return what was taken, if anything is of use."""
        highest = max((strongest(piece) for piece in self.taken), default=0.0)
        if not highest > 0.0:
            raise StimulationError(
                f'expected a schedule of which {self.specification.name!r} can deliver something, '
                f'got {self.asked.name!r}'
            )
        if self.patient is not None and highest <= self.patient.motor_threshold:
            raise StimulationError(
                f'expected intensities above the motor threshold {self.patient.motor_threshold:g} '
                f'of patient {self.patient.identifier}, got {highest:g} at most'
            )
        schedule = dataclasses.replace(self.asked, segments=tuple(self.taken))
        return Fitted(schedule, tuple(self._changes()))

    def _within_rates(self, wanted: Segment) -> Segment:
        """Return a segment that keeps the rate limits: weaker if that is of use, then slower."""
        rate = _rate_hz(wanted)
        level = strongest(wanted)
        if rate <= self.limits.highest_rate_hz(level):
            return wanted
        if level == 0.0:
            self.done['made slower'] += 1
            return _slowed(wanted, self.limits.highest_rate_hz(0.0))
        enough = 0.5 * level
        if self.patient is not None:
            # half-way from the motor threshold to what is comfortable
            enough = max(enough, 0.5 * (self.patient.motor_threshold + level))
        allowed = [
            bound
            for bound in self.limits.rate_intensities
            if rate <= self.limits.highest_rate_hz(bound) and enough <= bound
        ]
        if allowed:
            self.done['made weaker'] += 1
            return scaled(wanted, min(1.0, max(allowed) / level))
        steps = [bound for bound in self.limits.rate_intensities if bound >= enough]
        bound = min(steps, default=level)
        self.done['made slower'] += 1
        self.done['made weaker'] += bound < level
        return _slowed(
            scaled(wanted, min(1.0, bound / level)), self.limits.highest_rate_hz(min(bound, level))
        )

    def _try(self, kept: Segment, weak: float, short: float) -> bool:
        """Take a segment in with a pause, a ramp or both before it, if one of them passes."""
        piece = scaled(kept, weak)
        if short < 1.0 and isinstance(piece, Repetitive):
            piece = dataclasses.replace(piece, duration_s=piece.duration_s * short)
        for pause_s in PAUSES_S:
            before: list[Segment] = [Pause(pause_s)] if pause_s else []
            broken = self._take([*before, piece])
            if broken & _RAMPED:
                broken = self._take([*before, *self._ramp(strongest(piece)), piece])
                self.ramps += not broken
            if not broken:
                self.done['made weaker'] += weak < 1.0
                self.done['made shorter'] += short < 1.0
                self.paused_s += pause_s
                return True
        return False

    def _ramp(self, highest: float) -> list[Segment]:
        """Return single pulses that rise from zero to the step below ``highest``."""
        step = self.limits.maximum_intensity_rise
        count = math.ceil(highest / step - 1e-9)
        return [Single(_down(number * step), RAMP_INTERVAL_S) for number in range(1, count)]

    def _take(self, more: list[Segment]) -> set[str]:
        """Take segments in if they pass; return which limits they break after what was taken."""
        segments = (*self.taken, *more)
        plan = dataclasses.replace(self.asked, segments=segments).plan
        if self.patient is not None and any(_over_dose(plan, self.limits, self.patient.dose)):
            return {'dose'}
        trial = self.after.copied()
        new = slice(self.pulses, None)
        added = Plan(
            plan.onset_ns[new] - self.end_ns,
            plan.intensity[new],
            plan.segment[new],
            plan.duration_ns - self.end_ns,
        )
        refusals = trial.refusals(added, self.asked.width_s, self.end_ns)
        broken = {refusal.limit for _, refusal in refusals}
        if not broken:
            self.taken, self.after = [*segments], trial
            self.pulses, self.end_ns = len(plan), plan.duration_ns
        return broken

    def _changes(self) -> Iterator[str]:
        if self.scale < 1.0:
            yield f'every intensity times {self.scale:.3g}'
        for what, count in self.done.items():
            if count:
                yield f'{counted(count, "segment")} {what}'
        if self.paused_s:
            yield f'{self.paused_s:g} s of pauses put in'
        if self.ramps:
            steps = f'in steps of {self.limits.maximum_intensity_rise:g}'
            yield f'{counted(self.ramps, "ramp")} put in, {steps}'


def _rate_hz(segment: Segment) -> float:
    """Return the highest rate [Hz] within a segment."""
    if isinstance(segment, Repetitive):
        return max(segment.rate_hz, segment.final_rate_hz or 0.0)
    if isinstance(segment, PulseBurst) and segment.count > 1:
        return 1.0 / segment.interval_s
    return 0.0


def _slowed(segment: Segment, rate_hz: float) -> Segment:
    """Return a segment of which no part is faster than ``rate_hz``."""
    if isinstance(segment, Repetitive):
        final = segment.final_rate_hz
        return dataclasses.replace(
            segment,
            rate_hz=min(segment.rate_hz, rate_hz),
            final_rate_hz=None if final is None else min(final, rate_hz),
        )
    if isinstance(segment, PulseBurst):
        interval_s = max(segment.interval_s, 1.0 / rate_hz)
        longest = (segment.count - 1) * interval_s + RAMP_INTERVAL_S
        return dataclasses.replace(
            segment, interval_s=interval_s, duration_s=max(segment.duration_s, longest)
        )
    return segment
