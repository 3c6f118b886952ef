# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Arming in two steps, as services: `request_arming` gives a token, `confirm_arming` arms."""

import time
from collections.abc import Callable

from rclpy.node import Node

from rpms_msgs.action import RunSchedule
from rpms_msgs.srv import ConfirmArming
from rpms_msgs.srv import RequestArming
from rpms_ros.errors import StimulationError
from rpms_ros.nodes import topics
from rpms_ros.nodes.plain_text import plain_text
from rpms_ros.stimulation.authority import AUTHORITY
from rpms_ros.stimulation.authority import Authority
from rpms_ros.stimulation.interlocks import Refused


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
