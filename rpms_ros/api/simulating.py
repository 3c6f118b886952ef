# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sessions with a simulated muscle, whose truth is known.

What is true of a simulated muscle, in a recording.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rpms_ros import estimate_messages, messages
from rpms_ros.api.loading import as_recording
from rpms_ros.api.session import Session
from rpms_ros.errors import RecordingError, StimulationError
from rpms_ros.muscle import Contraction, Subject, subject_by_name
from rpms_ros.muscle.scenario import Scenario, load_scenario
from rpms_ros.muscle.simulation import Surroundings, Truth, simulate_session
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, IntArray, stamps
from rpms_ros.recording.rosbag.definitions import encoded, known_types
from rpms_ros.recording.rosbag.writing import FurtherTopic
from rpms_ros.report.known_muscle import of_truths
from rpms_ros.stimulation import (
    Schedule,
    constant,
    load_schedule,
    paper_random,
    paper_sinusoid,
    staircase,
)
from rpms_ros.stimulation.schedule.segments import LEVELS

SCHEDULES = ('uniform_random', 'sinusoid', 'staircase', 'constant')
"""Schedules that have a name here."""
START_NS = 1_700_000_000 * NANOSECONDS_PER_SECOND
"""A fixed time, so that the same options make the same session in every bit [ns]."""
_HIGHEST_RATE = 1e6
TRUTH_RATE = 10.0
"""How often the truth of a muscle that changes is noted [Hz]."""


def simulate(
    schedule: str | Path | Schedule = 'uniform_random',
    *,
    duration: float = 60.0,
    subject: str | Subject = 'simulation',
    pulse_rate_hz: float = 20.0,
    intensity: float = 1.0,
    noise: float = 0.0,
    drift: float = 0.0,
    scenario: str | Path | Scenario | None = None,
    force_rate_hz: float = 1000.0,
    seed: int = 1,
) -> Session:
    """Return a session with a simulated muscle; ``session.subject`` is the truth.

    Parameters
    ----------
    schedule : str, Path or Schedule
        ``uniform_random``, ``sinusoid``, ``staircase``, ``constant``, a YAML file or a schedule.
    duration : float
        Length of a schedule that is given by its name [s].
    subject : str or Subject
        ``simulation`` (the plant of the paper's simulations), ``rpms`` or ``fes`` (the averages
        of its subjects), ``random`` (drawn from their ranges), or a muscle.
    pulse_rate_hz : float
        Repetition rate of a schedule that is given by its name [Hz]; every pulse has the weight of
        this rate.  In other schedules it is that of its own rate.
    intensity : float
        Of the constant schedule, share of the maximum.
    noise, drift : float
        Standard deviation of white noise and amplitude of a slow baseline [N]; 0 leaves those of
        the scenario.
    scenario : str, Path or Scenario, optional
        What happens: ``fatigue``, ``coil-moved``, ``voluntary``, ``restless``, ``bad-sensor``, a
        YAML file or a scenario; a steady muscle if it is not given.
    force_rate_hz : float
        Rate of the force samples [Hz].
    seed : int
        Of pulses, noise and a random subject.

    Raises
    ------
    MuscleError, StimulationError, RecordingError
        If there is no such subject, scenario or schedule, or a value is not possible.

    Examples
    --------
    >>> import rpms_ros
    >>> session = rpms_ros.simulate('sinusoid', duration=9.0, noise=0.05)
    >>> len(session.pulses), session.info()['force_rate_hz']
    (180, 1000.0)
    """
    muscle = subject if isinstance(subject, Subject) else subject_by_name(subject, seed)
    named = isinstance(schedule, str) and schedule in SCHEDULES
    if intensity != 1.0 and schedule != 'constant':
        raise StimulationError(f'expected intensity with constant alone, got it with {schedule}')
    if not isinstance(schedule, Schedule):
        schedule = named_schedule(str(schedule), duration, pulse_rate_hz, seed, intensity)
    happens = scenario if isinstance(scenario, Scenario) else Scenario()
    if isinstance(scenario, str | Path):
        happens = load_scenario(str(scenario))
    given = {name: value for name, value in (('noise', noise), ('drift', drift)) if value}
    happens = replace(happens, disturbances=replace(happens.disturbances, **given))
    pulses = schedule.pulses(START_NS)
    simulated = Contraction(muscle, pulse_rate_hz if named else None, happens.living)
    around, truth_rate = Surroundings(happens, seed), 0.0 if scenario is None else TRUTH_RATE
    stamp_ns = sample_times(schedule.length_s, force_rate_hz)
    forces, truths = simulate_session(simulated, around, pulses, stamp_ns, truth_rate)
    recording = as_recording(pulses, forces, Path('simulated'), 'simulation')
    truth = of_truths(truths, muscle)
    return Session(f'simulated, {schedule.name}', recording, subject=muscle, truth=truth)


def named_schedule(
    name: str, duration: float, rate_hz: float, seed: int, intensity: float = 1.0
) -> Schedule:
    """Return a schedule of `SCHEDULES`, or that of a YAML file; parameters as of `simulate`.

    Raises
    ------
    StimulationError
        If there is neither, or the schedule is not possible.
    """
    known: dict[str, Callable[[], Schedule]] = {
        'uniform_random': lambda: paper_random(duration, rate_hz, seed),
        'sinusoid': lambda: paper_sinusoid(duration, rate_hz),
        'staircase': lambda: staircase(LEVELS, duration / len(LEVELS), rate_hz),
        'constant': lambda: constant(intensity, duration, rate_hz),
    }
    if name in known:
        return known[name]()
    path = Path(name)
    if not path.exists():
        fault = f'expected a schedule of {", ".join(SCHEDULES)} or a file, got {name}'
        raise StimulationError(fault)
    return load_schedule(path)


def sample_times(length_s: float, rate_hz: float) -> IntArray:
    """Return the stamps (samples,) [ns] of a session from `START_NS` up to its end.

    Raises
    ------
    RecordingError
        If the rate is not possible.
    """
    if not 0 < rate_hz <= _HIGHEST_RATE:
        fault = f'expected a rate of the force above 0 and up to {_HIGHEST_RATE:g} Hz'
        raise RecordingError(f'{fault}, got {rate_hz}')
    return START_NS + stamps(np.arange(round(length_s * rate_hz)) / rate_hz)


def truth_topic(truths: Sequence[Truth]) -> FurtherTopic:
    """Return the messages of topic ``/truth``, each received at its stamp."""
    kind, types = messages.MUSCLE_TRUTH, known_types().types
    contents = [encoded(estimate_messages.truth_message(one, types), kind) for one in truths]
    return FurtherTopic('/truth', kind, [one.stamp_ns for one in truths], contents)
