# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which number of a force message is the force of the muscle."""

from collections.abc import Sequence

import numpy as np

from rpms_ros.axis import unit_vector
from rpms_ros.errors import RecordingError
from rpms_ros.pulses import FloatArray


def direction_of(axis: str | Sequence[float]) -> FloatArray:
    """Return the unit vector (3,) of an axis, as `rpms_ros.axis.unit_vector` reads it.

    Raises
    ------
    RecordingError
        If it is not a direction.
    """
    try:
        return np.array(unit_vector(axis))
    except ValueError as error:
        raise RecordingError(str(error)) from error


def force_along(
    direction: FloatArray, components: Sequence[FloatArray], sign: float
) -> FloatArray:
    """Return the force (samples,) [N] along a direction.

    Components across it do not count, not even when they are not finite.

    Parameters
    ----------
    direction : ndarray, shape (3,)
        Unit vector.
    components : three ndarrays, shape (samples,)
        Force along x, y and z [N].
    sign : float
        1 or -1: the muscle's pull is positive.
    """
    total: FloatArray | None = None
    for share, component in zip(direction.tolist(), components, strict=True):
        if share:
            part = (sign * share) * component
            total = part if total is None else total + part
    assert total is not None, 'a direction has a component'
    return total
