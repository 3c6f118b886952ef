"""Estimators by name, for command lines and node parameters."""

from collections.abc import Callable

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.estimate import DEFAULT_RATE
from rpms_ros.identification.estimate import Estimator
from rpms_ros.identification.recursive import RecursiveEstimator
from rpms_ros.identification.settings import settings_by_name


def _recursive(preset: str, seed: int, rate_hz: float) -> Estimator:
    return RecursiveEstimator(settings_by_name(preset), seed, rate_hz)


ESTIMATORS: dict[str, Callable[[str, int, float], Estimator]] = {'recursive': _recursive}
"""What makes a fresh estimator of a preset, a seed and a rate [Hz], by name."""


def estimator_by_name(
    name: str,
    preset: str = 'table_4',
    seed: int = 0,
    rate_hz: float = DEFAULT_RATE,
) -> Estimator:
    """Return a fresh estimator of `ESTIMATORS`.

    Parameters
    ----------
    name : str
        Name of the algorithm.
    preset : str
        Design parameters by name; of them, others than the recursive algorithm use the start.
    seed : int
        Seed of the recursive algorithm's random start.
    rate_hz : float
        Repetition rate for which the recruitment curve is stated [Hz].

    Raises
    ------
    IdentificationError
        If there is no such estimator or preset, or the rate is not above zero.
    """
    if name not in ESTIMATORS:
        raise IdentificationError(
            f'expected an estimator of {", ".join(ESTIMATORS)}, got {name!r}'
        )
    return ESTIMATORS[name](preset, seed, rate_hz)
