# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Node that identifies the muscle: `force` and `pulses` in, `estimate` out.

Callbacks only collect; a timer hands what has come to the stream.  How it is cut into blocks has
no influence on the estimates, so a replay of a recording gives them bit for bit.  What its
services do is not in a recording.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock
from rclpy.clock import ClockType
from rclpy.node import Node
from std_srvs.srv import Trigger

from rpms_msgs.msg import MuscleEstimate
from rpms_ros import estimate_messages
from rpms_ros import messages
from rpms_ros.axis import UNITS
from rpms_ros.identification import Estimate
from rpms_ros.identification import IdentificationStream
from rpms_ros.identification.arrival_order import add_in_order
from rpms_ros.identification.checkpoint import load
from rpms_ros.identification.checkpoint import save
from rpms_ros.identification.warm_up import warm_up
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.construction import complete_or_gone
from rpms_ros.nodes.diagnostics import PERIOD_S
from rpms_ros.nodes.diagnostics import DiagnosticsPublisher
from rpms_ros.nodes.identifier_diagnostics import doubts_in_words
from rpms_ros.nodes.identifier_diagnostics import identifier_health
from rpms_ros.nodes.identifier_hearing import Hearing
from rpms_ros.nodes.identifier_parameters import IdentifierParameters
from rpms_ros.nodes.identifier_parameters import build_stream
from rpms_ros.nodes.identifier_parameters import stream_settings
from rpms_ros.nodes.identifier_publishers import Publishers
from rpms_ros.nodes.interfaces import MESSAGE_TYPES
from rpms_ros.nodes.logger import logger_of
from rpms_ros.nodes.overridable import warn_of_unused
from rpms_ros.nodes.parameters import declare_parameters
from rpms_ros.nodes.parameters import follow_parameters
from rpms_ros.nodes.runner import run
from rpms_ros.nodes.state_services import StateServices
from rpms_ros.pulses import nanoseconds

# Silence of the force after which somebody should look at the sensor [s].
_SILENCE = 5.0
# Between two looks at what has arrived; has no influence on the estimates [s].
_LOOK_PERIOD = 0.02


class Identifier(Node):
    """On-line identification; keyword arguments go to `rclpy.node.Node`."""

    settings_type = IdentifierParameters

    def __init__(self, **options: Any) -> None:
        super().__init__('identifier', **options)
        with complete_or_gone(self) as self._parts:
            self._build()

    def _build(self) -> None:
        """Make the parts of the node, each after those that it depends on."""
        self.settings = declare_parameters(self, IdentifierParameters)
        # nothing may be left to compile while force comes in
        warm_up(
            lambda: build_stream(self.settings).estimator,
            lambda: logger_of(self).info('compiling, once on a machine: one to three minutes'),
        )
        self.stream = build_stream(self.settings)
        self._axis = messages.axis_of(self.settings.axis)
        self._unit = UNITS[self.settings.quantity]
        self._reported: dict[str, int] = {}
        self._doubted = ''
        self._heard = time.monotonic()
        self._last: Estimate | None = None
        self._estimate = self.create_publisher(MuscleEstimate, topics.ESTIMATE, qos.ESTIMATE_KEPT)
        self._disturbance = self.create_publisher(
            WrenchStamped, topics.DISTURBANCE, qos.DISTURBANCE
        )
        self._diagnostics = DiagnosticsPublisher(
            self, 'identification', f'sensor of {self.resolve_topic_name(topics.FORCE)}'
        )
        self._hearing = Hearing(
            self,
            self._axis,
            self.settings.quantity,
            qos.FORCE_BEST_EFFORT if self.settings.best_effort_force else qos.FORCE,
            nanoseconds(self.settings.longest_gap),
        )
        self._parts.callback(self._hearing.close)
        warn_of_unused(self)
        self._senders = Publishers(self)
        for name, act in (('reset', self._reset), ('hold', self._hold), ('resume', self._resume)):
            self.create_service(Trigger, f'~/{name}', _answering(act))
        StateServices(self, self.settings.state_folder, self._save, self._load)
        follow_parameters(self, self.settings, self._change)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_LOOK_PERIOD, self._process, clock=steady)
        self.create_timer(PERIOD_S, self._report, clock=steady)
        self._say_what_is_done()

    def _say_what_is_done(self) -> None:
        force, pulses = (self.resolve_topic_name(name) for name in (topics.FORCE, topics.PULSES))
        settings = self.settings
        logger_of(self).info(
            f'identifying with {self.stream.estimator.name}: {settings.quantity} [{self._unit}] '
            f'on {force} along {settings.axis}; pulses on {pulses}'
        )

    def destroy_node(self) -> None:
        """Destroy the node, and the second one that receives for it."""
        self._parts.close()
        super().destroy_node()  # type: ignore[no-untyped-call]

    def _reset(self) -> str:
        """Forget everything and start again, as after a change of the electrode or the coil."""
        self._begin(build_stream(self.settings))
        return self._said('reset: the identification starts again')

    def _begin(self, stream: IdentificationStream) -> None:
        self.stream = stream
        self._hearing.begin_anew()
        self._reported = {}
        self._last = None

    def _save(self, path: Path) -> None:
        """Save what is known after all that has come."""
        # estimates that are due belong to what was before
        self._process()
        save(path, self.stream)

    def _load(self, path: Path) -> None:
        """Go on from a saved state; if it is refused, from the present one."""
        stream = build_stream(self.settings)
        load(path, stream)
        self._begin(stream)

    def _hold(self) -> str:
        """Predict and do not learn, while somebody moves the coil, say."""
        self._take()
        self.stream.hold()
        return self._said('held: predicts, does not learn')

    def _resume(self) -> str:
        self._take()
        self.stream.resume()
        return self._said('resumed: learns')

    def _said(self, line: str) -> str:
        logger_of(self).info(line)
        return line

    def _change(self, settings: IdentifierParameters) -> None:
        self.settings = settings
        self.stream.change(stream_settings(settings))
        logger_of(self).info(f'estimates every {settings.estimate_period:g} s from now on')

    def _take(self) -> None:
        """Pass what has come to the stream."""
        heard = self._hearing.heard(self._senders.best_effort_alone)
        if len(heard.forces):
            self._heard = time.monotonic()
        # In the order of arrival, as a recorder writes them and a replay reads them.
        add_in_order(self.stream, heard.pulses, heard.forces, heard.before, heard.foreign)

    def _process(self) -> None:
        self._take()
        for estimate in self.stream.advance():
            self._last = replace(self._senders.noted(estimate), unit=self._unit)
            frame_id = self.settings.frame_id
            self._estimate.publish(
                estimate_messages.estimate_message(self._last, MESSAGE_TYPES, frame_id)
            )
            if estimate.disturbance_deviation > 0.0:
                self._publish_disturbance(estimate)

    def _publish_disturbance(self, estimate: Estimate) -> None:
        """Publish the force that the stimulation does not cause."""
        self._disturbance.publish(
            messages.force_message(
                estimate.stamp_ns,
                estimate.disturbance,
                self._axis,
                MESSAGE_TYPES,
                self._hearing.sensor_frame,
                self.settings.quantity,
            )
        )

    def _say_doubts(self) -> None:
        """Log when the estimate begins or ceases to be one that is not to be trusted."""
        doubts = doubts_in_words(self._last)
        if doubts == self._doubted:
            return
        self._doubted = doubts
        if doubts:
            logger_of(self).warning(f'the estimate is not to be trusted: {doubts}')
        else:
            logger_of(self).info('nothing speaks against the estimate any more')

    def _report(self) -> None:
        unheard = self._senders.look() and not self._hearing.hears_best_effort
        if unheard:
            self._hearing.hear_best_effort()
            logger_of(self).warning(
                f'{self.resolve_topic_name(topics.FORCE)} is published best effort: it is heard, '
                'and samples may be lost'
            )
        faults = self.stream.fault_counts
        for name, count in faults.items():
            if count != self._reported.get(name):
                logger_of(self).warning(f'{name}: {count} so far')
        self._reported = faults
        self._say_doubts()
        silence = time.monotonic() - self._heard
        if silence > _SILENCE:
            topic = self.resolve_topic_name(topics.FORCE)
            publishers = self.count_publishers(topic)
            logger_of(self).warning(
                f'no force on {topic} for {silence:.0f} s ({publishers} publishers)',
                throttle_duration_sec=_SILENCE,
            )
        self._diagnostics.publish(
            identifier_health(self._last, faults, silence > _SILENCE, self.stream.held)
        )


def _answering(act: Callable[[], str]) -> Callable[[Trigger.Request, Any], Trigger.Response]:
    """Return the callback of a service that does something and answers what it did."""

    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = act()
        response.success = True
        return response

    return answer


def main() -> int:
    """Run the identifier as a process."""
    return run(Identifier)
