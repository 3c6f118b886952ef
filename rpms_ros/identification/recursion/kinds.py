# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Kind of a sudden change, by fits to the samples since.

When the errors begin to grow, the state is stored, and later samples are summed separately.  Once
the change is certain, several explanations are fitted to these sums, each with a prior around the
muscle before: a change of the gain, of the thresholds (the coil has moved), of the dynamics, or a
jump of the baseline.  They are compared by their evidence, the probability of the samples with the
unknowns integrated out (Laplace's approximation); a wider prior lowers it.  The priors are
those of `rpms_ros.identification.tracking.changes`.
"""

from dataclasses import dataclass

import numpy as np

from rpms_ros.identification.projection.fit import LEAST_ENERGY
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.fit import empty_fit
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.recursion.fit import equations
from rpms_ros.identification.recursion.knots import KNOTS
from rpms_ros.identification.recursion.knots import recruitment_at_knots
from rpms_ros.identification.recursion.memory import Memory
from rpms_ros.identification.tracking.changes import BASELINE
from rpms_ros.identification.tracking.changes import DYNAMICS
from rpms_ros.identification.tracking.changes import GAIN
from rpms_ros.identification.tracking.changes import THRESHOLDS
from rpms_ros.identification.tracking.changes import widened
from rpms_ros.identification.tracking.knowledge import Knowledge
from rpms_ros.identification.tracking.knowledge import coordinates
from rpms_ros.identification.tracking.knowledge import scaled_inverse
from rpms_ros.pulses import FloatArray

UNKNOWN = 'unknown'
_STEPS = 8
_LARGEST_STEP: FloatArray = np.array([0.1, 0.1, 0.7, 0.5])
# Standard deviation of the baseline's change with and without a jump, as a share of the force.
_JUMP, _STAYS = 0.5, 5e-3
# Least difference of the evidence to every other explanation [nat].
_DECISION = 5.0
# An explanation with a mean square residual above so many times that of the noise is rejected.
_UNEXPLAINED = 4.0


@dataclass(frozen=True)
class Explained:
    """The explanation of a change.

    Attributes
    ----------
    kind : str
        `gain`, `thresholds`, `dynamics`, `baseline`; `unknown` if none explains the samples, or
        more than one does.
    theta, linear : ndarray (4,), (functions,)
        The muscle after the change by the most likely explanation; the muscle before if none
        explains the samples.
    level : float
        The baseline after the change [N].
    """

    kind: str
    theta: FloatArray
    linear: FloatArray
    level: float


@dataclass(frozen=True)
class _Trial:
    """One explanation: its parameters, its residuals and its prior.

    Attributes
    ----------
    point : ndarray (unknowns,)
        theta (alpha as logarithms), w and the baseline.
    squares : float
        Sum of the squared residuals [N^2].
    away : float
        Squared distance from the mean of the prior, in standard deviations.
    matrix, information : ndarray (unknowns, unknowns)
        Gauss-Newton matrix of the samples [N^2], and inverse covariance of the prior.
    """

    point: FloatArray
    squares: float
    away: float
    matrix: FloatArray
    information: FloatArray

    def evidence(self, variance: float) -> float:
        """Return the logarithm of the evidence for a variance [N^2], without a constant [nat]."""
        scale = np.sqrt(np.diag(self.information))
        known = self.information / np.outer(scale, scale)
        both = known + self.matrix / (variance * np.outer(scale, scale))
        volume = float(np.linalg.slogdet(both)[1] - np.linalg.slogdet(known)[1])
        return -0.5 * (self.squares / variance + self.away + volume)


def explain(
    recent: Memory, before: Fit, covariance: FloatArray, knowledge: Knowledge, variance: float
) -> Explained:
    """Return the kind of a change and the muscle after it.

    Parameters
    ----------
    recent : Memory
        Sums over the samples since the change.
    before : Fit
        The muscle before.
    covariance : ndarray (4 + functions, 4 + functions)
        Covariance of theta and w before, alpha as logarithms.
    knowledge : Knowledge
        Bounds.
    variance : float
        Variance of the residuals before, times the factor of their correlation [N^2].
    """
    samples = max(float(recent.samples[0]), 1.0)
    power = float(recent.energy[0]) / samples + LEAST_ENERGY
    trials = {}
    for kind in (BASELINE, GAIN, THRESHOLDS, DYNAMICS):
        known = np.zeros((len(covariance) + 1,) * 2)
        known[:-1, :-1] = widened(covariance, before.linear, kind)
        known[-1, -1] = power * (_JUMP if kind == BASELINE else _STAYS) ** 2
        trials[kind] = _tried(recent, before, scaled_inverse(known), knowledge, variance)
    least = min(one.squares for one in trials.values()) / samples
    odds = {kind: one.evidence(max(variance, least)) for kind, one in trials.items()}
    first, second = sorted(odds, key=lambda kind: odds[kind], reverse=True)[:2]
    best = trials[first]
    if best.squares > _UNEXPLAINED * variance * samples:
        return Explained(UNKNOWN, before.theta, before.linear, float(before.levels[0]))
    named = odds[first] - odds[second] > _DECISION
    theta, linear, level = np.split(best.point, [PARAMETERS, len(best.point) - 1])
    theta = np.concatenate((theta[:2], np.exp(theta[2:])))
    return Explained(first if named else UNKNOWN, theta, linear, float(level[0]))


def _tried(
    recent: Memory,
    before: Fit,
    information: FloatArray,
    knowledge: Knowledge,
    variance: float,
) -> _Trial:
    """Fit the samples with a prior around `before`, of `information` (unknowns, unknowns)."""
    fit = empty_fit(before.theta, len(before.linear), 1)
    known = np.concatenate((coordinates(before.theta), before.linear, before.levels))
    point = known.copy()
    trial = None
    for _ in range(_STEPS):
        fit.theta[:] = np.concatenate((point[:2], np.exp(point[2:PARAMETERS])))
        fit.linear[:], fit.levels[:] = point[PARAMETERS:-1], point[-1:]
        equations(recent, fit)
        linear = point[PARAMETERS:]
        left = fit.right - fit.matrix[:, PARAMETERS:] @ linear
        squares = float(recent.energy[0] - linear @ (fit.right + left)[PARAMETERS:])
        away = point - known
        pull = information @ away
        here = _Trial(point, max(squares, 0.0), float(away @ pull), fit.matrix.copy(), information)
        if trial is None or here.evidence(variance) > trial.evidence(variance):
            trial = here
        step = scaled_inverse(fit.matrix / variance + information) @ (left / variance - pull)
        step /= max(1.0, float(np.abs(step[:PARAMETERS] / _LARGEST_STEP).max()))
        point = point + step
        theta = np.clip(point[:PARAMETERS], knowledge.lower, knowledge.upper)
        knowledge.part(theta)
        point[:PARAMETERS] = theta
    assert trial is not None
    return trial


def freed(kind: str, theta: FloatArray, linear: FloatArray, force: float) -> FloatArray:
    """Return the directions of the sums in which a change makes a muscle unknown.

    Parameters
    ----------
    kind : str
        Kind of the change, not `unknown`.
    theta, linear : ndarray (4,), (functions,)
        The muscle before.
    force : float
        Size of the force [N].

    Returns
    -------
    ndarray (directions, knots * functions + 1)
        One standard deviation each: the gain, the recruitment at every knot, every coefficient of
        the response, or the baseline by the size of the force.
    """
    values = np.empty((1 + PARAMETERS, KNOTS))
    recruitment_at_knots(theta, values)
    rho, functions = values[0], len(linear)
    size = float(np.linalg.norm(linear))
    directions = {
        GAIN: np.outer(rho, linear)[None],
        THRESHOLDS: np.einsum('ij,k->ijk', np.eye(KNOTS), linear),
        DYNAMICS: size * np.einsum('i,jk->jik', rho, np.eye(functions)),
        BASELINE: np.zeros((1, KNOTS, functions)),
    }[kind]
    rows = directions.reshape(len(directions), -1)
    return np.hstack((rows, np.full((len(rows), 1), force if kind == BASELINE else 0.0)))
