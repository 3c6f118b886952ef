# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Permissions of each node, and the SROS2 policy made of them: one enclave for each node.

`tools/policies` writes the policies of a namespace; a test compares the table with the topics,
services and actions of the running nodes.
"""

from dataclasses import dataclass
from xml.etree import ElementTree as ET

from rpms_ros.nodes.common import topics

PARAMETERS = tuple(
    f'~/{name}'
    for name in (
        'describe_parameters',
        'get_parameter_types',
        'get_parameters',
        'get_type_description',
        'list_parameters',
        'set_parameters',
        'set_parameters_atomically',
    )
)
"""Services that rclpy gives every node."""

LIFE_CYCLE = tuple(
    f'~/{name}'
    for name in (
        'change_state',
        'get_available_states',
        'get_available_transitions',
        'get_state',
        'get_transition_graph',
    )
)
"""Services of a life-cycle node."""

COMMON_TOPICS = ('/parameter_events', '/rosout')
"""Topics on which every node publishes."""


@dataclass(frozen=True)
class Interfaces:
    """Topics, services and actions of one node, relative to its namespace; ``~`` is the node.

    Attributes
    ----------
    publish, subscribe : tuple of str
        Topics.
    serve, call : tuple of str
        Services that it answers and asks.
    execute, start : tuple of str
        Actions that it serves and of which it is a client.
    plain : bool
        Whether it has neither parameter services nor a log topic.
    """

    publish: tuple[str, ...] = ()
    subscribe: tuple[str, ...] = ()
    serve: tuple[str, ...] = ()
    call: tuple[str, ...] = ()
    execute: tuple[str, ...] = ()
    start: tuple[str, ...] = ()
    plain: bool = False

    @property
    def common_topics(self) -> tuple[str, ...]:
        """Topics on which rclpy publishes for the node."""
        return COMMON_TOPICS[:1] if self.plain else COMMON_TOPICS

    @property
    def common_services(self) -> tuple[str, ...]:
        """Services that rclpy serves for the node."""
        return ('~/get_type_description',) if self.plain else PARAMETERS


NODES: dict[str, Interfaces] = {
    'stimulator_driver': Interfaces(
        publish=(
            topics.PULSES,
            topics.PULSES_COMMANDED,
            topics.DRIVER_STATUS,
            topics.ACCEPTED_SCHEDULE,
            topics.DIAGNOSTICS,
            '~/transition_event',
        ),
        subscribe=(topics.FORCE,),
        serve=(
            topics.RESET_EMERGENCY_STOP,
            topics.REQUEST_ARMING,
            topics.CONFIRM_ARMING,
            *LIFE_CYCLE,
        ),
        execute=(topics.RUN_SCHEDULE,),
    ),
    'stimulator_driver_watch': Interfaces(
        subscribe=(topics.EMERGENCY_STOP, topics.HEARTBEAT),
        serve=(topics.EMERGENCY_STOP,),
        plain=True,
    ),
    'operator_console': Interfaces(
        publish=(topics.EMERGENCY_STOP, topics.HEARTBEAT, topics.DIAGNOSTICS),
        subscribe=(topics.DRIVER_STATUS, topics.JOY),
        call=(
            topics.REQUEST_ARMING,
            topics.CONFIRM_ARMING,
            topics.RESET_EMERGENCY_STOP,
            'stimulator_driver/change_state',
        ),
        start=(topics.RUN_SCHEDULE,),
    ),
    'stop_button': Interfaces(
        publish=(topics.EMERGENCY_STOP, topics.DIAGNOSTICS), subscribe=(topics.JOY,)
    ),
    'identifier': Interfaces(
        publish=(topics.ESTIMATE, topics.DISTURBANCE, topics.DIAGNOSTICS),
        serve=('~/hold', '~/load_state', '~/reset', '~/resume', '~/save_state'),
    ),
    'identifier_hearing': Interfaces(subscribe=(topics.PULSES, topics.FORCE), plain=True),
    'plant_simulator': Interfaces(
        publish=(topics.FORCE, topics.TRUTH, topics.DIAGNOSTICS, '/clock'),
        subscribe=(topics.PULSES,),
    ),
    # a page that was given no token has no stop to publish or to call
    'live_page': Interfaces(
        publish=(topics.EMERGENCY_STOP, topics.DIAGNOSTICS), call=(topics.EMERGENCY_STOP,)
    ),
    'live_page_watch': Interfaces(
        subscribe=(topics.PULSES, topics.FORCE, topics.ESTIMATE, topics.DRIVER_STATUS),
        plain=True,
    ),
    'recorder': Interfaces(publish=(topics.DIAGNOSTICS,)),
    'recorder_hearing': Interfaces(
        subscribe=(
            topics.PULSES,
            topics.PULSES_COMMANDED,
            topics.FORCE,
            topics.ESTIMATE,
            topics.DISTURBANCE,
            topics.TRUTH,
            topics.DRIVER_STATUS,
            topics.ACCEPTED_SCHEDULE,
        ),
        plain=True,
    ),
}
"""Interfaces of each node, by its name."""

ENCLAVES: dict[str, tuple[str, ...]] = {
    'stimulator_driver': ('stimulator_driver', 'stimulator_driver_watch'),
    'operator_console': ('operator_console',),
    'stop_button': ('stop_button',),
    'identifier': ('identifier', 'identifier_hearing'),
    'plant_simulator': ('plant_simulator',),
    'live_page': ('live_page', 'live_page_watch'),
    'recorder': ('recorder', 'recorder_hearing'),
}
"""Nodes of one process share an enclave."""


def policy_xml(enclave: str, namespace: str = '/', prefix: str = '/rpms') -> str:
    """Return the SROS2 policy of an enclave.

    Parameters
    ----------
    enclave : str
        One of `ENCLAVES`.
    namespace : str
        Of its nodes.
    prefix : str
        Path of the enclaves.
    """
    policy = ET.Element('policy', version='0.2.0')
    enclaves = ET.SubElement(policy, 'enclaves')
    holder = ET.SubElement(enclaves, 'enclave', path=f'{prefix}/{enclave}')
    profiles = ET.SubElement(holder, 'profiles')
    for node in ENCLAVES[enclave]:
        profile = ET.SubElement(profiles, 'profile', ns=namespace, node=node)
        allowed = NODES[node]
        publish = (*allowed.publish, *allowed.common_topics)
        serve = (*allowed.serve, *allowed.common_services)
        _allow(profile, 'topic', 'publish', publish)
        _allow(profile, 'topic', 'subscribe', allowed.subscribe)
        _allow(profile, 'service', 'reply', serve)
        _allow(profile, 'service', 'request', allowed.call)
        _allow(profile, 'action', 'execute', allowed.execute)
        _allow(profile, 'action', 'call', allowed.start)
    ET.indent(policy)
    return ET.tostring(policy, encoding='unicode', xml_declaration=True) + '\n'


def _allow(profile: ET.Element, kind: str, what: str, names: tuple[str, ...]) -> None:
    if not names:
        return
    group = ET.SubElement(profile, f'{kind}s')
    group.set(what, 'ALLOW')
    for name in sorted(names):
        ET.SubElement(group, kind).text = name
