# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Exceptions of the package: one class for each part, so that a caller can tell them apart.

Every message reads ``expected <condition>, got <value>`` and names the thing that was wrong.
"""

import math
from numbers import Integral

MISREAD = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)
"""What a parser of a library may raise at a text that is not what it expects."""
LARGEST_SEED = 2**53
"""Largest seed: JSON and YAML readers that use doubles hold it exactly."""


class RpmsError(Exception):
    """Base class of every error that this package raises on purpose."""


class MuscleError(RpmsError):
    """A muscle model was given a value that no muscle has."""


class StimulationError(RpmsError):
    """A pulse, a schedule or a limit is not acceptable."""


class AxisError(RpmsError):
    """An axis of a sensor is no direction."""


class IdentificationError(RpmsError):
    """An estimator was given settings or data that it cannot use."""


class RecordingError(RpmsError):
    """A recording cannot be read, written or imported."""


class MessageError(RpmsError):
    """A ROS message holds a value that its definition does not allow."""


class ReportError(RpmsError):
    """A figure or report cannot be made from what was given."""


class LiveError(RpmsError):
    """The live page cannot be served as it was asked for."""


class NodeError(RpmsError):
    """A node was configured with parameters that cannot work."""


def check_seed(seed: object, error: type[RpmsError]) -> None:
    """Raise `error` unless `seed` is one: what NumPy says names neither it nor the range."""
    if not isinstance(seed, Integral) or not 0 <= int(seed) <= LARGEST_SEED:
        raise error(f'expected a seed, a whole number from 0 to 2^53, got {seed!r}')


def check_number(
    error: type[RpmsError],
    name: str,
    value: float,
    least: float = -math.inf,
    most: float = math.inf,
    *,
    above: bool = False,
    unit: str = '',
) -> None:
    """Raise `error` unless a number is finite and lies within bounds.

    Parameters
    ----------
    error : type
        What is raised.
    name : str
        What it is, for the message.
    value : float
        The number.
    least, most : float
        Bounds, included.
    above : bool
        Whether `least` itself is refused.
    unit : str
        Of all three, for the message.
    """
    inside = least < value if above else least <= value
    if math.isfinite(value) and inside and value <= most:
        return
    low = f' {"above" if above else "from" if most < math.inf else "of at least"} {least:g}'
    high = f'{" up" if above else ""} to {most:g}' if most < math.inf else ''
    text = f'{name}{low if least > -math.inf else ""}{high} {unit}'.rstrip()
    raise error(f'expected a finite {text}, got {value}')
