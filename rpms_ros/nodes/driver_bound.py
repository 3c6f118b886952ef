# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The parameter `maximum_intensity`: checked before it is set, in force once it is.

A change may be refused by any callback of the node, and for another parameter that is set
together with this one: only a parameter that has been set moves the bound.
"""

from collections.abc import Callable

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from rpms_ros.errors import StimulationError
from rpms_ros.nodes.driver_parameters import DriverParameters
from rpms_ros.nodes.parameters import follow_parameters
from rpms_ros.nodes.plain_text import plain_text
from rpms_ros.stimulation.controller import StimulationController

_NAME = 'maximum_intensity'


def follow_bound(
    node: Node,
    controller: StimulationController,
    settings: DriverParameters,
    followed: Callable[[DriverParameters], None],
    refused: Callable[[str], None],
) -> None:
    """Keep the bound of a controller at the parameter of a node.

    Parameters
    ----------
    node : Node
        Whose parameter it is.
    controller : StimulationController
        What is bounded.
    settings : DriverParameters
        Of the start.
    followed : callable
        Told of the parameters when another bound is in force.
    refused : callable
        Told why a change was refused.
    """

    def check(parameters: list[Parameter]) -> SetParametersResult:
        try:
            for given in parameters:
                if given.name == _NAME and isinstance(given.value, float):
                    controller.require_bound(given.value)
        except StimulationError as error:
            refused(str(error))
            return SetParametersResult(successful=False, reason=plain_text(error))
        return SetParametersResult(successful=True)

    def apply(changed: DriverParameters) -> None:
        try:
            controller.tighten(changed.maximum_intensity)
        except StimulationError as error:
            # armed since the check, by another thread: the lower bound stays in force
            refused(str(error))
            return
        followed(changed)

    follow_parameters(node, settings, apply)
    node.add_on_set_parameters_callback(check)
