# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stamps and heartbeats of a driver are of now: simulated time is refused."""

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from rpms_ros.errors import NodeError

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
