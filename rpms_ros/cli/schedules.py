# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`rpms protocol`: schedules with a name; `rpms check`: whether a device can deliver one."""

import argparse
import json
import os
from collections.abc import Iterator
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpms_ros.cli.options import Subparsers, add_command, add_option
from rpms_ros.errors import StimulationError
from rpms_ros.printable import counted
from rpms_ros.schema import plain

if TYPE_CHECKING:
    from rpms_ros.stimulation.limits.device_specification import DeviceSpecification
    from rpms_ros.stimulation.limits.forecast import Forecast
    from rpms_ros.stimulation.limits.patient import Patient
    from rpms_ros.stimulation.schedule.schedule import Schedule

_MOST_WAITS = 5
# Tells recruitment from an effort that follows what is felt.
_CATCH = 0.1


# Function of `rpms_ros.stimulation.schedule.protocols` and what it is for, by name.
_PROTOCOLS = {
    'uniform_random': ('paper_random', 'uniform random intensity, 0 to 100 % at 20 Hz for 90 s'),
    'sinusoid': (
        'paper_sinusoid',
        'sinusoidal intensity of period 9 s, 0 to 100 % at 20 Hz for 90 s, catch pulses in it',
    ),
    'staircase': ('staircase', 'six levels from 0 to 100 % at 20 Hz, 3 s each, catch pulses'),
    'constant': ('constant', '100 % at 20 Hz for 10 s'),
    'twitches': ('twitches', 'single pulses at six intensities, a second apart, shuffled'),
    'trains': ('trains', 'trains of 1.5 s at 5 to 35 Hz, single pulses before them'),
    'recruitment': ('recruitment', 'staircases of 21 intensities at six rates from 15 to 35 Hz'),
    'muscle': ('muscle', 'twitches, trains and recruitment, for `rpms analyze`'),
}


def built(name: str, arguments: argparse.Namespace) -> 'Schedule':
    """Return a schedule of `rpms protocol`, with what was given in place of its own figures.

    Raises
    ------
    StimulationError
        If it does not take what was given.
    """
    from rpms_ros.stimulation.schedule import protocols

    maker = getattr(protocols, _PROTOCOLS[name][0])
    taken = signature(maker).parameters
    given: dict[str, Any] = {}
    if (catch := arguments.catch) is not None or 'catch_share' in taken:
        given['catch_share'] = (_CATCH if catch is None else catch) or None
    for option in ('rate_hz', 'duration_s', 'seed'):
        if (value := getattr(arguments, option)) is not None:
            # of several rates one is left
            several = option == 'rate_hz' and 'rates_hz' in taken
            given['rates_hz' if several else option] = (value,) if several else value
    for option in given.keys() - taken.keys():
        shown = option.partition('_')[0]
        raise StimulationError(f'expected no --{shown} with {name}, got {given[option] or 0}')
    schedule: Schedule = maker(**given)
    return schedule


def add_protocol(subparsers: Any) -> None:
    """Add `rpms protocol`."""
    protocols = '; '.join(f'{name}: {summary}' for name, (_, summary) in _PROTOCOLS.items())
    parser = subparsers.add_parser(
        'protocol',
        help='write a schedule that has a name',
        description='Write a schedule as YAML, to run, to check or to change by hand.',
        epilog=f'protocols: {protocols}',
    )
    parser.add_argument('name', choices=sorted(_PROTOCOLS), help='which one')
    add_option(parser, '--out FILE', None, 'new YAML file', type=Path, required=True)
    add_option(parser, '--rate HZ', None, 'repetition rate instead', dest='rate_hz', type=float)
    add_option(parser, '--duration S', None, 'length instead', dest='duration_s', type=float)
    add_option(parser, '--seed', None, 'seed of what is random', type=int)
    text = 'share of pulses of a slow schedule whose intensity is drawn from it; 0: none'
    add_option(parser, '--catch SHARE', None, f'{text}; {_CATCH} if not given', type=float)
    parser.set_defaults(run=run_protocol)


def run_protocol(arguments: argparse.Namespace) -> int:
    """Write the schedule and say what it adds up to."""
    from rpms_ros.stimulation.schedule.description import schedule_to_text

    if os.path.lexists(arguments.out):
        raise StimulationError(f'expected a new file for the schedule, got {arguments.out}')
    schedule = built(arguments.name, arguments)
    try:
        # 'x': what another program has written meanwhile is not replaced either.
        with arguments.out.open('x', encoding='utf-8') as file:
            file.write(schedule_to_text(schedule))
    except OSError as error:
        fault = f'expected a file to write, got {arguments.out}: {error}'
        raise StimulationError(fault) from error
    plan = schedule.plan
    most = f'{plan.highest_rate_hz:.4g} Hz and intensity {plan.intensity.max(initial=0):.3g}'
    pulses = f'{counted(len(plan), "pulse")} in {plan.duration_s:g} s'
    print(f'{arguments.out}: {pulses}, at most {most}')
    return 0


def add_check(subparsers: Subparsers) -> None:
    """Add `rpms check`."""
    text = 'say whether a device can deliver a schedule'
    parser = add_command(subparsers, 'check', run_check, text)
    parser.add_argument('schedule', type=Path, help='YAML file of the schedule')
    text = 'name of a device specification, or its YAML file'
    add_option(parser, '--device NAME|FILE', None, text, required=True)
    text = "patient file: the tighter of the device's and the patient's limits count"
    add_option(parser, '--patient FILE', None, text, type=Path)
    parser.add_argument('--json', action='store_true', help='print one JSON object and no more')


def run_check(arguments: argparse.Namespace) -> int:
    """Check a schedule; return 0 if it can be delivered, 1 if not.

    Hold a schedule against the limits of a device before anything fires: rates, trains, energy,
    waits and coil temperature.

    Examples
    --------
      rpms protocol uniform_random --out s.yaml && rpms check s.yaml --device rapid2-240v
    exit status: 0 deliverable, 1 not deliverable, 2 unusable input
    """
    from rpms_ros.stimulation.limits.device_specification import load_device_specification
    from rpms_ros.stimulation.limits.forecast import forecast
    from rpms_ros.stimulation.limits.patient import for_session, load_patient
    from rpms_ros.stimulation.schedule.description import load_schedule

    schedule = load_schedule(arguments.schedule)
    specification = load_device_specification(arguments.device)
    patient = load_patient(arguments.patient) if arguments.patient is not None else None
    if patient is not None:
        specification = for_session(specification, patient)
    ahead = forecast(schedule, specification, patient.dose if patient else None)
    if arguments.json:
        print(json.dumps({'deliverable': ahead.deliverable, **plain(ahead)}))
    else:
        print('\n'.join(report(schedule, specification, ahead, patient)))
    return 0 if ahead.deliverable else 1


def report(
    schedule: 'Schedule',
    specification: 'DeviceSpecification',
    ahead: 'Forecast',
    patient: 'Patient | None' = None,
) -> Iterator[str]:
    """Yield what a person wants to know, line by line."""
    verdict = 'deliverable' if ahead.deliverable else 'NOT deliverable'
    continuous = specification.limits.continuous_power_w
    whom = f' for patient {patient.identifier}' if patient is not None else ''
    yield f'{schedule.name} on {specification.name}{whom}: {verdict}'
    yield f'  pulses       {ahead.pulses} in {ahead.duration_s:g} s, {ahead.max_rate_hz:.4g} Hz'
    yield f'  energy       {ahead.energy_j:,.0f} J'
    yield f'  mean power   {ahead.mean_power_w:,.0f} W, {continuous:g} W can go on for ever'
    yield f'  waits        {_waits(ahead.waits_s)}'
    if ahead.highest_temperature is not None and specification.thermal is not None:
        cutout, ambient = specification.thermal.cutout, specification.thermal.ambient
        model = f'cut-out {cutout:g} (model, started at {ambient:g})'
        yield f'  temperature  {ahead.highest_temperature:.1f} Celsius at most, {model}'
    if patient is not None:
        dose, above = patient.dose, schedule.plan.intensity > patient.motor_threshold
        given = f'{ahead.pulses} of {dose.pulses} pulses'
        energy = f'{ahead.energy_j:,.0f} of {dose.energy_j:,.0f} J in {dose.window_h:g} h'
        many = f'{int(above.sum())} of {ahead.pulses} pulses'
        yield f'  dose         {given}, {energy}, without what was given before'
        yield f'  threshold    {many} above the motor threshold {patient.motor_threshold:g}'
    elif not specification.simulated_only:
        yield "  patient      none: the device's limits alone"
    for found in ahead.violations:
        yield f'  {found.limit}: {found.reason}'
        yield f'    first at {found.time_s:.4g} s, {counted(found.pulses, "pulse")}'


def _waits(waits: tuple[float, ...]) -> str:
    if not waits:
        return 'none'
    shown = ', '.join(f'{wait:.3g} s' for wait in waits[:_MOST_WAITS])
    more = len(waits) - _MOST_WAITS
    return f'{shown} after the train' + (f' and {more} more' if more > 0 else '')
