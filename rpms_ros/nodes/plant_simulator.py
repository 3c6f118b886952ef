# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Node that simulates the muscle and its force sensor: `pulses` in, `force` out.

Samples are stamped by the clock of the node, or by a simulated clock that it publishes on /clock.
At each tick of a steady timer every sample that is due is published with its own stamp, so a late
tick delays samples but does not lose them or change their stamps.
"""

import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock
from rclpy.clock import ClockType
from rclpy.node import Node
from rosgraph_msgs.msg import Clock as ClockMessage

from rpms_msgs.msg import MuscleTruth
from rpms_msgs.msg import Pulse as PulseMessage
from rpms_ros import estimate_messages
from rpms_ros import messages
from rpms_ros.axis import UNITS
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.clock_jump import JumpDetector
from rpms_ros.nodes.construction import complete_or_gone
from rpms_ros.nodes.diagnostics import PERIOD_S
from rpms_ros.nodes.diagnostics import DiagnosticsPublisher
from rpms_ros.nodes.diagnostics import Health
from rpms_ros.nodes.diagnostics import RecentChange
from rpms_ros.nodes.interfaces import MESSAGE_TYPES
from rpms_ros.nodes.logger import logger_of
from rpms_ros.nodes.parameters import declare_parameters
from rpms_ros.nodes.plant_parameters import PlantParameters
from rpms_ros.nodes.plant_parameters import build_plant
from rpms_ros.nodes.runner import run
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import Pulse
from rpms_ros.pulses import nanoseconds

_FASTEST_TICK = 1000.0
# Samples per tick, so that pulses are received while the node catches up.
_LARGEST_BURST = 500


class PlantSimulator(Node):
    """Simulated muscle; keyword arguments go to `rclpy.node.Node`."""

    settings_type = PlantParameters

    def __init__(self, **options: Any) -> None:
        super().__init__('plant_simulator', **options)
        with complete_or_gone(self):
            self._build()

    def _build(self) -> None:
        """Make the parts of the node, each after those that it depends on."""
        self.settings = declare_parameters(self, PlantParameters)
        _warm_up(self.settings)
        self.plant = build_plant(self.settings)
        self._begun = False
        self._recent = RecentChange()
        self._axis = messages.AXES[self.settings.axis]
        self._force = self.create_publisher(WrenchStamped, topics.FORCE, qos.FORCE)
        self._truth = self.create_publisher(MuscleTruth, topics.TRUTH, qos.TRUTH)
        self._next_truth_ns = 0
        self._diagnostics = DiagnosticsPublisher(
            self, 'simulation', f'simulated muscle {self.get_fully_qualified_name()}'
        )
        self._clock_publisher = (
            self.create_publisher(ClockMessage, '/clock', qos.CLOCK)
            if self.settings.publish_clock
            else None
        )
        self.create_subscription(PulseMessage, topics.PULSES, self._on_pulse, qos.PULSES)
        self._delay_ns = nanoseconds(self.settings.publication_delay)
        self._jump = JumpDetector()
        self._origin_ns = self.get_clock().now().nanoseconds
        self._steady_origin_ns = time.monotonic_ns()
        period = 1.0 / min(self.settings.rate, _FASTEST_TICK)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(period, self._tick, clock=steady)
        self.create_timer(PERIOD_S, self._report, clock=steady)
        settings = self.settings
        logger_of(self).info(
            f'simulating subject {settings.subject}: {settings.quantity} '
            f'[{UNITS[settings.quantity]}] along {settings.axis} at {settings.rate:g} Hz'
        )

    def _now_ns(self) -> int:
        if self._clock_publisher is None:
            return int(self.get_clock().now().nanoseconds)
        elapsed = time.monotonic_ns() - self._steady_origin_ns
        return self._origin_ns + round(elapsed * self.settings.real_time_factor)

    def _on_pulse(self, message: PulseMessage) -> None:
        pulse = messages.pulse_of(message)
        fault = self.plant.add(pulse)
        if fault is not None:
            count = self.plant.faults[fault]
            logger_of(self).warning(
                f'{fault}: {pulse} ({count} so far)', throttle_duration_sec=1.0
            )

    def _tick(self) -> None:
        now_ns = self._now_ns()
        if self._clock_publisher is not None:
            stamp = messages.time_message(now_ns, MESSAGE_TYPES)
            self._clock_publisher.publish(ClockMessage(clock=stamp))
        self._begin_if_needed(now_ns)
        if self._begun:
            self._publish_due(now_ns - self._delay_ns)

    def _begin_if_needed(self, now_ns: int) -> None:
        """Start sampling when there are subscribers, and again after a jump of the clock."""
        if not self._begun:
            if self._force.get_subscription_count() >= self.settings.minimum_subscribers:
                self.plant.begin(now_ns)
                self._begun = True
            return
        if self._clock_publisher is None and self._jump.at(now_ns):
            logger_of(self).warning('the clock has jumped: the plant starts anew')
            faults, self.plant = self.plant.faults, build_plant(self.settings)
            self._next_truth_ns = 0
            self.plant.faults = faults
            self.plant.begin(now_ns)

    def _publish_due(self, until_ns: int) -> None:
        trace = self.plant.sample(min(self.plant.due(until_ns), _LARGEST_BURST))
        frame_id = self.settings.frame_id
        for stamp_ns, force in zip(trace.stamp_ns.tolist(), trace.force.tolist(), strict=True):
            self._force.publish(
                messages.force_message(
                    stamp_ns, force, self._axis, MESSAGE_TYPES, frame_id, self.settings.quantity
                )
            )
        newest_ns = self.plant.newest_ns
        if self.settings.truth_rate > 0 and newest_ns >= self._next_truth_ns:
            self._next_truth_ns = newest_ns + round(
                NANOSECONDS_PER_SECOND / self.settings.truth_rate
            )
            self._truth.publish(
                estimate_messages.truth_message(self.plant.truth(), MESSAGE_TYPES, frame_id)
            )

    def _report(self) -> None:
        """Publish the health of the simulator: a warning for ten seconds after a faulty pulse."""
        faults = dict(self.plant.faults)
        recent = self._recent.seen(sum(faults.values()), time.monotonic_ns())
        figures = {
            'subject': self.settings.subject,
            'newest sample [ns]': self.plant.newest_ns if self._begun else 'none',
            **{f'fault {fault}': count for fault, count in faults.items()},
        }
        said = 'simulating' if self._begun else 'waits for subscribers of the force'
        level = DiagnosticStatus.WARN if recent else DiagnosticStatus.OK
        self._diagnostics.publish(
            Health(f'{said}; a pulse was wrong or late' if recent else said, level, figures)
        )


def _warm_up(settings: PlantParameters) -> None:
    """Compile the model before the first sample: without numba's cache it takes seconds."""
    plant = build_plant(settings)
    plant.begin(0)
    for onset_s in (0, 1, 10):
        plant.add(Pulse(onset_s * NANOSECONDS_PER_SECOND, 0.5))
    plant.sample(1)
    plant.begin(20 * NANOSECONDS_PER_SECOND)
    plant.sample(1)


def main() -> int:
    """Run the plant simulator as a process."""
    return run(PlantSimulator)
