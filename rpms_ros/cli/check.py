# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`rpms check`: whether a device can deliver a schedule, why not, and what it could deliver."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpms_ros.cli.options import add_option
from rpms_ros.printable import counted

if TYPE_CHECKING:
    from rpms_ros.stimulation.limits.device_specification import DeviceSpecification
    from rpms_ros.stimulation.limits.forecast import Forecast, Offer
    from rpms_ros.stimulation.limits.patient import Patient
    from rpms_ros.stimulation.schedule.schedule import Schedule

_BARS = ' ▁▂▃▄▅▆▇█'
_WIDTH = 60
_MOST_WAITS = 5


def add_parser(subparsers: Any) -> None:
    """Add `rpms check`."""
    parser = subparsers.add_parser(
        'check',
        help='say whether a device can deliver a schedule',
        description=(
            'Hold a schedule against the limits of a device before anything fires: rates, trains, '
            'energy, waits and coil temperature.'
        ),
        epilog=(
            'exit status: 0 deliverable, 1 not deliverable, 2 unusable input.  '
            'example: rpms protocol uniform_random --out s.yaml && '
            'rpms check s.yaml --device rapid2-240v'
        ),
    )
    parser.add_argument('schedule', type=Path, help='YAML file of the schedule')
    text = 'name of a device specification, or its YAML file'
    add_option(parser, '--device NAME|FILE', None, text, required=True)
    text = "patient file: the tighter of the device's and the patient's limits count"
    add_option(parser, '--patient FILE', None, text, type=Path)
    parser.add_argument('--json', action='store_true', help='print one JSON object and no more')
    text = 'write intensity, power and temperature as a figure'
    add_option(parser, '--plot FILE', None, text, type=Path)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Check a schedule; return 0 if it can be delivered, 1 if not."""
    from rpms_ros.stimulation.limits.device_specification import load_device_specification
    from rpms_ros.stimulation.limits.fitting import forecast_within
    from rpms_ros.stimulation.limits.forecast import offers
    from rpms_ros.stimulation.limits.patient import for_session, load_patient
    from rpms_ros.stimulation.schedule.description import load_schedule

    schedule = load_schedule(arguments.schedule)
    specification = load_device_specification(arguments.device)
    patient = load_patient(arguments.patient) if arguments.patient is not None else None
    if patient is not None:
        specification = for_session(specification, patient)
    ahead = forecast_within(schedule, specification, patient.dose if patient else None)
    if arguments.json:
        print(json.dumps(as_json(ahead)))
    else:
        print('\n'.join(report(schedule, specification, ahead, patient)))
        if not ahead.deliverable:
            print('\n'.join(_offered(offers(schedule, specification))))
    if arguments.plot is not None:
        from rpms_ros.report.dose import save_schedule_figure

        save_schedule_figure(schedule, specification, ahead, arguments.plot)
    return 0 if ahead.deliverable else 1


def as_json(ahead: 'Forecast') -> dict[str, Any]:
    """Return a forecast as what JSON can hold."""
    return {
        'deliverable': ahead.deliverable,
        'violations': [asdict(found) for found in ahead.violations],
        'mean_power_w': ahead.mean_power_w,
        'energy_j': ahead.energy_j,
        'max_rate_hz': ahead.max_rate_hz,
        'waits_s': list(ahead.waits_s),
        'temperature_c': ahead.highest_temperature,
    }


def report(
    schedule: 'Schedule',
    specification: 'DeviceSpecification',
    ahead: 'Forecast',
    patient: 'Patient | None' = None,
) -> list[str]:
    """Return what a person wants to know, line by line."""
    verdict = 'deliverable' if ahead.deliverable else 'NOT deliverable'
    continuous = specification.limits.continuous_power_w
    whom = f' for patient {patient.identifier}' if patient is not None else ''
    lines = [
        f'{schedule.name} on {specification.name}{whom}: {verdict}',
        f'  pulses       {ahead.pulses} in {ahead.duration_s:g} s, {ahead.max_rate_hz:.4g} Hz',
        f'  energy       {ahead.energy_j:,.0f} J',
        f'  mean power   {ahead.mean_power_w:,.0f} W, {continuous:g} W can go on for ever',
        f'  waits        {_waits(ahead.waits_s)}',
    ]
    if ahead.highest_temperature is not None and specification.thermal is not None:
        lines.append(
            f'  temperature  {ahead.highest_temperature:.1f} Celsius at most, '
            f'cut-out {specification.thermal.cutout:g} '
            f'(model, started at {specification.thermal.ambient:g})'
        )
    lines.extend(_patient(schedule, specification, ahead, patient))
    lines.extend(_plot(schedule, ahead))
    for found in ahead.violations:
        lines.append(f'  {found.limit}: {found.reason}')
        lines.append(f'    first at {found.time_s:.4g} s, {counted(found.pulses, "pulse")}')
    return lines


def _patient(
    schedule: 'Schedule',
    specification: 'DeviceSpecification',
    ahead: 'Forecast',
    patient: 'Patient | None',
) -> list[str]:
    if patient is None:
        real = not specification.simulated_only
        return ["  patient      none: the device's limits alone"] if real else []
    dose, above = patient.dose, schedule.plan.intensity > patient.motor_threshold
    return [
        (
            f'  dose         {ahead.pulses} of {dose.pulses} pulses, {ahead.energy_j:,.0f} of '
            f'{dose.energy_j:,.0f} J in {dose.window_h:g} h, without what was given before'
        ),
        (
            f'  threshold    {int(above.sum())} of {ahead.pulses} pulses above the motor '
            f'threshold {patient.motor_threshold:g}'
        ),
    ]


def _waits(waits: tuple[float, ...]) -> str:
    if not waits:
        return 'none'
    shown = ', '.join(f'{wait:.3g} s' for wait in waits[:_MOST_WAITS])
    more = len(waits) - _MOST_WAITS
    return f'{shown} after the train' + (f' and {more} more' if more > 0 else '')


def _plot(schedule: 'Schedule', ahead: 'Forecast') -> list[str]:
    """Return intensity and temperature over time as rows of blocks."""
    import numpy as np

    plan = schedule.plan
    if not len(plan):
        return []
    column = plan.onset_ns * _WIDTH // max(1, plan.duration_ns)
    lines = [f'  intensity    |{_bars(column, plan.intensity, 0.0, 1.0)}| 0 to 1']
    if len(ahead.temperature):
        low, high = float(ahead.temperature.min()), float(ahead.temperature.max())
        bars = _bars(column, ahead.temperature, low, np.nextafter(high, np.inf))
        lines.append(f'  Celsius      |{bars}| {low:.1f} to {high:.1f}')
    return lines


def _bars(column: Any, values: Any, low: float, high: float) -> str:
    """Return one block a column: the mean of the values that fall into it."""
    text = ''
    for index in range(_WIDTH):
        inside = values[column == index]
        if not len(inside):
            text += ' '
            continue
        level = (float(inside.mean()) - low) / (high - low)
        text += _BARS[1 + min(7, int(level * 8))]
    return text


def _offered(found: 'tuple[Offer, ...]') -> list[str]:
    if not found:
        return ['  nothing like it could be delivered']
    return ['  deliverable would be:', *(f'    {offer.change}' for offer in found)]
