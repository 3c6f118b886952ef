"""Which number of a force message is the force of the muscle."""

from collections.abc import Sequence

import numpy as np

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import FloatArray

AXES = {'x': (1.0, 0.0, 0.0), 'y': (0.0, 1.0, 0.0), 'z': (0.0, 0.0, 1.0)}


def direction_of(axis: str | Sequence[float]) -> FloatArray:
    """Return the unit vector (3,) of an axis.

    Parameters
    ----------
    axis : str or sequence of float
        ``x``, ``y``, ``z``, or a direction of any length: ``'0.6,0,0.8'`` or three numbers.

    Raises
    ------
    RecordingError
        If it is not a direction.
    """
    if isinstance(axis, str) and axis in AXES:
        return np.array(AXES[axis])
    try:
        parts = axis.split(',') if isinstance(axis, str) else axis
        vector = np.array([float(part) for part in parts])
    except ValueError:
        vector = np.empty(0)
    length = float(np.linalg.norm(vector)) if len(vector) == 3 else 0.0
    if not (length > 0 and np.isfinite(length)):
        raise RecordingError(f'expected axis x, y, z or three numbers as 0.6,0,0.8, got {axis!r}')
    return vector / length


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
