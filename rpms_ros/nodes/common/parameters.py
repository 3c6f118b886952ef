# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a node as one frozen dataclass, declared in ROS from the dataclass alone.

A field made by `parameter` carries default, description, unit and bounds::

    @dataclass(frozen=True)
    class PlantParameters(NodeParameters):
        rate: float = parameter(1e3, 'Samples a second.', unit='Hz', bounds=(1.0, 2e4))

        def __post_init__(self) -> None:
            super().__post_init__()
            if ...:  # conditions on several fields
                raise NodeError(...)

``declare_parameters(node, PlantParameters)`` returns the dataclass with the values of YAML file,
command line or overrides.

rcl drops a file of parameters that is for other nodes without a word: here it is named.
"""

import dataclasses
import difflib
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import filterfalse
from typing import Any, NamedTuple, TypeVar

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from rpms_ros.axis import FORCE, UNITS
from rpms_ros.errors import NodeError, RpmsError
from rpms_ros.nodes.common.diagnostics import logger_of

# Share of letters in common: names of parameters of different nodes have less.
_ALIKE = 0.85
_METADATA = 'parameter'


class Description(NamedTuple):
    """Meaning, unit and bounds of a parameter.

    Attributes
    ----------
    doc : str
        One sentence.
    unit : str
        Unit, empty for a share, a count or a name.
    bounds : tuple of float or None
        Least and largest value, of every element if the field is a tuple.
    choices : tuple of str
        Every string that is allowed; empty allows any.
    dynamic : bool
        Whether it may be changed while the node runs.
    true_is : str
        What a text was where ROS gives true for it: it reads y, yes and on as such.
    """

    doc: str
    unit: str = ''
    bounds: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()
    dynamic: bool = False
    true_is: str = ''

    def conditions(self) -> str:
        """Return unit, bounds and choices in words."""
        parts = [f'[{self.unit}]'] if self.unit else []
        if self.bounds is not None:
            parts.append('{} to {}'.format(*self.bounds))
        if self.choices:
            parts.append('one of ' + ', '.join(self.choices))
        return ' '.join(parts)


def parameter(default: Any, doc: str, **more: Any) -> Any:
    """Return a dataclass field that is a ROS parameter; keywords are those of `Description`.

    A tuple may be empty if it is so by default.
    """
    return dataclasses.field(default=default, metadata={_METADATA: Description(doc, **more)})


def sensed(doc: str) -> Any:
    """Return the field of what a sensor measures, one of `UNITS`: a force if nobody says more."""
    return parameter(FORCE, doc, choices=tuple(UNITS))


@dataclass(frozen=True)
class NodeParameters:
    """Base of a node's parameters: the type and bounds of every value are checked."""

    def __post_init__(self) -> None:
        for name, description in descriptions(type(self)).items():
            value = getattr(self, name)
            # ROS cannot tell the type of an empty list
            if value != () or getattr(type(self), name) != ():
                _require(name, value, type_of(type(self), name), description)


Settings = TypeVar('Settings', bound=NodeParameters)


def descriptions(settings: type[NodeParameters]) -> dict[str, Description]:
    """Return the description of each parameter by name, in the order of the fields."""
    return {
        field.name: field.metadata[_METADATA]
        for field in dataclasses.fields(settings)
        if _METADATA in field.metadata
    }


def type_of(settings: type[NodeParameters], name: str) -> Parameter.Type:
    """Return the ROS type of a parameter: that of its default; a list without one is of texts."""
    default = getattr(settings, name)
    plain = (list(default) or ['']) if isinstance(default, tuple) else default
    found: Parameter.Type = Parameter.Type.from_parameter_value(plain)
    return found


def _require(name: str, value: Any, expected: Parameter.Type, description: Description) -> None:
    """Raise NodeError unless `value` has the type and keeps the bounds."""
    got = Parameter.Type.from_parameter_value(list(value) if isinstance(value, tuple) else value)
    if got is not expected:
        names = [kind.name.lower().replace('_', ' ') for kind in (expected, got)]
        # ROS has read it as another type than it was meant
        hint, types = '', Parameter.Type
        if (expected, got) == (types.DOUBLE, types.INTEGER):
            hint = f' (write {value}.0)'
        elif expected is types.STRING and got in (types.BOOL, types.INTEGER, types.DOUBLE):
            hint = ' (put it in quotes)'
        raise NodeError(f'parameter {name}: expected {names[0]}, got {names[1]} {value}{hint}')
    for item in value if isinstance(value, list | tuple) else (value,):
        if not _within(item, description):
            conditions = description.conditions() or 'finite'
            raise NodeError(f'parameter {name}: expected {conditions}, got {item!r}')


def _within(item: Any, description: Description) -> bool:
    if isinstance(item, str):
        return not description.choices or item in description.choices
    if isinstance(item, float) and not math.isfinite(item):
        return False
    return description.bounds is None or description.bounds[0] <= item <= description.bounds[1]


def _answered(node: Node, callback: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
    """Answer a request for parameters; a value of no type would end the process in rclpy."""
    try:
        return callback(request, response)
    except ValueError as error:
        logger_of(node).warning(f'refused: expected parameters with a type, got {error}')
        refused = SetParametersResult(successful=False, reason=str(error))
        if hasattr(response, 'results'):
            response.results = [refused] * len(request.parameters)
        else:
            response.result = refused
        return response


def declare_parameters(
    node: Node, settings: type[Settings], refuse_misspelt: bool = False
) -> Settings:
    """Declare every field of `settings` on `node` and return them with their values.

    Parameters
    ----------
    node : Node
        The node.
    settings : type
        Class of the parameters.
    refuse_misspelt : bool
        Refuse an unknown name that is much like one of the node's, of which others are warned.

    Raises
    ------
    NodeError
        If a value has the wrong type, is out of bounds, or contradicts another one; if a name is
        misspelt and that is to be refused.
    """
    for service in node.services:
        if 'set_parameters' in service.srv_name:
            service.callback = partial(_answered, node, service.callback)
    # The errors of rclpy name neither the bounds nor the right way to write the value, and it
    # ignores misspelled names; it has no public access to the given values.
    given: dict[str, Parameter] = getattr(node, '_parameter_overrides', {})
    values: dict[str, Any] = {}
    for name, description in descriptions(settings).items():
        kind, default = type_of(settings, name), getattr(settings, name)
        # bounds are checked here, with a reason: rclpy would name none
        descriptor = ParameterDescriptor(
            name=name,
            type=kind.value,
            description=description.doc,
            additional_constraints=description.conditions(),
            read_only=not description.dynamic,
        )
        told = given[name].value if name in given else None
        if default == () and told in (None, [], b''):
            # ROS takes an empty list for bytes, and that of a file for nothing
            node.declare_parameter(name, kind, ignore_override=True)
            node.set_parameters([Parameter(name, kind, [])])
            node.set_descriptor(name, descriptor)
            values[name] = ()
            continue
        if name in given:
            if told is True and description.true_is:
                given[name] = Parameter(name, value=description.true_is)
            _require(name, given[name].value, kind, description)
        # of an empty list the type alone
        plain = (list(default) or kind) if isinstance(default, tuple) else default
        declared = node.declare_parameter(name, plain, descriptor).value
        values[name] = tuple(declared) if isinstance(default, tuple) else declared
    _warn_of_unknown(node, list(values) if refuse_misspelt else [])
    try:
        return settings(**values)
    except RpmsError as error:
        raise NodeError(f'parameters of {node.get_name()}: {error}') from error


def _unknown(node: Node) -> list[str]:
    """Return the names of parameters that are given and none of the node's."""
    return list(filterfalse(node.has_parameter, getattr(node, '_parameter_overrides', {})))


def refuse_unknown(node: Node) -> None:
    """Raise `NodeError` for parameters that are given and none of the node's."""
    if unknown := _unknown(node):
        raise NodeError(f'expected parameters of {node.get_name()}, got {", ".join(unknown)}')


def _warn_of_unknown(node: Node, known: list[str]) -> None:
    """Warn of unknown names; raise `NodeError` for one that is much like a `known` one."""
    # A file may hold parameters of several nodes, so this alone is not an error.
    for name in _unknown(node):
        written = name.rpartition('.')[-1].casefold()
        for meant in difflib.get_close_matches(written, known, 1, _ALIKE):
            raise NodeError(f'expected a parameter of {node.get_name()} as {meant}, got {name}')
        logger_of(node).warning(f'parameter {name} is unknown here and ignored')
