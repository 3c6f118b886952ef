# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The services and the force subscription that can stop a driver.

Buttons and the operator's heartbeat are heard by `driver_watch`, without the executor.  The
service `emergency_stop` (std_srvs/Trigger) latches a stop; `reset_emergency_stop` resets it.
"""

import math
import time
from collections.abc import Callable

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from std_srvs.srv import Trigger

from rpms_ros import messages
from rpms_ros.errors import StimulationError
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.driver_parameters import DriverParameters
from rpms_ros.nodes.driver_watch import DriverWatch
from rpms_ros.nodes.plain_text import plain_text
from rpms_ros.stimulation.controller import StimulationController
from rpms_ros.stimulation.sensor_life import SensorLife


class InterlockInputs:
    """Subscriptions and services that can stop a driver.

    Parameters
    ----------
    node : Node
        Whose executor serves them.
    controller : StimulationController
        What is stopped.
    watch : DriverWatch
        Knows the buttons.
    settings : DriverParameters
        Which of them are used.
    refused : callable
        Told why something was refused.
    reset : callable
        Told that a stop was reset.
    """

    def __init__(
        self,
        node: Node,
        controller: StimulationController,
        watch: DriverWatch,
        settings: DriverParameters,
        refused: Callable[[str], None],
        reset: Callable[[], None],
    ) -> None:
        self._controller = controller
        self._watch = watch
        self._refused = refused
        self._was_reset = reset
        self._limit = settings.force_limit
        self._quantity = settings.quantity
        self._sensor = SensorLife(settings.force_frame, settings.force_timeout)
        if settings.force_limit > 0:
            node.create_subscription(
                WrenchStamped, topics.FORCE, self._on_force, qos.FORCE_BEST_EFFORT
            )
        node.create_service(Trigger, topics.RESET_EMERGENCY_STOP, self._on_reset)

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        del request
        try:
            self._watch.forget_gone()
            self._controller.reset()
        except StimulationError as error:
            reason = plain_text(error)
            self._refused(reason)
            response.success, response.message = False, reason
            return response
        self._was_reset()
        response.success, response.message = True, 'reset; the driver is disarmed'
        return response

    def _on_force(self, message: WrenchStamped) -> None:
        """Hold every sample against the limit; not every one is a sign of life."""
        force = getattr(message.wrench, self._quantity)
        size = math.hypot(force.x, force.y, force.z)
        stamp_ns = messages.nanoseconds(message.header.stamp)
        refusal = self._sensor.refusal(stamp_ns, message.header.frame_id, time.time_ns())
        if refusal is None:
            self._controller.force(size)
            return
        self._controller.count('force_refused')
        self._refused(plain_text(refusal))
        if not size <= self._limit:
            self._controller.force(size)
