# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``rpms demo``: all nodes on this machine, with a simulated muscle whose parameters are known."""

import argparse
import socket
import time
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpms_ros.cli.options import (
    Subparsers,
    add_command,
    add_option,
    add_preset_option,
    add_simulation_options,
)
from rpms_ros.errors import NodeError

if TYPE_CHECKING:
    from rpms_ros.muscle import Subject
    from rpms_ros.muscle.scenario import Scenario
    from rpms_ros.nodes.simulation_launcher import SimulationLauncher

PORT = 8765
# Between two lines that say how it goes [s].
_PERIOD = 5.0


def add_demo(subparsers: Subparsers) -> None:
    """Add `rpms demo`."""
    summary = 'simulated muscle, driver and identifier live, with a report (needs ROS 2)'
    parser = add_command(subparsers, 'demo', run, summary)
    add_option(parser, '--duration S', 45.0, 'stimulation [s]')
    schedules = ('uniform_random', 'sinusoid', 'staircase')
    add_option(parser, '--schedule', 'uniform_random', 'course of intensity', choices=schedules)
    add_simulation_options(parser, 'its noise counts unless --noise is given')
    text = 'standard deviation of the noise of the sensor [N]; negative: 0.5 %% of the force'
    add_option(parser, '--noise N', -1.0, text)
    add_option(parser, '--seed K', 1, 'of pulses, noise and random subject')
    text = (
        'one pass with a state of fixed size, or one that follows a muscle that changes '
        '(default: recursive, with a scenario tracking)'
    )
    add_option(parser, '--estimator', None, text, choices=('recursive', 'tracking'))
    add_preset_option(parser)
    text = 'show it in the browser while it runs, on this port (default: 8765)'
    parser.add_argument('--live', nargs='?', type=int, const=PORT, metavar='PORT', help=text)
    text = 'new folder for the recording; out/demo_<time> if not given'
    add_option(parser, '--out DIR', None, text, type=Path)


def run(arguments: argparse.Namespace) -> int:
    """Run the simulation, then report; return the exit code.

    Starts a simulated muscle, a stimulator driver and the identifier as three ROS 2 nodes, each a
    process of its own, on this machine and in a DDS domain of their own.  The muscle is stimulated
    at 20 Hz and measured at 1 kHz; pulses, force and estimates are recorded.  At the end the
    identified curve is compared with the true one, and the recording is identified again off
    line, which has to give the same estimates in every bit.  With a scenario the muscle tires, the
    coil moves or the patient tenses, as in `rpms simulate --scenario`.

    Examples
    --------
      rpms demo --live                           and open http://127.0.0.1:8765/
      rpms demo --duration 30 --schedule sinusoid
      rpms demo --subject rpms --noise 0.05 --estimator tracking
      rpms demo --scenario fatigue               a muscle that tires, followed by tracking

    exit code: 0 if the schedule ran to its end, no sample was lost and the replay is exact, 1
    otherwise, 2 if it could not run.
    """
    from rpms_ros.api.simulating import named_schedule
    from rpms_ros.muscle import subject_by_name
    from rpms_ros.muscle.scenario import load_scenario
    from rpms_ros.nodes.identifier import IdentifierParameters
    from rpms_ros.nodes.plant_simulator import PlantParameters
    from rpms_ros.nodes.simulation_launcher import IDENTIFIER, PLANT, SimulationLauncher

    if arguments.live is not None and not 1 <= arguments.live <= 65535:
        raise NodeError(f'expected a port of 1 to 65535, got {arguments.live}')
    if not 1.0 <= arguments.duration <= 3600.0:
        raise NodeError(f'expected a duration of 1 to 3600 s, got {arguments.duration}')
    scenario = load_scenario(arguments.scenario) if arguments.scenario else None
    seed, parameters = arguments.seed, node_parameters(arguments)
    schedule = named_schedule(arguments.schedule, arguments.duration, 20.0, seed)
    # refused before any node has started
    PlantParameters(**parameters[PLANT])
    IdentifierParameters(**parameters[IDENTIFIER])
    subject = subject_by_name(arguments.subject, seed)
    name = datetime.now().astimezone().strftime('demo_%Y%m%d_%H%M%S')
    folder = arguments.out or Path('out') / name
    print(f'three nodes, one recording, in {folder}', flush=True)
    with SimulationLauncher(folder, parameters, schedule) as launcher:
        if arguments.live is not None:
            _await_page(launcher, arguments.live)
            print(f'in the browser: http://127.0.0.1:{arguments.live}/', flush=True)
        _watch(launcher, subject, arguments.duration, arguments.quiet)
        launcher.stop()
    if not launcher.monitor.estimates:
        fault = 'expected estimates, got none before the driver stopped'
        raise NodeError(f'{fault}: is this machine busy? What the nodes said is in {folder}')
    return _report(launcher, subject, parameters[IDENTIFIER], scenario)


def node_parameters(arguments: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Return the parameters of the nodes, by name."""
    from rpms_ros.nodes.simulation_launcher import IDENTIFIER, LIVE_PAGE, PLANT

    scenario = arguments.scenario
    if scenario and Path(scenario).exists():
        # the nodes may run elsewhere
        scenario = str(Path(scenario).resolve())
    estimator = arguments.estimator or ('tracking' if scenario else 'recursive')
    return {
        PLANT: {
            'rate': 1000.0,
            'subject': arguments.subject,
            'seed': arguments.seed,
            'noise': arguments.noise,
            'scenario': scenario,
            # on a busy machine pulses arrive late, but still before their force
            'publication_delay': 0.05,
        },
        IDENTIFIER: {'estimator': estimator, 'preset': arguments.preset},
        **({} if arguments.live is None else {LIVE_PAGE: {'port': arguments.live}}),
    }


def _await_page(launcher: 'SimulationLauncher', port: int) -> None:
    """Return when the live page answers: whoever opens it before sees an error of the browser."""
    from rpms_ros.nodes.simulation_launcher import STARTUP_LIMIT

    end = time.monotonic() + STARTUP_LIMIT
    while time.monotonic() < end:
        try:
            socket.create_connection(('127.0.0.1', port), timeout=1.0).close()
        except OSError:
            launcher.step(0.1)
        else:
            return
    raise NodeError(f'expected the live page to answer within {STARTUP_LIMIT:.0f} s')


def _watch(
    launcher: 'SimulationLauncher', subject: 'Subject', duration: float, quiet: bool
) -> None:
    """Show progress until the schedule has run.

    It ends with the last pulse: after it, an estimator that forgets would lose what it learnt.
    """
    from rpms_ros.nodes.simulation_launcher import STARTUP_LIMIT

    started = time.monotonic()
    shown = -_PERIOD
    while not launcher.monitor.done:
        launcher.step(0.1)
        elapsed = time.monotonic() - started
        if not launcher.monitor.has_run and elapsed > STARTUP_LIMIT:
            raise NodeError(f'expected the driver to run within {STARTUP_LIMIT:.0f} s')
        if elapsed > STARTUP_LIMIT + 2 * duration:
            raise NodeError(f'expected the schedule to end after {duration:g} s')
        # that the nodes are starting is said once
        new = shown < 0.0 or launcher.monitor.estimates
        if elapsed - shown >= _PERIOD and new and not quiet:
            shown = elapsed
            _show(launcher, subject, duration, elapsed)
    _show(launcher, subject, duration, time.monotonic() - started)
    status = launcher.monitor.status
    if status.fault_names:
        faults = zip(status.fault_names, status.fault_counts, strict=True)
        print('  driver: ' + ', '.join(f'{name} {count}' for name, count in faults))
    if launcher.monitor.broken_off:
        print(f'  driver: ended before the schedule did: {launcher.monitor.broken_off}')


def _show(
    launcher: 'SimulationLauncher', subject: 'Subject', duration: float, elapsed: float
) -> None:
    """Show one line: time left, error of the curve, parameters, lost samples and pulses."""
    from rpms_ros.report.known_muscle import of_truths

    truth = of_truths(launcher.monitor.truths, subject)
    status, estimates = launcher.monitor.status, launcher.monitor.estimates
    if not launcher.monitor.has_run or not estimates or truth is None:
        line = f'{elapsed:5.1f} s  nodes are starting; the first time they compile for minutes'
    else:
        last, counts = estimates[-1], launcher.recorder.counts
        parameters = zip(last.nonlinear_names, last.nonlinear, strict=True)
        found = '  '.join(f'{name} {value:.3g}' for name, value in parameters)
        line = (
            f'{duration - status.time_left:5.1f} s  '
            f'curve error {100 * truth.error(last):5.1f} %  {found}  '
            f'samples {counts["force"]} (lost {launcher.recorder.lost.get("force", 0)})  '
            f'pulses {counts["pulses"]} (dropped {status.pulses_dropped})'
        )
    print(f'  {line}', flush=True)


def _report(
    launcher: 'SimulationLauncher',
    subject: 'Subject',
    identifier: dict[str, Any],
    scenario: 'Scenario | None',
) -> int:
    """Identify the recording, print what came out; return the exit code."""
    from rpms_ros.identification.quality.doubts import PULSE_LATE
    from rpms_ros.nodes.simulation_launcher import RECORDING
    from rpms_ros.recording import read_recording
    from rpms_ros.report.course import course_of, steadiness
    from rpms_ros.report.known_muscle import of_subject
    from rpms_ros.report.recorded import compare, true_muscle
    from rpms_ros.report.result import IdentificationOptions, identified

    path = launcher.folder / RECORDING
    recording = read_recording(path)
    estimator, preset = identifier['estimator'], identifier['preset']
    # what `rpms identify` does, on what the identifier heard
    session = identified(recording, IdentificationOptions(estimator, preset))
    rate = session.last.repetition_rate
    truth = true_muscle(recording, rate)
    truth = of_subject(subject, rate) if truth is None else truth._replace(subject=subject)
    course = course_of(session)
    judged = truth.judged(course)
    print(f'  truth      {"no curve was found" if judged is None else judged.sentence}')
    if scenario is not None:
        print(f'  scenario   {scenario.name}: {scenario.description}')
        print(f'  found      {steadiness(course)}')
    print(f'  recording  {path}')
    print(f'  off line   rpms report {path} --estimator {estimator} --preset {preset}')
    faults = dict(launcher.monitor.estimates[-1].faults)
    lost = launcher.recorder.lost.get('force', 0)
    print(f'  samples    {len(recording.forces)}, lost {lost}; faults {faults or "none"}')
    agreement = compare(launcher.monitor.estimates, session.estimates)
    print(f'  replay     {agreement}')
    if PULSE_LATE in faults and not agreement.exact:
        print('             pulses came late, as on a busy machine: not to each process alike')
    # a scenario makes faults of its own, and a bad sensor loses samples
    wanted = scenario is not None and bool(scenario.sensor_faults)
    flawless = (not lost or wanted) and (not faults or scenario is not None)
    return 0 if agreement.exact and flawless and not launcher.monitor.broken_off else 1
