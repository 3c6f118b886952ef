# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Prior of a window: physiology, bounds, and the result of earlier samples."""

from dataclasses import dataclass
from dataclasses import replace
from functools import cache
from functools import cached_property
from typing import TYPE_CHECKING
from typing import NamedTuple

import numba
import numpy as np
from scipy.special import chdtri

from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.projection.settings import ProjectionSettings
from rpms_ros.identification.tracking.assembly import SLOPES
from rpms_ros.identification.tracking.assembly import Point
from rpms_ros.pulses import FloatArray

if TYPE_CHECKING:
    from rpms_ros.identification.tracking.window_fit import WindowFit

# Confidence level at which an earlier result is rejected.
_CONTRADICTED = 0.999
# Error of the response by a conversion of the basis or a rest, as a share of it.
_LOST = 0.01
# Standard deviations of the change of the slope from knot to knot, and of the increments besides,
# relative to the slope.
_SLOPE_WALK, _SLOPE_NOISE = 0.15, 0.02
# Added to the diagonal of a matrix whose rows are scaled to 1.
ROUNDING = 1e-9


class Terms(NamedTuple):
    """What is known at a point: cost, gradient and information, for `added`.

    Attributes
    ----------
    matrix, gradient : ndarray (4 + functions, 4 + functions), (4 + functions,)
        Information about [theta, w], and minus half the gradient of the cost.
    cost, logarithm : float
        Cost, and log-determinant of what was learnt before.
    walk : ndarray (knots, knots)
        Information about a slow change of scale 1.
    changes : ndarray (2, knots)
        Gain and slowing at the knots of the past.
    slope : ndarray (2,)
        Of u_thr and u_sat, per interval of age.
    """

    matrix: FloatArray
    gradient: FloatArray
    cost: float
    logarithm: float
    walk: FloatArray
    changes: FloatArray
    slope: FloatArray


@numba.njit(cache=True)
def added(
    terms: Terms, scales: FloatArray, matrix: FloatArray, right: FloatArray
) -> tuple[float, float]:
    """Add what is known to the equations of x; return its cost and its log-determinant.

    Parameters
    ----------
    terms : Terms
        At the point of the equations.
    scales : ndarray (3,)
        Change of force and of time constant from knot to knot (relative), of u_thr and u_sat
        from interval to interval.
    matrix, right : ndarray (unknowns, unknowns), (unknowns,)
        Information and minus half the gradient, in place.
    """
    joint, knots = len(terms.gradient), terms.changes.shape[1]
    cost, logarithm = terms.cost, terms.logarithm
    matrix[:joint, :joint] += terms.matrix
    right[:joint] += terms.gradient
    for which in range(2):
        information = 1.0 / scales[which] ** 2
        first = joint + which * knots
        for row in range(knots):
            pull = 0.0
            for column in range(knots):
                value = information * terms.walk[row, column]
                matrix[first + row, first + column] += value
                pull += value * terms.changes[which, column]
            right[first + row] -= pull
            cost += pull * terms.changes[which, row]
        logarithm -= 2.0 * knots * np.log(scales[which])
    information = 1.0 / scales[2] ** 2
    for index in range(SLOPES):
        place = joint + 2 * knots + index
        matrix[place, place] += information
        right[place] -= information * terms.slope[index]
        cost += information * terms.slope[index] ** 2
        logarithm -= 2.0 * np.log(scales[2])
    return cost, logarithm


@dataclass(frozen=True)
class Knowledge:
    """Priors of x.

    Attributes
    ----------
    mean, deviation : ndarray (4,)
        Physiological prior of theta, alpha as logarithms.
    lower, upper : ndarray (4,)
        Bounds of theta, alpha as logarithms.
    separation : float
        u_sat is at least this far above u_thr.
    information, reference : ndarray (4 + functions, 4 + functions), (4 + functions,)
        Result of samples before the window: inverse covariance and mean of [theta, w].
    """

    mean: FloatArray
    deviation: FloatArray
    lower: FloatArray
    upper: FloatArray
    separation: float
    information: FloatArray
    reference: FloatArray

    @cached_property
    def _logarithm(self) -> float:
        """Log-determinant of the prior of [theta, w], 0 if it is the physiology alone."""
        if not self.information.any():
            return 0.0
        matrix = self.information.copy()
        place = np.arange(PARAMETERS)
        matrix[place, place] += 1.0 / self.deviation**2
        return float(np.linalg.slogdet(matrix)[1])

    def about(self, point: Point, ridge: float) -> 'Terms':
        """Return what is known at a point, whatever the scales.

        Parameters
        ----------
        point : Point
            Where.
        ridge : float
            Information about each coefficient of w, around nothing.
        """
        theta = coordinates(point.theta)
        linear = point.linear
        here = np.concatenate((theta, linear))
        matrix = self.information.copy()
        before = here - self.reference
        pull = matrix @ before
        gradient = -pull
        cost = float(before @ pull)
        away = theta - self.mean
        place = np.arange(PARAMETERS)
        matrix[place, place] += 1.0 / self.deviation**2
        gradient[:PARAMETERS] -= away / self.deviation**2
        cost += float(np.sum((away / self.deviation) ** 2))
        place = np.arange(PARAMETERS, len(here))
        matrix[place, place] += ridge
        gradient[PARAMETERS:] -= ridge * linear
        cost += ridge * float(linear @ linear)
        changes = np.stack((point.gain, point.slowing))
        walk = walk_information(len(point.gain))
        return Terms(matrix, gradient, cost, self._logarithm, walk, changes, point.slope)

    def bounded(self, point: Point, step: FloatArray, hessian: FloatArray) -> FloatArray:
        """Return the step (unknowns,) with theta within its bounds, the rest solved again."""
        theta = coordinates(point.theta)
        low, high = self.lower - theta, self.upper - theta
        held = np.zeros(len(step), dtype=bool)
        right = hessian @ step
        for _ in range(PARAMETERS):
            inside = np.clip(step[:PARAMETERS], low, high)
            leaves = (np.abs(inside - step[:PARAMETERS]) > 0.0) & ~held[:PARAMETERS]
            if not leaves.any():
                break
            held[:PARAMETERS] |= leaves
            step = step.copy()
            step[:PARAMETERS][leaves] = inside[leaves]
            free = ~held
            rest = right[free] - hessian[np.ix_(free, held)] @ step[held]
            step[free] = np.linalg.solve(hessian[np.ix_(free, free)], rest)
        step[:PARAMETERS] = np.clip(step[:PARAMETERS], low, high)
        return step

    def part(self, theta: FloatArray) -> None:
        """Keep u_sat of theta (4,) above u_thr, in place."""
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

    def converted(self, matrix: FloatArray, size: float) -> 'Knowledge':
        """Return the prior in other coordinates of [theta, w], `matrix` times these.

        `size` is the norm of w; a share of it is added as the error of the conversion.
        """
        if not self.information.any():
            return self
        joint = len(self.reference)
        covariance = matrix @ scaled_inverse(self.information) @ matrix.T
        place = np.arange(PARAMETERS, joint)
        covariance[place, place] += (_LOST * size) ** 2
        return replace(
            self, information=scaled_inverse(covariance), reference=matrix @ self.reference
        )


def knowledge_of(settings: ProjectionSettings) -> Knowledge:
    """Return the prior before any sample."""
    prior = settings.as_prior()
    joint = PARAMETERS + settings.basis.functions
    return Knowledge(
        mean=prior.mean,
        deviation=prior.deviation,
        lower=coordinates(prior.lower),
        upper=coordinates(prior.upper),
        separation=prior.separation,
        information=np.zeros((joint, joint)),
        reference=np.zeros(joint),
    )


def informed(knowledge: Knowledge, fit: 'WindowFit') -> Knowledge:
    """Return the result of a fit as prior for later samples, slightly widened."""
    point = fit.point
    joint = PARAMETERS + len(point.linear)
    covariance = fit.covariance[:joint, :joint].copy()
    place = np.arange(PARAMETERS, joint)
    covariance[place, place] += (_LOST * float(np.linalg.norm(point.linear))) ** 2
    reference = np.concatenate((coordinates(point.theta), point.linear))
    return replace(knowledge, information=scaled_inverse(covariance), reference=reference)


@cache
def walk_information(knots: int) -> FloatArray:
    """Return the inverse covariance of a slow change at knots (knots, knots), which is 0 now.

    The first increment has standard deviation 1; the slope is a random walk from there.
    """
    place = np.arange(1.0, knots + 1.0)
    increments = (
        1.0
        + _SLOPE_WALK**2 * np.minimum.outer(place - 1.0, place - 1.0)
        + _SLOPE_NOISE**2 * np.eye(knots)
    )
    difference = np.eye(knots) - np.eye(knots, k=-1)
    information: FloatArray = difference.T @ np.linalg.solve(increments, difference)
    return information


def coordinates(theta: FloatArray) -> FloatArray:
    """Return theta (4,) with alpha as logarithms."""
    return np.concatenate((theta[:2], np.log(theta[2:])))


def scaled_inverse(matrix: FloatArray) -> FloatArray:
    """Return the inverse (n, n) of a symmetric matrix whose rows differ much in size."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix * np.outer(scale, scale) + ROUNDING * np.eye(len(matrix))
    inverse: FloatArray = np.linalg.inv(scaled) * np.outer(scale, scale)
    return 0.5 * (inverse + inverse.T)
