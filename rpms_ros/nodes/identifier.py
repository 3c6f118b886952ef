"""Node that identifies the muscle: `force` and `pulses` in, `estimate` out.

Callbacks only collect; a timer hands what has come to the stream.  How it is cut into blocks has
no influence on the estimates, so a replay of a recording gives them bit for bit.
"""

import time
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock
from rclpy.clock import ClockType
from rclpy.node import Node
from std_srvs.srv import Trigger

from rpms_msgs.msg import MuscleEstimate
from rpms_msgs.msg import Pulse as PulseMessage
from rpms_ros import messages
from rpms_ros.identification import Estimate
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.identifier_diagnostics import diagnostics_message
from rpms_ros.nodes.identifier_parameters import IdentifierParameters
from rpms_ros.nodes.identifier_parameters import build_stream
from rpms_ros.nodes.identifier_parameters import stream_settings
from rpms_ros.nodes.identifier_publishers import Publishers
from rpms_ros.nodes.interfaces import MESSAGE_TYPES
from rpms_ros.nodes.logger import logger_of
from rpms_ros.nodes.parameters import declare_parameters
from rpms_ros.nodes.parameters import follow_parameters
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
        self._last: Estimate | None = None
        self._estimate = self.create_publisher(MuscleEstimate, topics.ESTIMATE, qos.ESTIMATE)
        self._diagnostics = self.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, 10)
        self.create_subscription(PulseMessage, topics.PULSES, self._on_pulse, qos.PULSES)
        profile = qos.FORCE_BEST_EFFORT if self.settings.best_effort_force else qos.FORCE
        self.create_subscription(WrenchStamped, topics.FORCE, self._on_force, profile)
        self._senders = Publishers(self)
        self.create_service(Trigger, '~/reset', self._on_reset)
        follow_parameters(self, self.settings, self._change)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(self.settings.processing_period, self._process, clock=steady)
        self.create_timer(1.0, self._report, clock=steady)

    def _on_pulse(self, message: PulseMessage) -> None:
        self._pulses.append(messages.pulse_of(message))

    def _on_force(self, message: WrenchStamped) -> None:
        stamp_ns, force = messages.force_of(message, self._axis)
        self._stamps.append(stamp_ns)
        self._forces.append(force)

    def _on_best_effort_force(self, message: WrenchStamped) -> None:
        # What a reliable sensor sends has come already.
        if self._senders.best_effort_alone:
            self._on_force(message)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Forget everything and begin anew, as after a change of the electrode or the coil."""
        self.stream = build_stream(self.settings)
        self._stamps, self._forces, self._pulses = [], [], []
        self._reported = {}
        self._last = None
        logger_of(self).info('reset: the identification begins anew')
        response.success = True
        return response

    def _change(self, settings: IdentifierParameters) -> None:
        self.settings = settings
        self.stream.change(stream_settings(settings))
        logger_of(self).info(f'estimates every {settings.estimate_period:g} s from now on')

    def _process(self) -> None:
        if self._pulses:
            # First: a pulse that came a little later than its force, after a stall, is not late.
            self.stream.add_pulses(PulseTrain.of(self._pulses))
            self._pulses = []
        if self._stamps:
            self._heard = time.monotonic()
            stamps = np.array(self._stamps, dtype=np.int64)
            self.stream.add_forces(ForceTrace(stamps, np.array(self._forces)))
            self._stamps, self._forces = [], []
        for estimate in self.stream.advance():
            self._last = self._senders.noted(estimate)
            frame_id = self.settings.frame_id
            self._estimate.publish(messages.estimate_message(self._last, MESSAGE_TYPES, frame_id))

    def _report(self) -> None:
        if self._senders.look() and self._senders.best_effort is None:
            self._senders.best_effort = self.create_subscription(
                WrenchStamped, topics.FORCE, self._on_best_effort_force, qos.FORCE_BEST_EFFORT
            )
            logger_of(self).warning(
                f'{self.resolve_topic_name(topics.FORCE)} is published best effort: it is heard, '
                'and samples may be lost'
            )
        faults = {**self.stream.fault_counts, **self._senders.counts}
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
        name = self.get_fully_qualified_name()
        stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(
            diagnostics_message(name, stamp, self._last, faults, silence > _SILENCE)
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
