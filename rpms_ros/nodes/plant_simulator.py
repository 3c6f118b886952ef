# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Node that simulates the muscle and its force sensor: `pulses` in, `force` out.

Samples are stamped by the clock of the node.
At each tick of a steady timer every sample that is due is published with its own stamp, so a late
tick delays samples but does not lose them or change their stamps.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from geometry_msgs.msg import WrenchStamped

from rpms_msgs.msg import MuscleTruth, Pulse as PulseMessage
from rpms_ros import estimate_messages, messages
from rpms_ros.axis import UNITS
from rpms_ros.errors import LARGEST_SEED, MuscleError, NodeError
from rpms_ros.muscle import SUBJECTS, Contraction, subject_by_name
from rpms_ros.muscle.scenario import Scenario, load_scenario
from rpms_ros.muscle.simulation import SampledPlant, Surroundings
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.diagnostics import logger_of
from rpms_ros.nodes.common.parameters import NodeParameters, declare_parameters, parameter, sensed
from rpms_ros.nodes.common.runner import NodeOfParts, every, run
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, Pulse, nanoseconds

# Noise of an ordinary sensor, as a share of the maximum force.
_NOISE_SHARE = 0.005


@dataclass(frozen=True)
class PlantParameters(NodeParameters):
    """Parameters of the plant simulator."""

    rate: float = parameter(1000.0, 'Force samples a second.', unit='Hz', bounds=(1.0, 20000.0))
    subject: str = parameter('rpms', 'Preset of the muscle.', choices=(*SUBJECTS, 'random'))
    seed: int = parameter(
        1, 'Seed of the noise, and of a random subject.', bounds=(0, LARGEST_SEED)
    )
    noise: float = parameter(
        -1.0,
        'Deviation of the noise; negative: that of the scenario, or 0.5 % of the maximum force.',
        unit='N',
        bounds=(-1.0, 1e6),
    )
    axis: str = parameter(
        'z', 'Axis of the wrench.', choices=('x', 'y', 'z', '-x', '-y', '-z'), true_is='y'
    )
    quantity: str = sensed('What is measured; with torque every N here is N m.')
    publication_delay: float = parameter(
        0.01, 'From stamp to publication: pulses come first.', unit='s', bounds=(0.0, 1.0)
    )
    scenario: str = parameter(
        '', 'Name or YAML file of a scenario, but for its noise if that is given; empty for none.'
    )
    minimum_subscribers: int = parameter(
        0, 'Subscribers of the force to wait for before the first sample.', bounds=(0, 100)
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            build_plant(self)
        except MuscleError as error:
            raise NodeError(str(error)) from error


def scenario_of(settings: PlantParameters) -> Scenario:
    """Return the scenario; the noise of the parameters replaces its own."""
    scenario = load_scenario(settings.scenario) if settings.scenario else Scenario()
    noise = settings.noise
    if noise < 0.0 and settings.scenario:
        return scenario
    if noise < 0.0:
        # without any a resting force would be that of a sensor that is stuck
        noise = _NOISE_SHARE * subject_by_name(settings.subject, settings.seed).maximum_force
    return replace(scenario, disturbances=replace(scenario.disturbances, noise=noise))


def build_plant(settings: PlantParameters) -> SampledPlant:
    """Return the plant that the parameters describe."""
    scenario, subject = scenario_of(settings), subject_by_name(settings.subject, settings.seed)
    muscle = Contraction(subject, settings=scenario.living)
    return SampledPlant(muscle, Surroundings(scenario, settings.seed), settings.rate)


_FRAME = 'force_sensor'
_TRUTH_PERIOD_NS = NANOSECONDS_PER_SECOND // 10
_FASTEST_TICK = 1000.0
# Samples per tick, so that pulses are received while the node catches up.
_LARGEST_BURST = 500


class PlantSimulator(NodeOfParts):
    """Simulated muscle; keyword arguments go to `rclpy.node.Node`."""

    settings_type = PlantParameters

    def __init__(self, **options: Any) -> None:
        super().__init__('plant_simulator', **options)

    def _build(self) -> None:
        self.settings = settings = declare_parameters(self, PlantParameters)
        _warm_up(settings)
        self.plant = build_plant(settings)
        self._begun = False
        quantity = settings.quantity
        self._sensor = messages.AXES[settings.axis], MESSAGE_TYPES, _FRAME, quantity
        self._force = self.create_publisher(WrenchStamped, topics.FORCE, qos.FORCE)
        self._truth = self.create_publisher(MuscleTruth, topics.TRUTH, qos.TRUTH)
        self._next_truth_ns = 0
        self.create_subscription(PulseMessage, topics.PULSES, self._on_pulse, qos.PULSES)
        self._delay_ns = nanoseconds(settings.publication_delay)
        every(self, 1.0 / min(settings.rate, _FASTEST_TICK), self._tick)
        what = f'{settings.subject}: {quantity} [{UNITS[quantity]}] along {settings.axis}'
        logger_of(self).info(f'simulating subject {what} at {settings.rate:g} Hz')

    def _on_pulse(self, message: PulseMessage) -> None:
        pulse = messages.pulse_of(message)
        fault = self.plant.add(pulse)
        if fault is not None:
            said = f'{fault}: {pulse} ({self.plant.faults[fault]} so far)'
            logger_of(self).warning(said, throttle_duration_sec=1.0)

    def _tick(self) -> None:
        now_ns = int(self.get_clock().now().nanoseconds)
        wanted = self.settings.minimum_subscribers
        # 0: simulated time that nobody has told yet
        if not self._begun and now_ns and self._force.get_subscription_count() >= wanted:
            self.plant.begin(now_ns)
            self._begun = True
        if self._begun:
            self._publish_due(now_ns - self._delay_ns)

    def _publish_due(self, until_ns: int) -> None:
        trace = self.plant.sample(min(self.plant.due(until_ns), _LARGEST_BURST))
        for stamp_ns, force in zip(trace.stamp_ns.tolist(), trace.force.tolist(), strict=True):
            self._force.publish(messages.force_message(stamp_ns, force, *self._sensor))
        newest_ns = self.plant.newest_ns
        if newest_ns >= self._next_truth_ns:
            self._next_truth_ns = newest_ns + _TRUTH_PERIOD_NS
            truth = self.plant.truth()
            self._truth.publish(estimate_messages.truth_message(truth, MESSAGE_TYPES, _FRAME))


def _warm_up(settings: PlantParameters) -> None:
    """Compile the model before the first sample: without numba's cache it takes seconds."""
    plant = build_plant(settings)
    plant.begin(0)
    for onset_s in (0, 1, 10):
        plant.add(Pulse(onset_s * NANOSECONDS_PER_SECOND, 0.5))
    plant.sample(1)
    plant.begin(20 * NANOSECONDS_PER_SECOND)
    plant.sample(1)


# Runs the plant simulator as a process.
main = partial(run, PlantSimulator)
