# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Choice of latency and time constant of the basis by the samples.

Infinitely many Laguerre functions describe any twitch, but seven only one whose time constant is
similar and which does not begin before their latency.  So the basis is compared with others by the
likelihood of the newest seconds, at first on a coarse grid and later with its neighbours.
"""

from dataclasses import replace

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.laguerre import LaguerreBasis
from rpms_ros.identification.projection.block_statistics import COUNT
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.projection.problem import Prior
from rpms_ros.identification.tracking.assembly import SLOPES
from rpms_ros.identification.tracking.intervals import no_change
from rpms_ros.identification.tracking.knowledge import Knowledge
from rpms_ros.identification.tracking.raw_samples import RawSamples
from rpms_ros.identification.tracking.window_fit import Window
from rpms_ros.identification.tracking.window_fit import WindowFit
from rpms_ros.identification.tracking.window_fit import explained
from rpms_ros.identification.tracking.window_fit import fresh_fit
from rpms_ros.pulses import FloatArray

TIME_CONSTANTS = (8e-3, 12e-3, 18e-3, 27e-3, 40e-3, 60e-3, 90e-3)
LATENCIES = (0.0, 4e-3, 8e-3, 13e-3, 19e-3, 26e-3)
_RATIO = 1.25
_SHIFT = 2.5e-3
_SHORTEST, _LONGEST = 5e-3, 0.11
_LONGEST_LATENCY = 35e-3
# Difference of the log-likelihood from which another basis is taken [nat], so that it is stable.
_DECISION = 15.0
_STEPS = 6


def grid(functions: int) -> list[LaguerreBasis]:
    """Return the grid of bases over the range of people."""
    return [
        LaguerreBasis(functions, time_constant, latency)
        for time_constant in TIME_CONSTANTS
        for latency in LATENCIES
    ]


def neighbours(basis: LaguerreBasis) -> list[LaguerreBasis]:
    """Return the bases next to one."""
    constant, latency = basis.time_constant, basis.latency
    faster, slower = max(constant / _RATIO, _SHORTEST), min(constant * _RATIO, _LONGEST)
    sooner, later = max(latency - _SHIFT, 0.0), min(latency + _SHIFT, _LONGEST_LATENCY)
    pairs = ((faster, latency), (slower, latency), (constant, sooner), (constant, later))
    found = [replace(basis, time_constant=one, latency=two) for one, two in pairs]
    return [one for one in found if one != basis]


def conversion(old: LaguerreBasis, new: LaguerreBasis) -> FloatArray:
    """Return the matrix (functions, functions) that takes coefficients from one basis to another.

    The response of the new coefficients is the projection of the old one.
    """
    step = min(old.time_constant, new.time_constant) / 60.0
    longest = max(old.duration, new.duration)
    lag = np.arange(0.5 * step, longest, step)
    result: FloatArray = step * (new.evaluate(lag).T @ old.evaluate(lag))
    return result


def likelihood(
    raw: RawSamples,
    basis: LaguerreBasis,
    fit: WindowFit,
    knowledge: Knowledge,
    prior: Prior,
    first_ns: int,
    now_ns: int,
    length_ns: int,
    spacing: float,
) -> float:
    """Return the log-likelihood of a basis for the samples since a time."""
    functions = basis.functions
    theta = fit.point.theta
    problem, _, _ = raw.condensed(basis, theta, np.zeros(functions), first_ns, prior)
    blocks = problem.blocks
    size = int(blocks.size[0])
    if size < 2:
        return -np.inf
    joint = PARAMETERS + functions
    alone = replace(knowledge, information=np.zeros((joint, joint)), reference=np.zeros(joint))
    trial = replace(fresh_fit(theta, functions), scales=fit.scales, variance=fit.variance)
    trial.together = fit.together
    begin_ns = int(blocks.start_ns[problem.first])
    knots = int((now_ns - begin_ns) / (spacing * length_ns) + 0.5)
    window = Window(begin_ns, now_ns, length_ns, spacing, knots, no_change(functions))
    assert len(trial.covariance) == joint + SLOPES
    if not explained(problem, trial, alone, window, _STEPS):
        return -np.inf
    # Not the evidence: it would prefer a basis whose functions the samples do not determine.
    samples = float(blocks.moments[problem.first : size, COUNT].sum())
    return -0.5 * trial.misfit * samples


def better(
    raw: RawSamples,
    candidates: list[LaguerreBasis],
    basis: LaguerreBasis,
    fit: WindowFit,
    knowledge: Knowledge,
    prior: Prior,
    first_ns: int,
    now_ns: int,
    length_ns: int,
    spacing: float,
) -> LaguerreBasis | None:
    """Return the best of the candidates if it is clearly better than the basis, else None."""
    if fit.variance <= 0.0:
        raise IdentificationError(f'expected a variance above 0, got {fit.variance}')
    rest = (fit, knowledge, prior, first_ns, now_ns, length_ns, spacing)
    best, most = None, likelihood(raw, basis, *rest) + _DECISION
    for candidate in candidates:
        value = likelihood(raw, candidate, *rest)
        if value > most:
            best, most = candidate, value
    return best
