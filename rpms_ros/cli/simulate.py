# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms simulate``: a recording of a simulated session, without ROS."""

import argparse
import json
from dataclasses import asdict, replace
from pathlib import Path

from rpms_ros.cli.options import (
    Subparsers,
    add_command,
    add_option,
    add_simulation_options,
    progress,
)
from rpms_ros.errors import RecordingError
from rpms_ros.printable import counted

_MUSCLES = ('arctan', 'boltzmann', 'gauss', 'weibull', 'unsaturated', 'pools', 'ding')
_OF_PULSES = ('duration', 'pulse_rate', 'intensity')
_DISTURBANCES = {
    'noise': 'standard deviation of white noise',
    'offset': 'constant baseline',
    'drift': 'amplitude of a slow baseline',
    'artifact': 'peak of the stimulation artifact at full intensity',
}


def add_simulate(subparsers: Subparsers) -> None:
    """Add `rpms simulate`."""
    parser = add_command(subparsers, 'simulate', run, 'a recording of a simulated session')
    parser.add_argument('--out', type=Path, required=True, metavar='BAG', help='new folder')
    add_option(parser, '--compression', '', 'of the recording', choices=('', 'lz4', 'zstd'))
    group = parser.add_argument_group('stimulation')
    text = 'uniform_random, sinusoid, staircase, constant, or a YAML file'
    add_option(group, '--schedule NAME|FILE', 'uniform_random', text)
    add_option(group, '--duration S', 90.0, 'length [s]')
    add_option(group, '--pulse-rate HZ', 20.0, '[Hz]')
    add_option(group, '--intensity SHARE', 1.0, 'of the constant schedule, share of the maximum')
    add_option(group, '--seed', 1, 'of pulses, noise and random subject')
    group = parser.add_argument_group('muscle and force sensor')
    add_simulation_options(group, 'the truth is recorded as well (default: a steady muscle)')
    text = (
        'another kind than that of the model, arctan: a recruitment of another shape, or motor '
        'units that sum by calcium (ding)'
    )
    add_option(group, '--muscle KIND', 'arctan', text, choices=_MUSCLES)
    add_option(group, '--rate HZ', 1000.0, 'of the force')
    for name, what in _DISTURBANCES.items():
        text = f'{what} [N] (default: that of the scenario, else 0)'
        add_option(group, f'--{name} N', None, text, type=float)


def run(arguments: argparse.Namespace) -> int:
    """Simulate and record the session.

    Simulates a session, faster than real time: a schedule of pulses, a muscle and a force sensor.
    The recording is like one from a lab; its notes hold the true parameters of the muscle.

    Examples
    --------
      rpms simulate --out session                              the paper's simulated identification
      rpms simulate --out session --schedule sinusoid --noise 0.05 --seed 3
      rpms simulate --out session --subject random --schedule my_schedule.yaml --drift 0.1
      rpms identify session
    """
    from rpms_ros.api import simulating
    from rpms_ros.muscle import Contraction, subject_by_name
    from rpms_ros.muscle.motor_units import MotorUnits
    from rpms_ros.muscle.scenario import Scenario, load_scenario
    from rpms_ros.muscle.sensor import Disturbances
    from rpms_ros.muscle.simulation import Surroundings, simulate_session
    from rpms_ros.recording import write_recording

    if arguments.out.exists():
        raise RecordingError(f'expected a new folder for the recording, got {arguments.out}')
    scenario = load_scenario(arguments.scenario) if arguments.scenario else Scenario()
    # those that are given replace those of the scenario
    values = {name: getattr(arguments, name) for name in _DISTURBANCES}
    given = {name: value for name, value in values.items() if value is not None}
    scenario = replace(scenario, disturbances=replace(scenario.disturbances, **given))
    seed, rate = arguments.seed, arguments.pulse_rate
    schedule = simulating.named_schedule(
        arguments.schedule, arguments.duration, rate, seed, arguments.intensity
    )
    subject = subject_by_name(arguments.subject, seed)
    of_units = arguments.muscle == 'ding'
    if arguments.muscle not in ('arctan', 'ding'):
        shape = replace(subject.recruitment, shape=arguments.muscle)
        subject = replace(subject, recruitment=shape.normalised())
    from_file = arguments.schedule not in simulating.SCHEDULES
    _refuse_what_has_no_effect(arguments, from_file)
    # in a file each pulse has the weight of its own rate
    fixed_rate = None if from_file else rate
    pulses = schedule.pulses(simulating.START_NS)
    stamp_ns = simulating.sample_times(schedule.length_s, arguments.rate)
    muscle = (MotorUnits if of_units else Contraction)(subject, fixed_rate, scenario.living)
    around = Surroundings(scenario, seed)
    truth_rate = simulating.TRUTH_RATE if arguments.scenario or of_units else 0.0
    with progress('simulating', len(stamp_ns), 'samples', arguments.quiet) as advance:
        forces, truths = simulate_session(muscle, around, pulses, stamp_ns, truth_rate, advance)
    each = vars(scenario.disturbances).items()
    added = {name: value for name, value in each if value != getattr(Disturbances, name)}
    notes = {
        ('motor_units' if of_units else 'subject'): json.dumps(asdict(subject)),
        'scenario': scenario.name,
        'disturbances': json.dumps(added),
        'schedule': schedule.name,
        'seed': str(seed),
    }
    further = (simulating.truth_topic(truths),) if truths else ()
    what = arguments.out, pulses, forces
    write_recording(*what, compression=arguments.compression, custom=notes, further=further)
    counts = f'{counted(len(pulses), "pulse")}, {counted(len(forces), "sample")}'
    print(f'{arguments.out}: {counts}, {schedule.length_s:g} s')
    return 0


def _refuse_what_has_no_effect(arguments: argparse.Namespace, from_file: bool) -> None:
    """Refuse options of pulses that the schedule does not follow."""
    schedule = arguments.schedule
    unused: tuple[str, ...] = () if schedule == 'constant' else ('intensity',)
    where = '--schedule constant'
    if from_file:
        unused, where = _OF_PULSES, 'a schedule by its name'
    for name in unused:
        if getattr(arguments, name) != arguments.parser.get_default(name):
            option = f'--{name.replace("_", "-")}'
            raise RecordingError(f'expected {where} with {option}, got --schedule {schedule}')
