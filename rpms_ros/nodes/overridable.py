"""Subscriptions whose quality of service a user may replace by parameters `qos_overrides`.

qos_overrides:
  /left_leg/force:
    subscription: {reliability: best_effort, depth: 100}
"""

from collections.abc import Callable
from copy import copy
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.qos import ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from rpms_ros.errors import NodeError
from rpms_ros.nodes.logger import logger_of

PREFIX = 'qos_overrides.'


def subscribe(
    node: Node,
    kind: Any,
    topic: str,
    callback: Callable[..., None],
    profile: QoSProfile,
    raw: bool = False,
) -> Subscription:
    """Create a subscription with this profile, unless the node's parameters say otherwise.

    With `raw` the callback is handed bytes.

    Raises
    ------
    NodeError
        If what they say is no quality of service.
    """
    options = QoSOverridingOptions.with_default_policies(callback=_judged)
    try:
        # rclpy writes what the parameters say into the profile that it is given
        own = copy(profile)
        return node.create_subscription(
            kind, topic, callback, own, qos_overriding_options=options, raw=raw
        )
    except (InvalidParameterTypeException, InvalidQosOverridesError, RuntimeError) as error:
        name = node.resolve_topic_name(topic)
        raise NodeError(
            f'expected {PREFIX}{name} with a quality of service, got {error}'
        ) from error


def is_best_effort(subscription: Subscription) -> bool:
    """Return whether a subscription asks for no more than best effort."""
    return bool(subscription.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT)


def overridden(node: Node, kind: Any, topic: str, profile: QoSProfile) -> QoSProfile:
    """Return the profile with which a node would subscribe to a topic, as its parameters say.

    Raises
    ------
    NodeError
        If what they say is no quality of service.
    """
    tried = subscribe(node, kind, topic, lambda _message: None, profile)
    chosen: QoSProfile = tried.qos_profile
    node.destroy_subscription(tried)
    return chosen


def warn_of_unused(node: Node) -> None:
    """Warn of overrides that fit no topic of the node, once all its subscriptions are made."""
    given: dict[str, Parameter] = getattr(node, '_parameter_overrides', {})
    for name in given:
        if name.startswith(PREFIX) and not node.has_parameter(name):
            logger_of(node).warning(f'parameter {name} fits no topic of this node and is ignored')


def _judged(profile: QoSProfile) -> SetParametersResult:
    fits = profile.depth >= 1
    reason = '' if fits else f'expected a depth of 1 or more, got {profile.depth}'
    return SetParametersResult(successful=fits, reason=reason)
