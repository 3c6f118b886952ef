# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters as one dataclass, on a real node."""

from dataclasses import dataclass

import pytest
from rcl_interfaces.msg import ParameterType
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from rpms_ros.errors import NodeError
from rpms_ros.nodes.common.parameters import (
    NodeParameters,
    declare_parameters,
    descriptions,
    follow_parameters,
    parameter,
    type_of,
)
from rpms_ros.nodes.driver.parameters import DriverParameters
from rpms_ros.nodes.identifier import IdentifierParameters
from rpms_ros.nodes.live_page import LivePageParameters
from rpms_ros.nodes.operator_console import ConsoleParameters
from rpms_ros.nodes.plant_simulator import PlantParameters
from rpms_ros.nodes.recorder import RecorderParameters
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.nodes.stop_button import StopButtonParameters

NODES = (
    ConsoleParameters,
    DriverParameters,
    IdentifierParameters,
    LivePageParameters,
    PlantParameters,
    RecorderParameters,
    StopButtonParameters,
)


@dataclass(frozen=True)
class Example(NodeParameters):
    rate: float = parameter(20.0, 'Rate.', unit='Hz', minimum=1.0, maximum=50.0)
    count: int = parameter(3, 'Count.', minimum=0)
    gain: float = parameter(1.0, 'Gain.', dynamic=True, minimum=0.0)
    limit: float = parameter(2.0, 'Largest gain.', dynamic=True)
    mode: str = parameter('a', 'Mode.', choices=('a', 'b'))
    weights: tuple[float, ...] = parameter((0.5, 1.0), 'Weights.', minimum=0.0, maximum=1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gain > self.limit:
            raise NodeError(f'expected a gain up to limit {self.limit}, got {self.gain}')


def declare(context: Context, **values: object) -> tuple[Node, Example]:
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    node = Node(
        'example', context=context, parameter_overrides=overrides, use_global_arguments=False
    )
    return node, declare_parameters(node, Example)


def test_defaults_and_overrides_come_back(context: Context) -> None:
    assert declare(context)[1] == Example()
    _, settings = declare(context, rate=50.0, mode='b', weights=[0.25])
    assert settings == Example(rate=50.0, mode='b', weights=(0.25,))


@dataclass(frozen=True)
class Names(NodeParameters):
    names: tuple[str, ...] = parameter((), 'Names.')
    words: tuple[str, ...] = parameter(('a',), 'Words.')


def test_a_list_may_be_empty_where_it_is_so_by_default(context: Context) -> None:
    def declared(**values: list[str] | None) -> tuple[Parameter, Names]:
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        node = Node(
            'names', context=context, parameter_overrides=overrides, use_global_arguments=False
        )
        settings = declare_parameters(node, Names)
        return node.get_parameter('names'), settings

    # ROS gives no type to an empty list of a file, and that of bytes to one of Python
    for values in ({}, {'names': None}, {'names': []}):
        found, settings = declared(**values)
        assert (found.type_, found.value) == (Parameter.Type.STRING_ARRAY, [])
        assert settings == Names()
    assert declared(names=['b'])[1] == Names(names=('b',))
    with pytest.raises(NodeError, match='parameter words: expected string array, got byte array'):
        declared(words=[])


def test_a_descriptor_says_what_the_field_says(context: Context) -> None:
    node, _ = declare(context)
    rate = node.describe_parameter('rate')
    assert (rate.type, rate.read_only) == (ParameterType.PARAMETER_DOUBLE, True)
    assert rate.description == 'Rate.'
    assert rate.additional_constraints == '[Hz] 1.0 to 50.0'
    bounds = rate.floating_point_range[0]
    assert (bounds.from_value, bounds.to_value) == (1.0, 50.0)
    assert node.describe_parameter('count').integer_range[0].from_value == 0
    assert not node.describe_parameter('gain').read_only


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'rate': 20}, r'rate: expected double, got integer 20 \(write 20\.0\)'),
        ({'rate': 50.00001}, r'rate: expected \[Hz\] 1\.0 to 50\.0, got 50\.00001'),
        ({'rate': float('nan')}, r'rate: expected \[Hz\] 1\.0 to 50\.0, got nan'),
        ({'limit': float('inf')}, 'limit: expected finite, got inf'),
        ({'count': -1}, 'count: expected at least 0, got -1'),
        ({'count': 1.0}, r'count: expected integer, got double 1\.0'),
        ({'mode': 'c'}, "mode: expected one of a, b, got 'c'"),
        ({'weights': [0.5, 1.5]}, r'weights: expected 0\.0 to 1\.0, got 1\.5'),
        ({'gain': 3.0}, r'parameters of example: expected a gain up to limit 2\.0, got 3\.0'),
    ],
)
def test_a_bad_value_gives_one_clear_line(
    context: Context, values: dict[str, object], message: str
) -> None:
    with pytest.raises(NodeError, match=message):
        declare(context, **values)


def test_dynamic_changes_are_followed_or_refused_with_a_reason(context: Context) -> None:
    node, settings = declare(context)
    seen: list[Example] = []
    follow_parameters(node, settings, seen.append)
    assert node.set_parameters([Parameter('gain', value=1.5)])[0].successful
    assert seen == [Example(gain=1.5)]
    # 1.5 is still in force: the new limit must not undercut it.
    refused = node.set_parameters([Parameter('limit', value=1.0)])[0]
    assert refused.reason == 'expected a gain up to limit 1.0, got 1.5'
    assert not node.set_parameters([Parameter('rate', value=30.0)])[0].successful
    assert seen == [Example(gain=1.5)]
    both = [Parameter('gain', value=4.0), Parameter('limit', value=5.0)]
    assert node.set_parameters_atomically(both).successful
    assert seen[1:] == [Example(gain=4.0, limit=5.0)]


@pytest.mark.parametrize(
    ('given', 'meant'),
    [
        ('force_limt', 'force_limit'),
        ('maximum_intesity', 'maximum_intensity'),
        ('require_stopbutton', 'require_stop_button'),
        ('Temperature_limit', 'temperature_limit'),
    ],
)
def test_a_driver_refuses_a_misspelt_limit(context: Context, given: str, meant: str) -> None:
    line = f'expected a parameter of stimulator_driver as {meant}, got {given}'
    with pytest.raises(NodeError, match=line):
        StimulatorDriver(context=context, parameter_overrides=[Parameter(given, value=0.5)])


def test_no_parameter_of_another_node_is_taken_for_a_misspelt_one_of_the_driver(
    context: Context,
) -> None:
    # one file with /** may hold those of all nodes
    own = set(descriptions(DriverParameters))
    others = {name for one in NODES for name in descriptions(one)} - own
    overrides = [Parameter(name, value='of another') for name in sorted(others)]
    StimulatorDriver(context=context, parameter_overrides=overrides).destroy_node()


@pytest.mark.parametrize('settings', NODES)
def test_every_number_of_a_node_has_a_range_with_two_ends(settings: type[NodeParameters]) -> None:
    for name, description in descriptions(settings).items():
        assert description.doc.endswith('.'), name
        if type_of(settings, name) in (Parameter.Type.DOUBLE, Parameter.Type.INTEGER):
            assert description.minimum is not None, name
            assert description.maximum is not None, name
            assert description.minimum <= getattr(settings, name) <= description.maximum
