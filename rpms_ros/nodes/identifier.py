"""Node that identifies the muscle: `force` and `pulses` in, `estimate` out.

Callbacks only collect; a timer hands what has come to the stream.  How it is cut into blocks has
no influence on the estimates, so a replay of a recording gives them bit for bit.
"""

import time
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock
from rclpy.clock import ClockType
from rclpy.node import Node

from rpms_msgs.msg import MuscleEstimate
from rpms_msgs.msg import Pulse as PulseMessage
from rpms_ros import messages
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.identifier_parameters import IdentifierParameters
from rpms_ros.nodes.identifier_parameters import build_stream
from rpms_ros.nodes.interfaces import MESSAGE_TYPES
from rpms_ros.nodes.logger import logger_of
from rpms_ros.nodes.parameters import declare_parameters
from rpms_ros.nodes.runner import run
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import Pulse
from rpms_ros.pulses import PulseTrain

# Silence of the force after which somebody should look at the sensor [s].
_SILENCE = 5.0


class Identifier(Node):
    """On-line identification; keyword arguments go to `rclpy.node.Node`."""

    settings_type = IdentifierParameters

    def __init__(self, **options: Any) -> None:
        super().__init__('identifier', **options)
        self.settings = declare_parameters(self, IdentifierParameters)
        _warm_up(self.settings)
        self.stream = build_stream(self.settings)
        self._axis = messages.axis_of(self.settings.axis, self.settings.sign)
        self._stamps: list[int] = []
        self._forces: list[float] = []
        self._pulses: list[Pulse] = []
        self._reported: dict[str, int] = {}
        self._heard = time.monotonic()
        self._estimate = self.create_publisher(MuscleEstimate, topics.ESTIMATE, qos.ESTIMATE)
        self.create_subscription(PulseMessage, topics.PULSES, self._on_pulse, qos.PULSES)
        profile = qos.FORCE_BEST_EFFORT if self.settings.best_effort_force else qos.FORCE
        self.create_subscription(WrenchStamped, topics.FORCE, self._on_force, profile)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(self.settings.processing_period, self._process, clock=steady)
        self.create_timer(1.0, self._report, clock=steady)

    def _on_pulse(self, message: PulseMessage) -> None:
        self._pulses.append(messages.pulse_of(message))

    def _on_force(self, message: WrenchStamped) -> None:
        stamp_ns, force = messages.force_of(message, self._axis)
        self._stamps.append(stamp_ns)
        self._forces.append(force)

    def _process(self) -> None:
        if self._pulses:
            self.stream.add_pulses(PulseTrain.of(self._pulses))
            self._pulses = []
        if self._stamps:
            self._heard = time.monotonic()
            stamps = np.array(self._stamps, dtype=np.int64)
            self.stream.add_forces(ForceTrace(stamps, np.array(self._forces)))
            self._stamps, self._forces = [], []
            for estimate in self.stream.advance():
                frame_id = self.settings.frame_id
                self._estimate.publish(
                    messages.estimate_message(estimate, MESSAGE_TYPES, frame_id)
                )

    def _report(self) -> None:
        faults = self.stream.fault_counts
        for name, count in faults.items():
            if count != self._reported.get(name):
                logger_of(self).warning(f'{name}: {count} so far')
        self._reported = faults
        silence = time.monotonic() - self._heard
        if silence > _SILENCE:
            topic = self.resolve_topic_name(topics.FORCE)
            publishers = self.count_publishers(topic)
            logger_of(self).warning(
                f'no force on {topic} for {silence:.0f} s ({publishers} publishers)',
                throttle_duration_sec=_SILENCE,
            )


def _warm_up(settings: IdentifierParameters) -> None:
    """Compile what will run: compiling takes seconds when it was never done on this machine."""
    stream = build_stream(settings)
    stream.add_pulses(PulseTrain.regular([0.5, 0.8], rate_hz=20.0))
    stream.add_forces(ForceTrace(np.arange(100, dtype=np.int64) * 1_000_000, np.ones(100)))
    stream.finish()


def main() -> int:
    """Run the identifier as a process."""
    return run(Identifier)
