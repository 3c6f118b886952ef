# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The services and the force subscription that can stop a driver.

Buttons and the operator's heartbeat are heard by `driver_watch`, without the executor.  The
service `emergency_stop` (std_srvs/Trigger) latches a stop; `reset_emergency_stop` resets it.

Arming in two steps, as services: `request_arming` gives a token, `confirm_arming` arms.

A life-cycle node that survives transitions which are not possible.

rclpy of Jazzy lets a `change_state` or a trigger that the state does not allow end the process.

Stamps and heartbeats of a driver are of now: simulated time is refused.
"""

import math
import time
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from rpms_msgs.action import RunSchedule
from rpms_msgs.srv import ConfirmArming, RequestArming
from rpms_ros import messages
from rpms_ros.errors import NodeError, StimulationError
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.logger import plain_text
from rpms_ros.nodes.driver.parameters import DriverParameters
from rpms_ros.nodes.driver.watch import DriverWatch
from rpms_ros.stimulation.driver.authority import AUTHORITY, Authority
from rpms_ros.stimulation.driver.controller import StimulationController
from rpms_ros.stimulation.driver.interlocks import Refused, SensorLife


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


class OperatorServices:
    """Serves the two steps for a node.

    Parameters
    ----------
    node : Node
        Whose executor serves them.
    authority : Authority
        Holds the operator.
    required : bool
        Whether an operator is asked for; if not, others may arm and start while there is none.
    arm : callable
        Arms the driver; raises StimulationError if that was refused.
    refused : callable
        Told why something was refused.
    """

    def __init__(
        self,
        node: Node,
        authority: Authority,
        required: bool,
        arm: Callable[[], None],
        refused: Callable[[str], None],
    ) -> None:
        self._authority = authority
        self._required = required
        self._arm = arm
        self._refused = refused
        node.create_service(RequestArming, topics.REQUEST_ARMING, self._on_request)
        node.create_service(ConfirmArming, topics.CONFIRM_ARMING, self._on_confirm)

    def require_arming(self) -> None:
        """Raise Refused where only an operator may arm, and none has confirmed."""
        if self._required and not self._authority.confirmed:
            raise Refused(
                AUTHORITY,
                'expected an operator to request and to confirm the arming, got neither',
            )

    def require_goal(self, goal: RunSchedule.Goal) -> None:
        """Raise Refused unless the sender of a goal may start a schedule."""
        if self._required or self._authority.confirmed:
            self._authority.require(goal.operator_id, goal.token)

    def _on_request(
        self, request: RequestArming.Request, response: RequestArming.Response
    ) -> RequestArming.Response:
        try:
            response.token = self._authority.request(request.operator_id, time.monotonic_ns())
        except StimulationError as error:
            response.message = plain_text(error)
            self._refused(response.message)
            return response
        response.success = True
        response.valid_for = float(self._authority.valid_s)
        response.message = 'hold the enable, send heartbeats with the token, then confirm'
        return response

    def _on_confirm(
        self, request: ConfirmArming.Request, response: ConfirmArming.Response
    ) -> ConfirmArming.Response:
        confirmed = False
        try:
            if self._authority.confirmed:
                raise Refused(AUTHORITY, 'expected one confirmation, got another one')
            self._authority.confirm(request.operator_id, request.token, time.monotonic_ns())
            confirmed = True
            self._arm()
        except StimulationError as error:
            if confirmed:
                self._authority.take_back()
            response.message = plain_text(error)
            self._refused(response.message)
            return response
        response.success, response.message = True, 'armed'
        return response


Names = dict[int, str]
_LABELS: Names = {
    Transition.TRANSITION_CREATE: 'create',
    Transition.TRANSITION_CONFIGURE: 'configure',
    Transition.TRANSITION_CLEANUP: 'cleanup',
    Transition.TRANSITION_ACTIVATE: 'activate',
    Transition.TRANSITION_DEACTIVATE: 'deactivate',
    Transition.TRANSITION_UNCONFIGURED_SHUTDOWN: 'shutdown',
    Transition.TRANSITION_INACTIVE_SHUTDOWN: 'shutdown',
    Transition.TRANSITION_ACTIVE_SHUTDOWN: 'shutdown',
    Transition.TRANSITION_DESTROY: 'destroy',
}


class GuardedLifecycleNode(LifecycleNode):
    """Refuses what the state does not allow; keyword arguments go to `rclpy.node.Node`."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state

    def possible_transitions(self) -> dict[int, str]:
        """Return number and label of each transition that the state allows."""
        return {
            int(number): str(label)
            for number, label, *_ in self._state_machine.available_transitions
        }

    def change(self, number: int) -> None:
        """Make a transition from within.

        Raises
        ------
        NodeError
            If the state does not allow it.
        """
        possible = self.possible_transitions()
        if number not in possible:
            raise NodeError(_refusal(possible, number))
        triggers = {
            Transition.TRANSITION_CONFIGURE: self.trigger_configure,
            Transition.TRANSITION_ACTIVATE: self.trigger_activate,
            Transition.TRANSITION_DEACTIVATE: self.trigger_deactivate,
        }
        triggers[number]()  # type: ignore[no-untyped-call]

    def destroy_node(self) -> None:
        """Destroy everything; what rclpy leaves out would keep the name on the graph."""
        self._state_machine.destroy_when_not_in_use()
        LifecycleNode.destroy_node(self)

    def transition_refused(self, reason: str) -> None:
        """Say that a transition was asked for that is not possible; override it."""

    def _on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        possible, asked = self.possible_transitions(), request.transition
        if asked.label in possible.values() if asked.label else asked.id in possible:
            return self._change_state(request, response)
        self.transition_refused(_refusal(possible, asked.id, asked.label))
        response.success = False
        return response


def _refusal(possible: Names, number: int, label: str = '') -> str:
    """Return why the state does not allow a transition."""
    asked = label or _LABELS.get(number, str(number))
    if not possible:
        return (
            f'expected a node that is not shut down, got {asked}: no transition is possible any '
            'more, start it again'
        )
    return f'expected a transition of {", ".join(sorted(possible.values()))}, got {asked}'


_NAME = 'use_sim_time'


def refuse_simulated_time(node: Node) -> None:
    """Accept no other clock than the machine's, now or later.

    Raises
    ------
    NodeError
        If the node was started with simulated time.
    """
    reason = f'expected {_NAME} false: a driver stamps what it does by the clock, got true'
    if node.get_parameter(_NAME).value:
        raise NodeError(reason)

    def check(parameters: list[Parameter]) -> SetParametersResult:
        asked = any(given.name == _NAME and given.value for given in parameters)
        return SetParametersResult(successful=not asked, reason=reason if asked else '')

    node.add_on_set_parameters_callback(check)
