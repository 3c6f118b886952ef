# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Prior of a window: physiology, bounds, and the result of earlier samples or sessions.

For a returning patient the covariance P of parameters and response in the result of the last
session is increased by the changes from one day to the next, most of all by the new position of
the coil,

.. math:: P' = P + Q_\theta + g^2 w w^T + t^2 (D w) (D w)^T + h^2 \|w\|^2 I / n ,

with D the derivative by the logarithm of the time constant (`window_equations`),
and becomes the prior of `tracking`, which is dropped where a fit without it contradicts it.
"""

import json
import math
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

import numba
import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtri

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.estimation.settings import PRIOR, ProjectionSettings
from rpms_ros.identification.estimation.window_equations import Point, time_scale_derivative
from rpms_ros.identification.model.basis import LaguerreBasis, conversion
from rpms_ros.identification.model.estimate import Estimator
from rpms_ros.identification.model.recruitment import (
    PARAMETERS,
    SUMMATION,
    WINDOW_SINES,
    coordinates,
)
from rpms_ros.pulses import FloatArray
from rpms_ros.schema import documented

if TYPE_CHECKING:
    from rpms_ros.identification.estimation.window_fit import WindowFit

# Confidence level at which an earlier result is rejected.
_CONTRADICTED = 0.999
# Error of the response by a conversion of the basis or a rest, as a share of it.
_LOST = 0.01
# Standard deviations of the change of the slope over a unit of time, and of increments besides,
# relative to the slope.
_SLOPE_WALK, _SLOPE_NOISE = 0.15, 0.02
# The same for the thresholds: a coil moves less evenly than a muscle tires, and it moves both, so
# that their changes are correlated.
_COIL_WALK, _TOGETHER = 0.5, 0.95
_COUPLING: FloatArray = np.eye(4)
_COUPLING[2:, 2:] = np.linalg.inv([[1.0, _TOGETHER], [_TOGETHER, 1.0]])
# A muscle recovers in a pause as fast as it tires otherwise, until this many units of time have
# passed; from pause to pause that differs by this share.
_RECOVERY, _RECOVERY_NOISE = 3.0, 0.4
# Added to the diagonal of a matrix whose rows are scaled to 1.
ROUNDING = 1e-9


class Terms(NamedTuple):
    """What is known at a point: cost, gradient and information, for `add_prior`.

    Attributes
    ----------
    matrix, gradient : ndarray (unknowns, unknowns), (unknowns,)
        Information about [theta, w] but for the deviation, and minus half the gradient of the
        cost.
    cost : float
        Cost.
    deviation : ndarray (sines,)
        c.
    walks : ndarray (2, knots, knots)
        Information about a slow change of scale 1: of the muscle, and of the thresholds.
    changes : ndarray (4, knots)
        Gain, slowing, u_thr and u_sat at the knots of the past.
    """

    matrix: FloatArray
    gradient: FloatArray
    cost: float
    deviation: FloatArray
    walks: FloatArray
    changes: FloatArray


@numba.njit(cache=True)
def add_prior(
    terms: Terms, scales: FloatArray, variance: FloatArray, matrix: FloatArray, right: FloatArray
) -> tuple[float, float]:
    """Add what is known to the equations of x; return its cost and its log-determinant.

    Parameters
    ----------
    terms : Terms
        At the point of the equations.
    scales : ndarray (4,)
        Change of force and of time constant (relative), of u_thr and of u_sat from knot to knot.
    variance : ndarray
        Of the deviation c, at least as many as there are.
    matrix, right : ndarray (unknowns, unknowns), (unknowns,)
        Information and minus half the gradient, in place.
    """
    joint, knots = len(terms.gradient), terms.changes.shape[1]
    cost = terms.cost
    known = terms.matrix.copy()
    for index in range(len(terms.deviation)):
        place = PARAMETERS + index
        known[place, place] += 1.0 / variance[index]
        right[place] -= terms.deviation[index] / variance[index]
        cost += terms.deviation[index] ** 2 / variance[index]
    matrix[:joint, :joint] += known
    right[:joint] += terms.gradient
    logarithm = log_determinant(known)
    for which in range(len(scales)):
        logarithm -= 2.0 * knots * np.log(scales[which])
        for other in range(len(scales)):
            share = _COUPLING[which, other] / (scales[which] * scales[other])
            if share == 0.0:
                continue
            first, second = joint + which * knots, joint + other * knots
            for row in range(knots):
                pull = 0.0
                for column in range(knots):
                    value = share * terms.walks[which // 2, row, column]
                    matrix[first + row, second + column] += value
                    pull += value * terms.changes[other, column]
                right[first + row] -= pull
                cost += pull * terms.changes[which, row]
    return cost, logarithm


@numba.njit(cache=True)
def log_determinant(matrix: FloatArray) -> float:
    """Return the logarithm of the determinant of a positive matrix, rows scaled to 1."""
    scale = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(scale, scale)
    for place in range(len(scaled)):
        scaled[place, place] += ROUNDING
    factor = np.linalg.cholesky(scaled)
    value: float = 2.0 * np.sum(np.log(np.diag(factor)) + np.log(scale))
    return value


@dataclass(frozen=True)
class WindowPrior:
    """Priors of x.

    Attributes
    ----------
    mean, deviation : ndarray (nonlinear,)
        Physiological prior of theta, alpha as logarithms; infinite deviations for c, whose prior
        has a size of its own.
    lower, upper : ndarray (4,)
        Their bounds, alpha as logarithms.
    separation : float
        u_sat is at least this far above u_thr.
    any_shape : bool
        Whether the recruitment may deviate from the arctangents.
    information, reference : ndarray (unknowns, unknowns), (unknowns,)
        Result of samples before the window: inverse covariance and mean of [theta, w]; empty if
        there is none.
    """

    mean: FloatArray
    deviation: FloatArray
    lower: FloatArray
    upper: FloatArray
    separation: float
    any_shape: bool
    information: FloatArray
    reference: FloatArray

    @property
    def has_result(self) -> bool:
        """Whether there is a result of samples before the window."""
        return bool(len(self.reference))

    def terms_at(self, point: Point, ridge: float, walks: FloatArray) -> 'Terms':
        """Return what is known at a point, whatever the scales.

        Parameters
        ----------
        point : Point
            Where.
        ridge : float
            Information about each coefficient of w, around nothing.
        walks : ndarray (2, knots, knots)
            See `walk_information`.
        """
        theta = coordinates(point.theta)
        linear = point.linear
        here = np.concatenate((theta, linear))
        matrix, before = np.zeros((len(here), len(here))), np.zeros(len(here))
        if self.has_result:
            matrix, before = self.information.copy(), here - self.reference
        pull = matrix @ before
        gradient = -pull
        cost = float(before @ pull)
        away = theta - self.mean
        nonlinear = len(theta)
        place = np.arange(nonlinear)
        matrix[place, place] += 1.0 / self.deviation**2
        gradient[:nonlinear] -= away / self.deviation**2
        cost += float(np.sum((away / self.deviation) ** 2))
        place = np.arange(nonlinear, len(here))
        matrix[place, place] += ridge
        gradient[nonlinear:] -= ridge * linear
        cost += ridge * float(linear @ linear)
        deviation = theta[PARAMETERS : SUMMATION.start]
        return Terms(matrix, gradient, cost, deviation, walks, point.changes)

    def bounded(self, point: Point, step: FloatArray, hessian: FloatArray) -> FloatArray:
        """Return the step (unknowns,) with theta within its bounds, the rest solved again."""
        theta = coordinates(point.theta)[:PARAMETERS]
        low, high = self.lower - theta, self.upper - theta
        apart = self.separation - (theta[1] - theta[0])
        held = np.zeros(len(step), dtype=bool)
        right = hessian @ step
        for _ in range(PARAMETERS):
            inside = np.clip(step[:PARAMETERS], low, high)
            lacking = apart - (inside[1] - inside[0])
            if lacking > 1e-12:
                middle = np.clip(0.5 * (inside[0] + inside[1]), low[0], high[1] - apart)
                inside[:2] = middle - 0.5 * apart, middle + 0.5 * apart
            leaves = (np.abs(inside - step[:PARAMETERS]) > 1e-12) & ~held[:PARAMETERS]
            if not leaves.any():
                break
            held[:PARAMETERS] |= leaves
            step = step.copy()
            step[:PARAMETERS][leaves] = inside[leaves]
            free = ~held
            rest = right[free] - hessian[np.ix_(free, held)] @ step[held]
            step[free] = scaled_inverse(hessian[np.ix_(free, free)]) @ rest
        step[:PARAMETERS] = np.clip(step[:PARAMETERS], low, high)
        return step

    def separate(self, theta: FloatArray) -> None:
        """Keep u_sat of theta above u_thr, in place."""
        lacking = self.separation - (theta[1] - theta[0])
        if lacking > 0.0:
            theta[0] = max(theta[0] - 0.5 * lacking, self.lower[0])
            theta[1] = theta[0] + self.separation

    def contradicted(self, fit: 'WindowFit', alone: 'WindowFit') -> bool:
        """Return whether samples are much likelier without `reference`.

        Parameters
        ----------
        fit, alone : WindowFit
            With this prior, and with the physiological one alone.  Few samples have many
            explanations far from each other, so the likelihoods are compared, not the muscles.
        """
        gain = 2.0 * (alone.likelihood - fit.likelihood)
        return gain > float(chdtri(len(self.reference), 1.0 - _CONTRADICTED))

    def in_basis(self, matrix: FloatArray, size: float) -> 'WindowPrior':
        """Return the prior in other coordinates of w, `matrix` (others, functions) times these.

        `size` is the norm of w; a share of it is added as the error of the conversion.
        """
        if not self.has_result:
            return self
        nonlinear = len(self.mean)
        both = block_diag(np.eye(nonlinear), matrix)
        covariance = both @ scaled_inverse(self.information) @ both.T
        place = np.arange(nonlinear, len(both))
        covariance[place, place] += (_LOST * size) ** 2
        return replace(
            self, information=scaled_inverse(covariance), reference=both @ self.reference
        )


def physiological_prior(settings: ProjectionSettings, sines: int) -> WindowPrior:
    """Return the prior before any sample, with so many elements of c."""
    kappa, spread = settings.summation
    return WindowPrior(
        mean=np.concatenate((PRIOR.mean, np.zeros(sines), np.full(2, kappa))),
        deviation=np.concatenate((PRIOR.deviation, np.full(sines, np.inf), np.full(2, spread))),
        lower=coordinates(PRIOR.lower),
        upper=coordinates(PRIOR.upper),
        separation=PRIOR.separation,
        any_shape=settings.deviation,
        information=np.zeros((0, 0)),
        reference=np.zeros(0),
    )


def posterior_as_prior(knowledge: WindowPrior, fit: 'WindowFit') -> WindowPrior:
    """Return the result of a fit as prior for later samples, slightly widened."""
    point = fit.point
    joint = len(point.theta) + len(point.linear)
    covariance = fit.covariance[:joint, :joint].copy()
    place = np.arange(len(point.theta), joint)
    covariance[place, place] += (_LOST * float(np.linalg.norm(point.linear))) ** 2
    reference = np.concatenate((coordinates(point.theta), point.linear))
    return replace(knowledge, information=scaled_inverse(covariance), reference=reference)


@lru_cache(maxsize=64)
def walk_information(lengths: tuple[float, ...], pauses: tuple[bool, ...]) -> FloatArray:
    """Return inverse covariances of slow changes at knots (2, knots, knots), which are 0 now.

    The slope is a random walk that begins with a standard deviation of 1: the first that of a
    muscle, which rests in the pauses of the stimulation: there it recovers, by much the same in
    all of them; the second that of the thresholds.

    Parameters
    ----------
    lengths : tuple of float (knots,)
        From each knot to the next newer one, in units of time.
    pauses : tuple of bool (knots,)
        Which of these are pauses.
    """
    length, pause = np.array(lengths), np.array(pauses, dtype=bool)
    knots = len(length)
    tired = np.where(pause, 0.0, length)
    place = np.cumsum(tired) - tired
    slope = 1.0 + _SLOPE_WALK**2 * np.minimum.outer(place, place) + _SLOPE_NOISE**2 * np.eye(knots)
    recovered = np.where(pause, _RECOVERY * (1.0 - np.exp(-length / _RECOVERY)), 0.0)
    alike = 1.0 + _RECOVERY_NOISE**2 * np.eye(knots)
    increments = np.outer(tired, tired) * slope + np.outer(recovered, recovered) * alike
    difference = np.eye(knots) - np.eye(knots, k=-1)
    place = np.cumsum(length) - length
    moving = np.outer(length, length) * (1.0 + _COIL_WALK**2 * np.minimum.outer(place, place))
    moving += _SLOPE_NOISE**2 * np.diag(length**2)
    return np.stack(
        [difference.T @ np.linalg.solve(one, difference) for one in (increments, moving)]
    )


@numba.njit(cache=True)
def scaled_inverse(matrix: FloatArray) -> FloatArray:
    """Return the inverse (n, n) of a symmetric matrix whose rows differ much in size."""
    if not np.isfinite(matrix).all():
        return np.full_like(matrix, np.nan)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    both = np.outer(scale, scale)
    inverse: FloatArray = np.linalg.inv(matrix * both + ROUNDING * np.eye(len(matrix))) * both
    return 0.5 * (inverse + inverse.T)


_LARGEST_RESULT = 64_000_000
# Elements of theta that are kept for another session.
_KEPT = PARAMETERS + WINDOW_SINES + 2


@dataclass(frozen=True)
class DayToDay:
    """Standard deviations of the changes of a muscle from one session to the next.

    Attributes
    ----------
    threshold : float
        Of u_thr and u_sat.
    slope : float
        Of the logarithms of alpha_sat and alpha_thr.
    gain : float
        Of the force, as a share of it.
    slowing : float
        Of the logarithm of the response's time constant.
    shape : float
        Of the response otherwise, as a share of it.
    """

    threshold: float = 0.01
    slope: float = 0.1
    gain: float = 0.1
    slowing: float = 0.05
    shape: float = 0.005


@dataclass(frozen=True, kw_only=True)
class FittedMuscle:
    """Muscle of a fit with its covariance, for the next session of a patient.

    Raises
    ------
    IdentificationError
        If shapes differ, or a value is none that a muscle has.
    """

    time_constant_s: float = documented('of the Laguerre functions [s]')
    latency_s: float = documented('from a pulse to the beginning of the functions [s]')
    theta: FloatArray = documented(
        'u_thr, u_sat, alpha_sat, alpha_thr, deviation of the recruitment (24), exponents of r (2)'
    )
    linear: FloatArray = documented('coefficients of the functions [N s^(1/2)]')
    covariance: FloatArray = documented('of theta and linear, alpha as logarithms')
    variance: float = documented('of the residuals [N^2]')

    def __post_init__(self) -> None:
        joint = _KEPT + len(self.linear)
        if self.theta.shape != (_KEPT,) or self.covariance.shape != (joint, joint):
            raise IdentificationError(
                f'expected {_KEPT} parameters and a covariance of {joint}, got '
                f'{self.theta.shape} and {self.covariance.shape}'
            )
        values = np.concatenate((self.theta, self.linear, self.covariance.ravel()))
        if not (np.isfinite(values).all() and 0.0 < self.variance < math.inf):
            raise IdentificationError('expected finite parameters of a muscle, got others')
        if not (self.theta[2:PARAMETERS] > 0.0).all():
            alpha = self.theta[2:PARAMETERS].tolist()
            raise IdentificationError(f'expected alpha above 0, got {alpha}')

    @property
    def basis(self) -> LaguerreBasis:
        """Functions of the response."""
        return LaguerreBasis(len(self.linear), self.time_constant_s, self.latency_s)

    def on(self, basis: LaguerreBasis) -> 'FittedMuscle':
        """Return the same on another basis."""
        if basis == self.basis:
            return self
        joint = np.eye(_KEPT + basis.functions, len(self.covariance))
        joint[_KEPT:, _KEPT:] = conversion(self.basis, basis)
        return replace(
            self,
            time_constant_s=basis.time_constant,
            latency_s=basis.latency,
            linear=joint[_KEPT:, _KEPT:] @ self.linear,
            covariance=joint @ self.covariance @ joint.T,
        )

    def widened(self, change: DayToDay) -> FloatArray:
        """Return the covariance, of the same shape, after a change from day to day."""
        size = float(self.linear @ self.linear)
        spread = np.concatenate(
            (
                np.full(2, change.threshold**2),
                np.full(2, change.slope**2),
                np.zeros(_KEPT - PARAMETERS),
                np.full(len(self.linear), change.shape**2 * size / len(self.linear)),
            )
        )
        covariance: FloatArray = self.covariance + np.diag(spread)
        response = covariance[_KEPT:, _KEPT:]
        response += change.gain**2 * np.outer(self.linear, self.linear)
        stretch = time_scale_derivative(self.linear)
        response += change.slowing**2 * np.outer(stretch, stretch)
        return covariance


@runtime_checkable
class WarmStarting(Estimator, Protocol):
    """An estimator that can start from an earlier session."""

    def start_from(self, known: FittedMuscle) -> None:
        """Use the result of an earlier session as prior.

        Raises
        ------
        IdentificationError
            If there have been data.
        """


def warm_start(estimator: Estimator, path: Path | str, unit: str = 'N') -> None:
    """Start a fresh estimator from the JSON of ``rpms identify``.

    Raises
    ------
    IdentificationError
        If the file holds no recruitment curve, or one in another unit than that of the force, or
        the estimator cannot start from one.
    """
    if not isinstance(estimator, WarmStarting):
        raise IdentificationError(
            'expected an estimator that can start from an earlier session, such as tracking, got '
            f'{estimator.name}'
        )
    estimator.start_from(fitted_muscle_of(path, unit))


def fitted_muscle_of(path: Path | str, unit: str = 'N') -> FittedMuscle:
    """Return the knowledge in the JSON of ``rpms identify``.

    Raises
    ------
    IdentificationError
        If it holds no recruitment curve, or not all that `batch` and `tracking` know of one, if
        its forces have another unit, or its verdict is no.
    """
    try:
        path = Path(path)
        if path.stat().st_size > _LARGEST_RESULT or not path.is_file():
            raise ValueError(f'no file of at most {_LARGEST_RESULT} bytes')
        document = json.loads(path.read_text())
        muscle, its, verdict = document['muscle'], document['unit'], document['verdict']
        values: dict[str, Any] = {
            field.name: np.array(muscle[field.name], dtype=np.float64)[()]
            for field in fields(FittedMuscle)
        }
        known = FittedMuscle(**values)
    except (LookupError, TypeError, ValueError, OSError, RecursionError) as error:
        got = f'none of its {error}' if isinstance(error, KeyError) else repr(error)
        raise IdentificationError(
            f'expected the JSON of rpms identify, of a session with a recruitment curve '
            f'identified by batch or tracking, in {path}, got {got}'
        ) from error
    if its != unit:
        raise IdentificationError(f'expected a result in {unit}, got one in {its} in {path}')
    if verdict['grade'] == 'no':
        raise IdentificationError(f'expected a result that may be used, got verdict no in {path}')
    return known
