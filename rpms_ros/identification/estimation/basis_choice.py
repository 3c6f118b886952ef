# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Choice of latency and time constant of the basis by the samples.

Laguerre functions of any time constant can describe any twitch, but seven of them only one
that is not far from their own, and none that begins before their latency. So the basis is
compared with others by the likelihood of the newest seconds: on a coarse grid while little is
known, and uphill from neighbour to neighbour. Each is given the disturbance and the slow
change that suit it: with those of a basis that does not fit, all are much the same.
`BasisSchedule` says when to compare, by stamps alone.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from statistics import fmean
from typing import NamedTuple

import numpy as np

from rpms_ros.identification.estimation.blocks import COUNT
from rpms_ros.identification.estimation.intake import RawSamples
from rpms_ros.identification.estimation.prior import WindowPrior
from rpms_ros.identification.estimation.tremor import SEARCHED_NS, line_in
from rpms_ros.identification.estimation.window_fit import (
    NO_EVENTS,
    Window,
    WindowFit,
    fresh_fit,
    gauss_newton_steps,
)
from rpms_ros.identification.model.basis import LaguerreBasis, conversion
from rpms_ros.identification.model.recruitment import SUMMATION, recruitment
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray

TIME_CONSTANTS = (8e-3, 16e-3, 32e-3, 64e-3)
LATENCIES = (0.0, 7e-3, 14e-3, 21e-3, 28e-3)
_RATIO, _DIGITS = 1.25, 5
# A twitch of two poles begins with a corner: it is seen which samples are behind it.  A basis that
# begins too early has to be too fast as well, and misses the tail.
_SHIFT, _FINER = 2.5e-3, (0.8e-3, 0.3e-3)
_SHORTEST, _LONGEST = 5e-3, 0.11
_LONGEST_LATENCY = 35e-3
# Another basis has to be this much better [nat]: nothing is gained by going to and fro.  Few
# samples may be explained by a basis that does not bear a slow change.  A voluntary effort is not
# quite linear between its knots, and a wrong basis may explain what is left.
_DECISION, _EARLY_DECISION, _LIVELY_DECISION = 6.0, 12.0, 50.0
_EARLY_NS = 12 * NANOSECONDS_PER_SECOND
# Functions of a response that seven do not quite bear, as behind a sensor with a filter.
_MOST_FUNCTIONS = 10
# A tremor has to make the samples likelier by so much [nat]: it has two unknowns a second.
_TREMOR_DECISION = 50.0
_STEPS, _ROUGH_STEPS = 10, 3
# Bases whose log-likelihoods differ by less are told apart by the noise alone [nat].
_EQUAL, _MOST_EQUAL = 6.0, 30
# Of few finalists, more steps do not change the order of those that differ by more [nat].
_FINALISTS, _FAR = 5, 1000.0
# From this place on its grid a disturbance is lively: below a ten thousandth of the force.
LIVELY = 4


def grid(functions: int) -> list[LaguerreBasis]:
    """Return the grid of bases over the range of people."""
    return [LaguerreBasis(functions, *one) for one in product(TIME_CONSTANTS, LATENCIES)]


def _moved(basis: LaguerreBasis, constant: float, latency: float) -> LaguerreBasis:
    """Return a basis elsewhere; rounded, so that one reached in two ways is fitted once."""
    return replace(basis, time_constant=round(constant, _DIGITS), latency=round(latency, _DIGITS))


def neighbours(basis: LaguerreBasis, shift: float = _SHIFT) -> list[LaguerreBasis]:
    """Return the bases next to one, with latencies that differ by `shift` [s]."""
    constant, latency = basis.time_constant, basis.latency
    faster, slower = max(constant / _RATIO, _SHORTEST), min(constant * _RATIO, _LONGEST)
    sooner, later = max(latency - shift, 0.0), min(latency + shift, _LONGEST_LATENCY)
    pairs = (
        *((faster, latency), (slower, latency), (constant, sooner), (constant, later)),
        # a slower basis that begins earlier is much like a faster one that begins later
        *((faster, later), (slower, sooner), (faster, sooner), (slower, later)),
    )
    found = [_moved(basis, *one) for one in pairs]
    return [one for one in found if one != basis]


class BasisFit(NamedTuple):
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
    basis : LaguerreBasis
        The present one.
    fit : WindowFit
        Of the present basis: where the others begin.
    knowledge : WindowPrior
        Physiology alone: what was learnt with one basis says little of another.
    window : Window
        The samples to explain.
    rates_hz : ndarray (rates,) or None
        Repetition rates of the newest pulses; None if a tremor has been taken off.
    """

    raw: RawSamples
    basis: LaguerreBasis
    fit: WindowFit
    knowledge: WindowPrior
    window: Window
    rates_hz: FloatArray | None
    _found: dict[tuple[LaguerreBasis, bool], BasisFit] = field(default_factory=dict)

    def better(self, everywhere: bool) -> LaguerreBasis:
        """Return the best basis if it is clearly better than the present one, else that.

        The search goes uphill from the present basis, and from the best that people have.  A few
        steps tell which bases are among the best; these are fitted to the end.
        """
        basis = self.basis
        begins = [basis]
        if everywhere:
            top = max(grid(basis.functions), key=self._roughly)
            # the present one may be on a hill of its own
            begins = [one for one in (basis, top) if self._near(one, top)]
        for nearest in begins:
            self._uphill(nearest)
        tried = [one for one, rough in self._found if rough]
        finalists = sorted(tried, key=self._roughly, reverse=True)[:_FINALISTS]
        near = [one for one in (basis, *finalists) if self._near(one, finalists[0])]
        best = self._middle(max(near, key=self._likelihood), tried)
        gain = self._likelihood(best) - self.explained(basis, basis not in near).fit.likelihood
        fit = self.explained(best).fit
        length_ns = self.window.now_ns - self.window.first_ns
        least = _EARLY_DECISION if length_ns < _EARLY_NS else _DECISION
        if fit.scales.lively >= LIVELY:
            least = _LIVELY_DECISION
        return best if gain > least * min(fit.inflation, self.fit.most_inflation) else basis

    def _middle(self, best: LaguerreBasis, tried: Sequence[LaguerreBasis]) -> LaguerreBasis:
        """Return the mean of the bases that only the noise tells apart from the best.

        A slow change of intensity tells little of the dynamics, and the best of many bases that
        are nearly equal is one at the edge as often as not, whose functions just bear the twitch.
        """
        if not math.isfinite(self._roughly(best)):
            return best
        least = self._roughly(best) - _EQUAL
        equal = [one for one in tried if self._roughly(one) > least]
        for one in equal:
            if len(equal) > _MOST_EQUAL:
                break
            beside = (other for other in neighbours(one) if other not in equal)
            equal += [other for other in beside if self._roughly(other) > least]
        most = max(map(self._roughly, equal))
        share = [math.exp(self._roughly(one) - most) for one in equal]
        constant = math.exp(fmean([math.log(one.time_constant) for one in equal], share))
        latency = fmean([one.latency for one in equal], share)
        middle = _moved(best, constant, latency)
        return middle if self._likelihood(middle) > self._likelihood(best) - _EQUAL else best

    def richer(self, basis: LaguerreBasis) -> LaguerreBasis:
        """Return the best basis of more functions if the sensor filters and they show."""
        if self.fit.colour == 1.0:
            return basis
        more = replace(basis, functions=max(basis.functions, _MOST_FUNCTIONS))
        gain = self._likelihood(more) - self._likelihood(basis)
        return self._uphill(more) if gain > _DECISION else basis

    def finer(self, basis: LaguerreBasis) -> LaguerreBasis:
        """Return the best basis of latencies in between, if better beyond doubt."""
        before = basis
        for shift in _FINER:
            best, basis = basis, self._uphill(basis, shift)
            if self._roughly(basis) < self._roughly(best) + _LIVELY_DECISION:
                basis = best
                break
        # at the right latency time constants far apart are equal
        return basis if basis == before else self._middle(basis, [basis])

    def _uphill(self, nearest: LaguerreBasis, shift: float = _SHIFT) -> LaguerreBasis:
        best = None
        while best != nearest:
            best, nearest = nearest, max((nearest, *neighbours(nearest, shift)), key=self._roughly)
        return nearest

    def spread(self, basis: LaguerreBasis, known_ns: int) -> FloatArray:
        """Return how far w on a basis is from that of the bases that are nearly as likely.

        Parameters
        ----------
        basis : LaguerreBasis
            The one.
        known_ns : int
            First sample of all [ns]: if it is before those compared, all tell the steady force.

        Returns
        -------
        ndarray (functions, functions)
            Covariance, as a share of the squared length of w.
        """
        found = {one: self.explained(one, rough).fit for one, rough in self._found}
        best = max(fit.likelihood for fit in found.values())
        if not math.isfinite(best):
            return np.zeros((basis.functions, basis.functions))
        share, linear, areas = [], [], []
        for one, fit in found.items():
            if fit.likelihood > best - 2.0 * _EQUAL:
                share.append(math.exp(fit.likelihood - best))
                full = recruitment(1.0, fit.point.theta[: SUMMATION.start])
                linear.append(full * conversion(one, basis) @ fit.point.linear)
                areas.append(full * one.area @ fit.point.linear)
        weight, values = np.array(share) / sum(share), np.array(linear)
        mean = weight @ values
        here = (self.fit if basis == self.basis else self.explained(basis).fit).point
        area, own = basis.area, recruitment(1.0, here.theta[: SUMMATION.start]) * here.linear
        away = values - own
        if area @ own > 0.0:
            # what a basis has and this one cannot have is no difference of the steady force
            known = self.window.first_ns > known_ns
            more = 0.0 if known else np.array(areas) - area @ own
            away = away - np.outer(away @ area - more, own) / (area @ own)
        return (weight * away.T) @ away / max(float(own @ own), float(mean @ mean), 1e-300)

    def explained(self, basis: LaguerreBasis, rough: bool = False) -> BasisFit:
        """Return how well a basis explains the samples, with a tremor or without.

        The force of a muscle has lines of its own, and so has what a wrong basis leaves: so a
        tremor has to make the samples much likelier.
        """
        key = basis, rough
        if key not in self._found:
            found = self._judged(basis, rough)
            before = self._found.get((basis, True), found)
            # more steps may lead astray
            astray = found.fit.likelihood < before.fit.likelihood - _EQUAL
            self._found[key] = before if astray else found
        return self._found[key]

    def _likelihood(self, basis: LaguerreBasis) -> float:
        return self.explained(basis).fit.likelihood

    def _roughly(self, basis: LaguerreBasis) -> float:
        return self.explained(basis, rough=True).fit.likelihood

    def _near(self, basis: LaguerreBasis, best: LaguerreBasis) -> bool:
        return self._roughly(basis) >= self._roughly(best) - _FAR

    def _judged(self, basis: LaguerreBasis, rough: bool) -> BasisFit:
        fit = self._fitted(self.raw, basis, rough)
        alone = BasisFit(fit, self.raw)
        if self.rates_hz is None or not math.isfinite(fit.likelihood):
            return alone
        muscle = basis, fit.point.theta, fit.point.linear
        # before the window the muscle may have been another
        searched_ns = max(self.window.now_ns - SEARCHED_NS, self.window.first_ns)
        stamp_ns, _, rest = self.raw.rest(*muscle, searched_ns)
        hertz = line_in(stamp_ns, rest, self.rates_hz)
        if hertz == 0.0:
            return alone
        cleaned = self.raw.without(hertz, self.raw.rest(*muscle)[-1])
        without = self._fitted(cleaned, basis, rough)
        if without.likelihood < fit.likelihood + _TREMOR_DECISION:
            return alone
        return BasisFit(without, cleaned, hertz)

    def _fitted(self, raw: RawSamples, basis: LaguerreBasis, rough: bool) -> WindowFit:
        """Return the fit of a basis.

        It begins with the present one.  From a disturbance that is as lively as at present a fit
        does not find its way to a quiet one, nor the other way round, so both are tried.
        """
        present, window = self.fit, self.window
        theta, functions = present.point.theta, basis.functions
        # by sample: blocks begin with the latency, and with other samples left out the likelihoods
        # of two bases are not comparable
        problem, *_ = raw.condensed(
            basis, theta, np.zeros(functions), window.first_ns, left_out=present.left_out
        )
        blocks, first = problem.blocks, problem.first
        nothing = fresh_fit(theta, functions)
        if int(blocks.size[0]) < 2:
            return nothing
        # Blocks end where a pulse begins to act: with the one before, the samples of all bases
        # are the same.
        if first > 0 and blocks.moments[first - 1, COUNT] > 0.0:
            problem = problem._replace(first=first - 1)
        begin_ns = int(blocks.start_ns[problem.first])
        matrix = conversion(self.basis, basis)
        origin = window.origin._replace(linear=matrix @ window.origin.linear)
        window = replace(window, first_ns=begin_ns, origin=origin)
        linear = matrix @ present.point.linear
        alike = replace(
            present,
            point=present.point._replace(linear=linear),
            levels=present.levels.copy(),
            likelihood=-math.inf,
            left_out=NO_EVENTS,
        )
        trials = [alike]
        if present.scales.lively >= LIVELY and not rough:
            trials.append(nothing)
        for one in trials:
            # likelihoods are comparable only if all weight the samples alike
            one.most_inflation, one.colour = 1.0, present.colour
            steps = _ROUGH_STEPS if rough else _STEPS
            gauss_newton_steps(problem, one, self.knowledge, window, steps)
        return max(trials, key=lambda one: one.likelihood)


# Since a response shows; later with this period [s].
_CHOICES_S = (1.0, 3.0, 7.0, 16.0, 32.0)
_PERIOD_S = 32.0
# Where all seems well it is compared with its neighbours only, but so often with all that people
# have.  Where residuals are alike or the disturbance is lively it is compared sooner, and then
# each time after twice the time: what no basis explains is not the basis.
_GRIDS = 4
_AGAIN_NS = 3 * NANOSECONDS_PER_SECOND
_LONGEST_WAIT = 4
# After the first pulse, if no response shows.
_UNSEEN_NS = 2 * NANOSECONDS_PER_SECOND
_NEVER_NS = -(2**62)


class BasisSchedule:
    """Says when the basis is to be compared with others, and with which.

    Attributes
    ----------
    begun_ns : int or None
        Since when a response shows, or has to be looked at anew [ns].
    """

    def __init__(self) -> None:
        self.begun_ns: int | None = None
        self._stimulated_ns: int | None = None
        self._compared_ns = _NEVER_NS
        self._choices = self._in_vain = 0

    def begin(self, now_ns: int) -> None:
        """Take note of a response that shows from now on [ns]."""
        self.begun_ns, self._choices = now_ns, 0

    def forget(self) -> None:
        """Forget response and stimulation, but not how often bases were compared."""
        self.begun_ns = self._stimulated_ns = None
        self._compared_ns = _NEVER_NS

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Take note of pulses (pulses,) [ns, 1]: of the first that stimulates."""
        if self._stimulated_ns is None and intensity.any():
            self._stimulated_ns = int(onset_ns[(intensity > 0.0).argmax()])

    def due(self, now_ns: int, misfit: bool) -> bool | None:
        """Return whether to compare with all bases, not neighbours alone, now; None: not to.

        Parameters
        ----------
        now_ns : int
            Newest stamp [ns].
        misfit : bool
            Whether neighbouring residuals are alike, or the disturbance takes them up.
        """
        since_ns = self.begun_ns
        if since_ns is None and self._stimulated_ns is not None:
            # with a basis that does not fit a response may not show
            since_ns = self._stimulated_ns + _UNSEEN_NS
        if since_ns is None:
            return None
        seconds = (now_ns - since_ns) / NANOSECONDS_PER_SECOND
        done = self._choices
        due = _CHOICES_S[done] if done < len(_CHOICES_S) else _PERIOD_S * (done - 3)
        if not misfit:
            self._in_vain = 0
        if seconds >= due:
            self._choices += 1
        elif not misfit or now_ns < self._compared_ns + (_AGAIN_NS << self._in_vain):
            return None
        else:
            # not in vain while there are too few samples to tell a tremor from the muscle
            late = seconds > _CHOICES_S[3]
            self._in_vain = min(self._in_vain + 1, _LONGEST_WAIT) if late else 0
        self._compared_ns = now_ns
        return done < _GRIDS or misfit
