"""What a stimulator driver listens to so that it can stop: button, heartbeat, force, services.

`emergency_stop` (std_msgs/Bool) true latches a stop, false says that the cause is gone; the
service of the same name (std_srvs/Trigger) latches one as well.  `reset_emergency_stop` lets go.
`heartbeat` (std_msgs/Header) has to keep coming with a new stamp.
"""

import math
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import WrenchStamped
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_msgs.msg import Bool
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from rpms_ros import messages
from rpms_ros.errors import StimulationError
from rpms_ros.nodes import qos
from rpms_ros.nodes import topics
from rpms_ros.nodes.driver_parameters import DriverParameters
from rpms_ros.stimulation.controller import StimulationController
from rpms_ros.stimulation.heartbeat import Heartbeat
from rpms_ros.stimulation.safety_monitor import EMERGENCY_STOP
from rpms_ros.stimulation.safety_monitor import HEARTBEAT


class InterlockInputs:
    """Subscriptions and services that can stop a driver.

    Parameters
    ----------
    node : Node
        Whose executor serves them; they do not wait for its other callbacks where the executor
        has threads for that.
    controller : StimulationController
        What is stopped.
    settings : DriverParameters
        Which of them are used.
    refused : callable
        Told why something was refused.
    """

    def __init__(
        self,
        node: Node,
        controller: StimulationController,
        settings: DriverParameters,
        refused: Callable[[str], None],
    ) -> None:
        self._node = node
        self._controller = controller
        self._refused = refused
        self._heartbeat = Heartbeat(settings.heartbeat_timeout)
        self._group = ReentrantCallbackGroup()
        self._listen(Bool, topics.EMERGENCY_STOP, self._on_button)
        if settings.require_heartbeat:
            self._listen(Header, topics.HEARTBEAT, self._on_heartbeat)
        if settings.force_limit > 0:
            self._listen(WrenchStamped, topics.FORCE, self._on_force)
        for name, serve in (
            (topics.EMERGENCY_STOP, self._on_stop),
            (topics.RESET_EMERGENCY_STOP, self._on_reset),
        ):
            node.create_service(Trigger, name, serve, callback_group=self._group)

    def _listen(self, kind: type, topic: str, callback: Callable[[Any], None]) -> None:
        self._node.create_subscription(kind, topic, callback, qos.STOP, callback_group=self._group)

    def _on_button(self, message: Bool) -> None:
        self._controller.emergency(bool(message.data))

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        del request
        self._controller.stop(EMERGENCY_STOP, 'emergency stop by service')
        response.success = True
        response.message = 'stopped; reset_emergency_stop lets go'
        return response

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        del request
        try:
            self._controller.reset()
        except StimulationError as error:
            self._refused(str(error))
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = True, 'reset; the driver is disarmed'
        return response

    def _on_heartbeat(self, message: Header) -> None:
        now_ns = self._node.get_clock().now().nanoseconds
        refusal = self._heartbeat.refusal(messages.nanoseconds(message.stamp), now_ns)
        if refusal is None:
            self._controller.seen(HEARTBEAT)
        else:
            self._controller.count('heartbeat_refused')
            self._refused(refusal)

    def _on_force(self, message: WrenchStamped) -> None:
        force = message.wrench.force
        self._controller.force(math.hypot(force.x, force.y, force.z))
