# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms simulate``: a recording of a simulated session, without ROS."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rpms_ros.cli.options import add_command, add_option, progress
from rpms_ros.errors import RecordingError
from rpms_ros.printable import counted
from rpms_ros.pulses import ForceTrace, PulseTrain

if TYPE_CHECKING:
    from rpms_ros.muscle import Subject
    from rpms_ros.muscle.scenario import Scenario
    from rpms_ros.muscle.simulation import Truth
    from rpms_ros.stimulation import Schedule

_DESCRIPTION = """\
Simulates a session, faster than real time: a schedule of pulses, a muscle and a force sensor.
The recording is like one from a lab; its notes hold the true parameters of the muscle.
"""
_EXAMPLES = """\
  rpms simulate --out session                               the paper's simulated identification
  rpms simulate --out session --schedule sinusoid --noise 0.05 --seed 3
  rpms simulate --out session --subject random --schedule my_schedule.yaml --drift 0.1
  rpms identify session
"""
_SUBJECTS = ('simulation', 'rpms', 'fes', 'random')
_OF_PULSES = ('duration', 'pulse_rate', 'intensity')
_DISTURBANCES = {
    'noise': 'standard deviation of white noise',
    'offset': 'constant baseline',
    'drift': 'amplitude of a slow baseline',
    'artifact': 'peak of the stimulation artifact at full intensity',
}
# How often the truth is recorded [Hz].
_TRUTH_RATE = 10.0


def add_parser(subparsers: 'argparse._SubParsersAction[argparse.ArgumentParser]') -> None:
    """Add the command to the command line."""
    parser = add_command(
        subparsers, 'simulate', run, 'a recording of a simulated session', _DESCRIPTION, _EXAMPLES
    )
    parser.add_argument('--out', type=Path, required=True, metavar='BAG', help='new folder')
    add_option(parser, '--storage', 'mcap', 'format', choices=('mcap', 'sqlite3'))
    add_option(parser, '--compression', '', 'of mcap', choices=('', 'lz4', 'zstd'))
    group = parser.add_argument_group('stimulation')
    add_option(
        group,
        '--schedule NAME|FILE',
        'uniform_random',
        'uniform_random, sinusoid, staircase, constant, or a YAML file',
    )
    add_option(group, '--duration S', 90.0, 'length [s]')
    add_option(group, '--pulse-rate HZ', 20.0, '[Hz]')
    text = 'of the constant schedule, share of the maximum'
    add_option(group, '--intensity SHARE', 1.0, text)
    add_option(group, '--seed', 1, 'of pulses, noise and random subject')
    group = parser.add_argument_group('muscle and force sensor')
    add_option(
        group,
        '--subject',
        'simulation',
        'muscle of the simulated identification (Table 4), average magnetic or electrical '
        '(Tables 1 to 3), or random',
        choices=_SUBJECTS,
    )
    group.add_argument(
        '--own-rates',
        action='store_true',
        help='weight each pulse by its own repetition rate; default for a schedule file, while '
        'the others take --pulse-rate for all',
    )
    add_option(group, '--rate HZ', 1000.0, 'of the force')
    text = (
        'what happens in the session: fatigue, coil-moved, voluntary, restless, bad-sensor, '
        'steady, or a YAML file; the truth is recorded as well (default: a steady muscle)'
    )
    add_option(group, '--scenario NAME|FILE', '', text)
    for name, what in _DISTURBANCES.items():
        add_option(group, f'--{name} N', 0.0, f'{what} [N]')


def run(arguments: argparse.Namespace) -> int:
    """Simulate and record the session."""
    from rpms_ros.api.simulating import (
        SCHEDULES,
        START_NS,
        named_schedule,
        named_subject,
        sample_times,
    )
    from rpms_ros.muscle.simulation import Surroundings, simulate_session
    from rpms_ros.muscle.time_varying import muscle_of

    if arguments.out.exists():
        raise RecordingError(f'expected a new folder for the recording, got {arguments.out}')
    scenario = _scenario(arguments)
    schedule = named_schedule(
        arguments.schedule,
        arguments.duration,
        arguments.pulse_rate,
        arguments.seed,
        arguments.intensity,
    )
    subject = named_subject(arguments.subject, arguments.seed)
    from_file = arguments.schedule not in SCHEDULES
    _refuse_what_has_no_effect(arguments, from_file)
    fixed_rate = None if arguments.own_rates or from_file else arguments.pulse_rate
    pulses = schedule.pulses(START_NS)
    stamp_ns = sample_times(schedule.length_s, arguments.rate)
    with progress('simulating', len(stamp_ns), 'samples', arguments.quiet) as advance:
        forces, truths = simulate_session(
            muscle_of(subject, scenario.living, fixed_rate),
            Surroundings(scenario, arguments.seed),
            pulses,
            stamp_ns,
            _TRUTH_RATE if arguments.scenario else 0.0,
            advance,
        )
    _write(arguments, pulses, forces, truths, _notes(arguments, schedule, subject))
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


def _scenario(arguments: argparse.Namespace) -> 'Scenario':
    """Return what happens; disturbances that are given replace those of the scenario."""
    from rpms_ros.muscle.scenario import Scenario, load_scenario

    scenario = load_scenario(arguments.scenario) if arguments.scenario else Scenario()
    given = {name: getattr(arguments, name) for name in _DISTURBANCES if getattr(arguments, name)}
    return replace(scenario, disturbances=replace(scenario.disturbances, **given))


def _notes(
    arguments: argparse.Namespace,
    schedule: 'Schedule',
    subject: 'Subject',
) -> dict[str, str]:
    """Return the true parameters of the session, for metadata.yaml."""
    return {
        'subject': json.dumps(asdict(subject)),
        'disturbances': json.dumps(
            {name: getattr(arguments, name) for name in _DISTURBANCES if getattr(arguments, name)}
        ),
        'schedule': schedule.name,
        'seed': str(arguments.seed),
    }


def _write(
    arguments: argparse.Namespace,
    pulses: PulseTrain,
    forces: ForceTrace,
    truths: 'Sequence[Truth]',
    notes: dict[str, str],
) -> None:
    """Write the recording, with the truth beside pulses and force where there is one."""
    from rpms_ros.api.simulating import truth_topic
    from rpms_ros.recording import write_recording

    write_recording(
        arguments.out,
        pulses,
        forces,
        storage=arguments.storage,
        compression=arguments.compression,
        custom=notes,
        further=(truth_topic(truths),) if truths else (),
    )
