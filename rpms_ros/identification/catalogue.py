# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimators by name: those of this package and those registered by other distributions.

An estimator of another distribution is a callable that takes `EstimatorOptions`, named by an
entry point of the group ``rpms_ros.estimators``.  Those of this package are in `ESTIMATORS`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from numbers import Real
from types import MappingProxyType

from rpms_ros.errors import IdentificationError, check_seed
from rpms_ros.identification.estimation.batch import BatchEstimator
from rpms_ros.identification.estimation.settings import ProjectionSettings
from rpms_ros.identification.estimation.tracking import TrackingEstimator, TrackingSettings
from rpms_ros.identification.model.estimate import (
    DEFAULT_RATE,
    HIGHEST_RATE,
    LOWEST_RATE,
    Estimator,
)
from rpms_ros.identification.model.history_law import TemporalSummation
from rpms_ros.identification.model.settings import PAPER_PRESETS, PEOPLE_PRESET, PRESET_NAMES
from rpms_ros.identification.recursion.paper import ModifiedRecursiveLM
from rpms_ros.identification.recursion.recursive import PEOPLE, FixedSizeRecursion

GROUP = 'rpms_ros.estimators'
_PARTS = ('add_pulses', 'estimate', 'forget_pulses', 'memory', 'name', 'on_line', 'update')


@dataclass(frozen=True)
class EstimatorOptions:
    """Options from which an estimator is built; each estimator uses those that it needs.

    Attributes
    ----------
    preset : str
        ``people``; ``arctan``, the same with the arctangents of the paper alone as recruitment;
        ``paper_table_4`` and ``paper_table_5``, which reproduce the paper: its recursion, or batch
        and tracking with its start values, its arctangents and a latency of 0 (Table 4) or
        8 ms (Table 5).  With the first two batch and tracking find the latency themselves.
    seed : int
        Seed of a random start.
    rate_hz : float
        Repetition rate for which the recruitment curve is stated, 0.1 to 1000 [Hz].
    history : TemporalSummation or None
        How earlier pulses change the force of later ones; for batch and tracking.

    Raises
    ------
    IdentificationError
        If the seed is none, or the rate is not possible.
    """

    preset: str = PEOPLE_PRESET
    seed: int = 0
    rate_hz: float = DEFAULT_RATE
    history: TemporalSummation | None = None

    def __post_init__(self) -> None:
        check_seed(self.seed, IdentificationError)
        rate = self.rate_hz
        if not isinstance(rate, Real) or not LOWEST_RATE <= rate <= HIGHEST_RATE:
            raise IdentificationError(
                f'expected a repetition rate from {LOWEST_RATE:g} to {HIGHEST_RATE:g} Hz, '
                f'got {rate!r}'
            )


EstimatorBuilder = Callable[[EstimatorOptions], Estimator]


def _recursive(options: EstimatorOptions) -> Estimator:
    if options.history is not None:
        raise IdentificationError(
            'expected an estimator with a history law, batch or tracking, got recursive'
        )
    if options.preset not in PAPER_PRESETS:
        settings = replace(PEOPLE, deviation=options.preset == PEOPLE_PRESET)
        return FixedSizeRecursion(settings, options.rate_hz)
    return ModifiedRecursiveLM(PAPER_PRESETS[options.preset], options.seed, options.rate_hz)


def _projection(options: EstimatorOptions) -> ProjectionSettings:
    people, any_shape = options.preset not in PAPER_PRESETS, options.preset == PEOPLE_PRESET
    start = PEOPLE.start if people else PAPER_PRESETS[options.preset].start
    # The simulated plant of the paper has no latency; people have one, about 9 ms, rarely below 8.
    latency = 0.0 if options.preset == 'paper_table_4' else 8e-3
    basis = replace(ProjectionSettings().basis, latency=latency)
    history = options.history
    return ProjectionSettings(basis, start, any_shape, history=history, choose_basis=people)


def _batch(options: EstimatorOptions) -> Estimator:
    return BatchEstimator(_projection(options), options.rate_hz)


def _tracking(options: EstimatorOptions) -> Estimator:
    settings = TrackingSettings(history=options.history)
    if options.preset != PEOPLE_PRESET:
        settings = TrackingSettings(**vars(_projection(options)))
    return TrackingEstimator(settings, options.rate_hz)


ESTIMATORS: Mapping[str, EstimatorBuilder] = MappingProxyType(
    {'recursive': _recursive, 'batch': _batch, 'tracking': _tracking}
)
"""Functions that build a fresh estimator of this package, by name."""


def estimator_names() -> tuple[str, ...]:
    """Return the names of all estimators that are installed, those of this package first."""
    return (*ESTIMATORS, *sorted(entry_points(group=GROUP).names - set(ESTIMATORS)))


# Estimators whose estimate takes longer the longer the session.
_OFF_LINE = ('batch',)


def on_line_names() -> tuple[str, ...]:
    """Return the names of the estimators that may run on line."""
    return tuple(name for name in estimator_names() if name not in _OFF_LINE)


def estimator_by_name(
    name: str,
    preset: str = PEOPLE_PRESET,
    seed: int = 0,
    rate_hz: float = DEFAULT_RATE,
    history: TemporalSummation | None = None,
) -> Estimator:
    """Return a fresh estimator of `estimator_names`; see `EstimatorOptions`.

    Raises
    ------
    IdentificationError
        If there is no such estimator or more than one of that name, if it cannot be loaded or
        lacks a member of `Estimator`, if there is no such preset, or
        if a value of the options is not possible.
    """
    if preset not in PRESET_NAMES:
        known = ', '.join(PRESET_NAMES)
        raise IdentificationError(f'expected a preset of {known}, got {preset!r}')
    options = EstimatorOptions(preset, seed, rate_hz, history)
    points = list(entry_points(group=GROUP, name=name))
    targets = [*(['this package'] if name in ESTIMATORS else []), *(p.value for p in points)]
    if not targets:
        raise IdentificationError(
            f'expected an estimator of {", ".join(estimator_names())}, got {name!r}'
        )
    if len(set(targets)) > 1:
        raise IdentificationError(
            f'expected one estimator of the name {name!r}, got {" and ".join(sorted(targets))}'
        )
    return ESTIMATORS[name](options) if name in ESTIMATORS else _loaded(points[0], options)


def _loaded(point: EntryPoint, options: EstimatorOptions) -> Estimator:
    """Return the estimator of an entry point."""
    try:
        builder: EstimatorBuilder = point.load()
        estimator = builder(options)
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        raise IdentificationError(
            f'expected the estimator {point.name!r} at {point.value}, '
            f'got {type(error).__name__}: {error}'
        ) from error
    if lacking := [part for part in _PARTS if not hasattr(estimator, part)]:
        raise IdentificationError(
            f'expected {", ".join(lacking)} in the estimator {point.name!r}, '
            f'got {type(estimator).__name__}'
        )
    return estimator
