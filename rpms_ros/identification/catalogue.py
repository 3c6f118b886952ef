"""Estimators by name, for command lines and node parameters."""

from collections.abc import Callable
from dataclasses import replace

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.batch import BatchEstimator
from rpms_ros.identification.estimate import DEFAULT_RATE
from rpms_ros.identification.estimate import Estimator
from rpms_ros.identification.horizon import HorizonEstimator
from rpms_ros.identification.projection.settings import ProjectionSettings
from rpms_ros.identification.recursive import RecursiveEstimator
from rpms_ros.identification.settings import settings_by_name


def _recursive(preset: str, seed: int, rate_hz: float) -> Estimator:
    return RecursiveEstimator(settings_by_name(preset), seed, rate_hz)


# The simulated plant of the paper has no latency; people have one, about 9 ms, rarely below 8.
_LATENCY = {'table_4': 0.0, 'table_5': 8e-3}


def _projection(preset: str, rate_hz: float) -> tuple[ProjectionSettings, float]:
    start = settings_by_name(preset).start
    basis = replace(ProjectionSettings().basis, latency=_LATENCY[preset])
    return ProjectionSettings(basis=basis, start=start), rate_hz


ESTIMATORS: dict[str, Callable[[str, int, float], Estimator]] = {
    'recursive': _recursive,
    'batch': lambda preset, _seed, rate_hz: BatchEstimator(*_projection(preset, rate_hz)),
    'horizon': lambda preset, _seed, rate_hz: HorizonEstimator(*_projection(preset, rate_hz)),
}
"""What makes a fresh estimator of a preset, a seed and a rate [Hz], by name."""

ON_LINE = ('recursive', 'horizon')
"""Estimators for which an estimate costs the same however long the session."""


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
        Design parameters by name; the batch and the horizon take their start from it, and begin
        the response without a latency (``table_4``) or 8 ms after the pulse (``table_5``).
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
