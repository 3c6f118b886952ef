# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Fields of a description: bounds and units beside each value, read from YAML and checked once.

A segment of a schedule, a limit or a device specification is a frozen dataclass whose fields carry
their bounds.  The same bounds refuse a value given in Python and one read from a file; a file's
fault is named by its place, as in ``segments[2].rate_hz``.
"""

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, TypeVar

from rpms_ros.errors import StimulationError
from rpms_ros.strict_yaml import join, shown

Part = TypeVar('Part')

LONGEST_NAME = 64
"""Of schedules, devices, patients and operators."""


class DescriptionError(StimulationError):
    """A description holds a fault; ``place`` says where.

    Attributes
    ----------
    place : str
        Path of the fault in the document, e.g. ``segments[2].rate_hz``; empty for the whole.
    """

    def __init__(self, place: str, fault: str) -> None:
        super().__init__(f'{place}: {fault}' if place else fault)
        self.place = place
        self.fault = fault


@dataclass(frozen=True)
class Bound:
    """What a value must be.

    Attributes
    ----------
    low, high : float
        Inclusive bounds, in ``unit``.
    unit : str
        Unit, empty for a count or a share.
    above : bool
        Whether ``low`` itself is refused.
    whole : bool
        Whether only whole numbers are accepted.
    several : bool
        Whether the value is a list of such numbers, not empty.
    optional : bool
        Whether the value may be missing (``None``).
    """

    low: float
    high: float
    unit: str = ''
    above: bool = False
    whole: bool = False
    several: bool = False
    optional: bool = False

    def __str__(self) -> str:
        kind = 'a whole number' if self.whole else 'a number'
        bracket = '(' if self.above else '['
        unit = f' {self.unit}' if self.unit else ''
        return f'{kind} in {bracket}{self.low:g}, {self.high:g}]{unit}'

    def read(self, value: object, place: str) -> Any:
        """Return ``value`` as the field holds it, or raise DescriptionError."""
        if value is None and self.optional:
            return None
        if not self.several:
            return self._number(value, place)
        if not isinstance(value, list | tuple) or not value:
            raise DescriptionError(place, f'expected a list, each {self}, got {shown(value)}')
        return tuple(self._number(item, f'{place}[{i}]') for i, item in enumerate(value))

    def _number(self, value: object, place: str) -> float | int:
        # a text is not a number
        number = math.nan
        if isinstance(value, int | float) and not isinstance(value, bool):
            with suppress(OverflowError):
                number = float(value)
        # written so that NaN is outside
        inside = self.low <= number <= self.high and not (self.above and number == self.low)
        if not inside or (self.whole and number != int(number)):
            raise DescriptionError(place, f'expected {self}, got {shown(value)}')
        return int(number) if self.whole else number


def bounded(bound: Bound, default: Any = MISSING, *, named: bool = False) -> Any:
    """Return a dataclass field that carries its bound, given only by its name if `named`."""
    return field(default=default, kw_only=named, metadata={'bound': bound})


def share(default: Any = MISSING) -> Any:
    """Return a field for a share of the maximum intensity, 0..1."""
    return bounded(Bound(0.0, 1.0), default)


@dataclass(frozen=True)
class Bounded:
    """Base of a dataclass: every bounded field is held against its bound when it is made.

    Raises
    ------
    DescriptionError
        If a value is not what its bound asks for.
    """

    def __post_init__(self) -> None:
        for entry in fields(self):
            if (bound := entry.metadata.get('bound')) is not None:
                value = bound.read(getattr(self, entry.name), entry.name)
                object.__setattr__(self, entry.name, value)


def as_mapping(given: object, place: str) -> Mapping[str, object]:
    """Return ``given`` if it is a mapping with text keys."""
    if not isinstance(given, Mapping) or not all(isinstance(key, str) for key in given):
        raise DescriptionError(place, f'expected a mapping of names to values, got {shown(given)}')
    return given


def refuse_unknown(content: Mapping[str, object], known: list[str], place: str) -> None:
    """Refuse unknown keys: a misspelt limit must not count as one that was left out."""
    for key in content:
        if key not in known:
            fault = f'expected one of {", ".join(sorted(known))}, got {shown(key)}'
            raise DescriptionError(join(place, key), fault)


def read_text(content: Mapping[str, object], key: str, place: str, longest: int) -> str:
    """Return a text of 1 to ``longest`` printable characters, on one line.

    Raises
    ------
    DescriptionError
        If it is missing, no text, empty, too long, or not printable.
    """
    value = content.get(key)
    text = ' '.join(value.split()) if isinstance(value, str) else ''
    if not text.isprintable() or not 0 < len(text) <= longest:
        got = 'nothing' if value is None else shown(value)
        fault = f'expected a text of 1 to {longest} printable characters, got {got}'
        raise DescriptionError(join(place, key), fault)
    return text


def build(
    kind: Callable[..., Part],
    given: object,
    place: str,
    *inner: object,
    also: tuple[str, ...] = (),
    **more: object,
) -> Part:
    """Return the dataclass whose bounded fields a mapping describes, with what is given besides.

    Parameters
    ----------
    kind : type
        The dataclass.
    given : mapping
        Its bounded fields by name, and what stands ``also`` there and is read by the caller.
    place : str
        Where it stands.
    *inner, **more : object
        Fields that have no bound.

    Raises
    ------
    DescriptionError
        Names the place of the field that is missing, unknown or out of bounds; of a fault of
        several together, the place of the whole.
    """
    content = as_mapping(given, place)
    entries = [entry for entry in fields(kind) if 'bound' in entry.metadata]  # type: ignore[arg-type]
    refuse_unknown(content, [*also, *more, *(entry.name for entry in entries)], place)
    for entry in entries:
        if entry.name not in content and entry.default is MISSING:
            bound = entry.metadata['bound']
            raise DescriptionError(join(place, entry.name), f'expected {bound}, got nothing')
    values = {entry.name: content[entry.name] for entry in entries if entry.name in content}
    try:
        return kind(*inner, **more, **values)
    except DescriptionError as fault:
        raise DescriptionError(join(place, fault.place), fault.fault) from fault
    except StimulationError as fault:
        raise DescriptionError(place, str(fault)) from fault


def bounded_names(kind: type) -> list[str]:
    """Return the names of the bounded fields of a dataclass."""
    return [entry.name for entry in fields(kind) if 'bound' in entry.metadata]
