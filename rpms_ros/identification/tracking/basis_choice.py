# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Choice of latency and time constant of the basis by the samples.

Laguerre functions of any time constant can describe any twitch, but seven of them only one that
is not far from their own, and none that begins before their latency.  So the basis is compared
with others by the likelihood of the newest seconds: on a coarse grid while little is known, and
uphill from neighbour to neighbour.  Each is given the disturbance and the slow change that suit
it: with those of a basis that does not fit, all are much the same.
"""

import math
from dataclasses import dataclass
from dataclasses import field
from dataclasses import replace

import numpy as np

from rpms_ros.identification.laguerre import LaguerreBasis
from rpms_ros.identification.projection.block_statistics import COUNT
from rpms_ros.identification.projection.problem import Prior
from rpms_ros.identification.tracking.intervals import no_change
from rpms_ros.identification.tracking.knowledge import Knowledge
from rpms_ros.identification.tracking.raw_samples import RawSamples
from rpms_ros.identification.tracking.tremor import line_in
from rpms_ros.identification.tracking.window_fit import Scales
from rpms_ros.identification.tracking.window_fit import Window
from rpms_ros.identification.tracking.window_fit import WindowFit
from rpms_ros.identification.tracking.window_fit import fresh_fit
from rpms_ros.identification.tracking.window_fit import improved
from rpms_ros.pulses import FloatArray

TIME_CONSTANTS = (8e-3, 16e-3, 32e-3, 64e-3)
LATENCIES = (0.0, 7e-3, 14e-3, 22e-3)
_RATIO = 1.25
_SHIFT = 2.5e-3
_SHORTEST, _LONGEST = 5e-3, 0.11
_LONGEST_LATENCY = 35e-3
# Another basis has to be this much better [nat]: nothing is gained by going to and fro.
_DECISION = 10.0
# A tremor has to make the samples likelier by so much [nat]: it has two unknowns a second.
_TREMOR_DECISION = 50.0
_STEPS = 10
# From this place on its grid a disturbance is lively: below a ten thousandth of the force.
LIVELY = 4


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
    # a slower basis that begins earlier is much like a faster one that begins later
    pairs = (
        *((faster, latency), (slower, latency), (constant, sooner), (constant, later)),
        *((faster, later), (slower, sooner)),
    )
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


@dataclass(frozen=True)
class Explained:
    """How well a basis explains the samples.

    Attributes
    ----------
    fit : WindowFit
        Its fit, disturbance and slow change as they suit the basis.
    raw : RawSamples
        The samples, without the tremor if there is one.
    tremor : float
        Frequency of a tremor that shows beside the muscle [Hz], 0 if there is none.
    """

    fit: WindowFit
    raw: RawSamples
    tremor: float = 0.0


@dataclass(frozen=True)
class BasisChoice:
    """Likelihood of bases for the newest samples of a window, and the search for the best.

    Attributes
    ----------
    raw : RawSamples
        Samples and pulses.
    fit : WindowFit
        Of the present basis: where the others begin.
    knowledge : Knowledge
        Physiology alone: what was learnt with one basis says little of another.
    prior : Prior
        Goes with the blocks.
    first_ns, now_ns : int
        First and newest sample [ns].
    length_ns : int
        Length of an interval [ns].
    spacing : float
        Distance of the knots of a slow change, in intervals.
    lag : float
        How long after its pulse the force acts in the mean, in intervals.
    rates_hz : ndarray (rates,) or None
        Repetition rates of the newest pulses; None if a tremor has been taken off.
    """

    raw: RawSamples
    fit: WindowFit
    knowledge: Knowledge
    prior: Prior
    first_ns: int
    now_ns: int
    length_ns: int
    spacing: float
    lag: float
    rates_hz: FloatArray | None
    _found: dict[LaguerreBasis, Explained] = field(default_factory=dict)

    def better(self, basis: LaguerreBasis, everywhere: bool) -> LaguerreBasis:
        """Return the best basis if it is clearly better than the present one, else that.

        The search goes uphill from the present basis, or from the best that people have.
        """
        candidates = (basis, *grid(len(self.fit.point.linear))) if everywhere else (basis,)
        best = max(candidates, key=self._likelihood)
        while True:
            nearest = max((best, *neighbours(best)), key=self._likelihood)
            if nearest == best:
                break
            best = nearest
        gain = self._likelihood(best) - self._likelihood(basis)
        alike = min(self.explained(best).fit.together, self.fit.most_together)
        return best if gain > _DECISION * alike else basis

    def explained(self, basis: LaguerreBasis) -> Explained:
        """Return how well a basis explains the samples, with a tremor or without.

        The force of a muscle has lines of its own, and so has what a wrong basis leaves: so a
        tremor has to make the samples much likelier.
        """
        if basis not in self._found:
            self._found[basis] = self._judged(basis)
        return self._found[basis]

    def _likelihood(self, basis: LaguerreBasis) -> float:
        return self.explained(basis).fit.likelihood

    def _judged(self, basis: LaguerreBasis) -> Explained:
        fit = self._fitted(self.raw, basis)
        alone = Explained(fit, self.raw)
        if self.rates_hz is None or not math.isfinite(fit.likelihood):
            return alone
        stamp_ns, _, rest = self.raw.rest(basis, fit.point.theta, fit.point.linear, self.prior)
        hertz = line_in(stamp_ns, rest, self.rates_hz)
        if hertz == 0.0:
            return alone
        cleaned = self.raw.without(hertz, rest)
        without = self._fitted(cleaned, basis)
        if without.likelihood < fit.likelihood + _TREMOR_DECISION:
            return alone
        return Explained(without, cleaned, hertz)

    def _fitted(self, raw: RawSamples, basis: LaguerreBasis) -> WindowFit:
        """Return the fit of a basis.

        From a disturbance that is as lively as at present a fit does not find its way to a quiet
        one, nor the other way round, so both are tried.
        """
        fit = self.fit
        functions = len(fit.point.linear)
        theta = fit.point.theta
        quiet, lively = (fresh_fit(theta, functions) for _ in range(2))
        # Likelihoods are comparable only if all weight the samples alike.
        quiet.most_together = lively.most_together = 1.0
        problem, _, _ = raw.condensed(basis, theta, np.zeros(functions), self.first_ns, self.prior)
        blocks, first = problem.blocks, problem.first
        if int(blocks.size[0]) < 2:
            return quiet
        # Blocks end where a pulse begins to act: with the one before, the samples of all bases
        # are the same.
        if first > 0 and blocks.moments[first - 1, COUNT] > 0.0:
            problem = problem._replace(first=first - 1)
        begin_ns = int(blocks.start_ns[problem.first])
        knots = int((self.now_ns - begin_ns) / (self.spacing * self.length_ns) + 0.5)
        window = Window(
            begin_ns,
            self.now_ns,
            self.length_ns,
            self.spacing,
            knots,
            self.lag,
            no_change(functions),
        )
        improved(problem, quiet, self.knowledge, window, _STEPS)
        if fit.scales.disturbance < LIVELY:
            return quiet
        lively.scales = Scales(disturbance=fit.scales.disturbance)
        lively.levels, lively.first = fit.levels.copy(), fit.first
        improved(problem, lively, self.knowledge, window, _STEPS)
        return max(quiet, lively, key=lambda one: one.likelihood)
