# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A test of the a-priori errors that finds sudden changes of the muscle.

The logarithm of the mean square q of the a-priori errors of a block is compared with that of the
last blocks: ``z = (log q - mean) / deviation``, limited to -3..3.  The sum
``c <- max(0, c + z - 1)`` (Page's cumulative sum) stays near zero while the muscle does not
change.  A block adds at most 2, so at least ten blocks, half a second of pulses at 20 Hz, are
needed to exceed 20: a knock or a single spike is no change.

Kind of a sudden change, by fits to the samples since.

When the errors begin to grow, the state is stored, and later samples are summed separately.  Once
the change is certain, several explanations are fitted to these sums, each with a prior around the
muscle before: a change of the gain, of the thresholds (the coil has moved), of the dynamics, or a
jump of the baseline.  They are compared by their evidence, the probability of the samples with the
unknowns integrated out (Laplace's approximation); a wider prior lowers it.  The priors are
those of `rpms_ros.identification.estimation.change_detection`.

Sums of the samples since a change may have begun, and the state before it.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rpms_ros.identification.estimation.blocks import newest, without_force
from rpms_ros.identification.estimation.change_detection import (
    BASELINE,
    DYNAMICS,
    GAIN,
    THRESHOLDS,
    widened,
)
from rpms_ros.identification.estimation.gauss_newton import LEAST_ENERGY, Fit, empty_fit
from rpms_ros.identification.estimation.normal_equations import advance_state
from rpms_ros.identification.estimation.prior import Knowledge, coordinates, scaled_inverse
from rpms_ros.identification.estimation.settings import PARAMETERS, Prior
from rpms_ros.identification.estimation.uncertainty import uncertainty
from rpms_ros.identification.recursion.fit import equations
from rpms_ros.identification.recursion.sums import (
    KNOTS,
    Memory,
    Sums,
    add_block,
    interpolate,
    let_baseline_drift,
    recompute_response,
    recruitment_at_knots,
    scale_memory,
    sums_of,
    without,
)
from rpms_ros.pulses import FloatArray
from rpms_ros.saved_state import Restorable, expect

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


# Most blocks over which mean and deviation are taken.
_BLOCKS = 200.0
_MOST, _DRIFT, _LIMIT = 3.0, 1.0, 20.0
# Standard deviation of the logarithm of a mean of 50 squares of white noise.
_LEAST_DEVIATION = 0.2
# Before this time the errors fall because the recursion learns [s].
_SETTLING_TIME = 5.0


class ChangeTest(Restorable):
    """State of the test.

    Attributes
    ----------
    learnt_s : float
        Time in which pulses acted since the start or the last change [s].
    changes : int
        How many changes were found.
    changed_ns : int or None
        When the newest change began [ns]; None before one, and after a jump of the clock.
    kind : str
        What the newest change was of.
    """

    learnt_s: float
    changes: int
    changed_ns: int | None
    kind: str
    _mean: float
    _variance: float
    _blocks: float
    _sum: float
    _begun_ns: int

    def __init__(self) -> None:
        self.learnt_s = 0.0
        self.changes = 0
        self.changed_ns = None
        self.kind = UNKNOWN
        self._mean = 0.0
        self._variance = 0.0
        self._blocks = 0.0
        self._sum = 0.0
        self._begun_ns = 0

    @property
    def suspects(self) -> bool:
        """Whether the sum has risen: a change may have begun."""
        return self._sum > 0.0

    def interrupt(self) -> None:
        """Reset the sum and forget when a change was: the next blocks are of another clock."""
        self._sum = 0.0
        self.changed_ns = None

    def take(self, start_ns: int, seconds: float, mean_square: float) -> bool:
        """Add a block in which pulses act; return whether the muscle has changed.

        Parameters
        ----------
        start_ns : int
            When the block began [ns].
        seconds : float
            How long it was [s].
        mean_square : float
            Mean square of its a-priori errors, above zero [N^2].
        """
        self.learnt_s += seconds
        value = math.log(mean_square)
        if self.learnt_s > _SETTLING_TIME:
            deviation = max(math.sqrt(self._variance), _LEAST_DEVIATION)
            away = min(max((value - self._mean) / deviation, -_MOST), _MOST)
            if self._sum == 0.0:
                self._begun_ns = start_ns
            self._sum = max(0.0, self._sum + away - _DRIFT)
            if self._sum > _LIMIT:
                self.changes += 1
                self.changed_ns = self._begun_ns
                self._sum = self.learnt_s = self._blocks = 0.0
                return True
            if self._sum > 0.0:
                return False
        self._blocks = min(self._blocks + 1.0, _BLOCKS)
        away = value - self._mean
        self._mean += away / self._blocks
        self._variance += (away * (value - self._mean) - self._variance) / self._blocks
        return False


# Samples are not used for so long: the force of earlier pulses partly has the new dynamics, and a
# block may contain samples from before the change [ns].
_SETTLING_NS = 400_000_000

# Level of intervals, which are not used.
_ANY_LEVEL = 0.95


class Until(NamedTuple):
    """State when a change may have begun: sums, parameters, spread of the residuals."""

    sums: Sums
    fit: Fit
    spread: FloatArray


class SinceChange(Restorable):
    """Sums over the samples since a change may have begun.

    Parameters
    ----------
    memory : Memory
        The memory of the recursion.
    fit : Fit
        Its parameters.
    spread : ndarray (lengths,)
        Spread of its residuals [N^2].
    """

    _until: Until
    _since: Sums
    _before: FloatArray
    _begun_ns: int

    def __init__(self, memory: Memory, fit: Fit, spread: FloatArray) -> None:
        self.begin(memory, fit, spread)
        self._shapes = self._present_shapes()

    def _present_shapes(self) -> list[tuple[int, ...]]:
        until = self._until
        arrays = (*until.sums, *until.fit, until.spread, *self._since, self._before)
        return [one.shape for one in arrays]

    def _check_restored(self) -> None:
        alike = self._present_shapes() == self._shapes
        expect(alike, 'SinceChange', 'arrays of one model')

    def begin(self, memory: Memory, fit: Fit, spread: FloatArray) -> None:
        """Keep what is known: the pulse of the newest block may be one to another muscle."""
        known = Fit(*(part.copy() for part in fit))
        self._until = Until(sums_of(memory), known, spread.copy())
        self._since = Sums(*(np.zeros_like(part) for part in self._until.sums))
        self._before = memory.chains.copy()
        self._begun_ns = 0
        if memory.blocks.size[0]:
            here = newest(memory.blocks)
            self._begun_ns = int(memory.blocks.start_ns[here])
            share = np.empty(len(self._before))
            interpolate(float(memory.blocks.intensity[here]), share)
            self._before -= float(memory.blocks.weight[here]) * share[:, None]

    def advance(self, memory: Memory) -> None:
        """Let a block begin."""
        transition = memory.blocks.transition[newest(memory.blocks)]
        for chain in self._before:
            advance_state(transition, chain)

    def add(self, memory: Memory, here: int, drift: float) -> None:
        """Add a block that is added to the memory; `drift` is the baseline's variance.

        The force of pulses before the change is that of the muscle before, and taken off.
        """
        fit, blocks = self._until.fit, memory.blocks
        if int(blocks.start_ns[here]) < self._begun_ns + _SETTLING_NS:
            return
        force = np.empty(len(fit.linear))
        recompute_response(self._before, fit.theta, fit.linear, force)
        response, moments = blocks.response.copy(), blocks.moments.copy()
        without_force(blocks, here, force, response[here], moments[here])
        since = memory._replace(
            chains=memory.chains - self._before,
            blocks=blocks._replace(response=response, moments=moments),
            **self._since._asdict(),
        )
        if since.samples[0] > 0.0:
            let_baseline_drift(since, drift)
        add_block(since, here)

    def explain(self, memory: Memory, prior: Prior, bounds: Knowledge) -> Explained:
        """Return what has changed since."""
        fit = self._until.fit
        sure = uncertainty(fit, prior, self._until.spread, _ANY_LEVEL)
        if sure is None or not self._since.samples[0] > 0.0:
            return Explained(UNKNOWN, fit.theta, fit.linear, float(fit.levels[0]))
        variance = max(float(fit.variance[0]), float(self._until.spread.max(initial=0.0)))
        since = memory._replace(**self._since._asdict())
        return explain(since, fit, sure.covariance, bounds, variance)

    def renew(self, memory: Memory, found: Explained, kept: float) -> None:
        """Let the memory hold what came since, and of what was before what still holds.

        Parameters
        ----------
        memory : Memory
            Overwritten.
        found : Explained
            What has changed.
        kept : float
            What was before counts as so many samples at the most.
        """
        fit, before = self._until.fit, self._until.sums
        if found.kind != UNKNOWN:
            force = math.sqrt(float(before.energy[0]) / max(float(before.samples[0]), 1.0))
            directions = freed(found.kind, fit.theta, fit.linear, force)
            before = without(before, directions, float(fit.variance[0]))
        share = min(kept / max(float(before.samples[0]), 1.0), 1.0)
        old = sums_of(memory._replace(**before._asdict()))
        scale_memory(memory._replace(**old._asdict()), share)
        for name in Sums._fields:
            getattr(memory, name)[:] = getattr(old, name) + getattr(self._since, name)
