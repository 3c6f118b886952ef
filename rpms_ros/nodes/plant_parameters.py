# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the plant simulator, and the plant that they describe."""

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpms_ros.axis import FORCE
from rpms_ros.axis import UNITS
from rpms_ros.errors import MuscleError
from rpms_ros.errors import NodeError
from rpms_ros.muscle import SUBJECTS
from rpms_ros.muscle import Disturbances
from rpms_ros.muscle import Subject
from rpms_ros.muscle import random_subject
from rpms_ros.muscle import subject_by_name
from rpms_ros.muscle.living import muscle_of
from rpms_ros.muscle.plant import SampledPlant
from rpms_ros.muscle.scenario import Scenario
from rpms_ros.muscle.scenario import load_scenario
from rpms_ros.muscle.surroundings import Surroundings
from rpms_ros.nodes.parameters import NodeParameters
from rpms_ros.nodes.parameters import parameter
from rpms_ros.seeds import LARGEST_SEED

RANDOM = 'random'
_LARGEST_FORCE = 1e6
_EITHER_SIGN = {'minimum': -_LARGEST_FORCE, 'maximum': _LARGEST_FORCE}
_KEEP = 'negative keeps the preset'
# Noise of an ordinary sensor, as a share of the maximum force.
_NOISE_SHARE = 0.005


@dataclass(frozen=True)
class PlantParameters(NodeParameters):
    """Parameters of the plant simulator."""

    rate: float = parameter(
        1000.0, 'Force samples a second.', unit='Hz', minimum=1.0, maximum=20000.0
    )
    subject: str = parameter('rpms', 'Preset of the muscle.', choices=(*SUBJECTS, RANDOM))
    seed: int = parameter(
        1, 'Seed of the noise, and of a random subject.', minimum=0, maximum=LARGEST_SEED
    )
    maximum_force: float = parameter(
        -1.0,
        f'Steady mean force at full intensity and 20 Hz; {_KEEP}.',
        unit='N',
        minimum=-1.0,
        maximum=_LARGEST_FORCE,
    )
    time_constant: float = parameter(
        -1.0, f'Time constant of the twitch; {_KEEP}.', unit='s', minimum=-1.0, maximum=10.0
    )
    latency: float = parameter(
        -1.0, f'From pulse to onset of force; {_KEEP}.', unit='s', minimum=-1.0, maximum=1.0
    )
    threshold: float = parameter(
        -1.0, f'Threshold of recruitment; {_KEEP}.', minimum=-1.0, maximum=1.0
    )
    saturation: float = parameter(
        -1.0, f'Saturation of recruitment; {_KEEP}.', minimum=-1.0, maximum=2.0
    )
    noise: float = parameter(
        -1.0,
        'Standard deviation of the noise; negative: that of the scenario, or half a percent of '
        'the maximum force.',
        unit='N',
        minimum=-1.0,
        maximum=_LARGEST_FORCE,
    )
    offset: float = parameter(0.0, 'Constant baseline.', unit='N', **_EITHER_SIGN)
    drift: float = parameter(
        0.0, 'Amplitude of a slow sinusoidal baseline.', unit='N', **_EITHER_SIGN
    )
    drift_period: float = parameter(120.0, 'Its period.', unit='s', minimum=0.1, maximum=86400.0)
    artifact: float = parameter(
        0.0, 'Peak of the stimulation artifact at full intensity.', unit='N', **_EITHER_SIGN
    )
    artifact_decay: float = parameter(
        0.0005, 'Time constant of the artifact.', unit='s', minimum=1e-6, maximum=0.005
    )
    largest_force: float = parameter(
        _LARGEST_FORCE,
        'Largest force that the sensor shows.',
        unit='N',
        minimum=1e-3,
        maximum=_LARGEST_FORCE,
    )
    axis: str = parameter(
        'z', 'Axis of the wrench.', choices=('x', 'y', 'z', '-x', '-y', '-z'), true_is='y'
    )
    quantity: str = parameter(
        FORCE,
        'What the sensor measures; with torque every N here is N m.',
        choices=tuple(UNITS),
    )
    frame_id: str = parameter('force_sensor', 'Frame of the wrench.')
    publication_delay: float = parameter(
        0.01,
        'Samples are published this much after their stamp, so that pulses arrive before them.',
        unit='s',
        minimum=0.0,
        maximum=1.0,
    )
    scenario: str = parameter(
        '',
        'Name or YAML file of a scenario; empty for a muscle that does not change. '
        'Disturbances given by parameters replace those of the scenario.',
    )
    truth_rate: float = parameter(
        10.0,
        'Messages a second with the true state of the muscle; 0 for none.',
        unit='Hz',
        minimum=0.0,
        maximum=100.0,
    )
    minimum_subscribers: int = parameter(
        0, 'Subscribers of the force to wait for before the first sample.', minimum=0, maximum=100
    )
    publish_clock: bool = parameter(False, 'Publish /clock and stamp the samples by it.')
    real_time_factor: float = parameter(
        1.0, 'Seconds of /clock in one second.', minimum=0.01, maximum=100.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.real_time_factor != 1.0 and not self.publish_clock:
            raise NodeError(
                'expected publish_clock with a real_time_factor other than 1.0, '
                f'got {self.real_time_factor} without'
            )
        try:
            build_plant(self)
        except MuscleError as error:
            raise NodeError(str(error)) from error


def subject_of(settings: PlantParameters) -> Subject:
    """Return the preset with the changes by the parameters."""
    if settings.subject == RANDOM:
        preset = random_subject(np.random.default_rng(settings.seed))
    else:
        preset = subject_by_name(settings.subject)
    curve = preset.recruitment
    if changes := _given(settings, ('threshold', 'saturation')):
        curve = dataclasses.replace(curve, **changes).normalised()
    changes = _given(settings, ('maximum_force', 'time_constant', 'latency'))
    return dataclasses.replace(preset, recruitment=curve, **changes)


def scenario_of(settings: PlantParameters) -> Scenario:
    """Return the scenario, with disturbances given by parameters in place of its own."""
    scenario = load_scenario(settings.scenario) if settings.scenario else Scenario()
    given = {'saturation': settings.largest_force}
    for name in ('noise', 'offset', 'drift', 'drift_period', 'artifact', 'artifact_decay'):
        given[name] = getattr(settings, name)
    if settings.scenario:
        default = {**dataclasses.asdict(Disturbances(saturation=_LARGEST_FORCE)), 'noise': -1.0}
        given = {name: value for name, value in given.items() if value != default[name]}
    elif settings.noise < 0.0:
        # without any a resting force would be that of a sensor that is stuck
        given['noise'] = _NOISE_SHARE * subject_of(settings).maximum_force
    disturbances = dataclasses.replace(scenario.disturbances, **given)
    return dataclasses.replace(scenario, disturbances=disturbances)


def build_plant(settings: PlantParameters) -> SampledPlant:
    """Return the plant that the parameters describe."""
    scenario = scenario_of(settings)
    return SampledPlant(
        muscle_of(subject_of(settings), scenario.living),
        Surroundings(scenario, settings.seed),
        settings.rate,
    )


def _given(settings: PlantParameters, names: tuple[str, ...]) -> dict[str, Any]:
    values = {name: getattr(settings, name) for name in names}
    return {name: value for name, value in values.items() if value >= 0}
