# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Choice of latency and time constant of the basis by how well a recording is explained.

Seven Laguerre functions describe a twitch whose time constant is not far from their own and which
does not begin before their latency.  All bases have as many unknowns, so the one with the smallest
residual is the most likely one; of those that only the noise tells apart the middle is taken.
They are the points of a grid.
"""

import math

import numpy as np

from rpms_ros.identification.laguerre import LaguerreBasis
from rpms_ros.identification.projection.fit import empty_fit
from rpms_ros.identification.projection.fit import fit_linear
from rpms_ros.identification.projection.problem import BaselineKnots
from rpms_ros.identification.projection.problem import Prior
from rpms_ros.identification.projection.sample_record import Part
from rpms_ros.identification.projection.sample_record import SampleRecord
from rpms_ros.identification.projection.step import improve
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray

Place = tuple[int, int]
"""Point of the grid: steps of the time constant and of the latency from those of the start."""

# 38 ms times 1.5^(k / 4): 5 to 105 ms; 8 ms and j / 4 ms: 0 to 35 ms.
_RATIO = 1.5**0.25
_SHIFT = 0.25e-3
_FASTEST, _SLOWEST = -20, 10
_SOONEST, _LATEST = -32, 108
_COARSE = tuple((k, j) for k in range(-16, 11, 4) for j in (-32, -16, 0, 20, 44, 72))
# Steps of the search; a slower basis that begins earlier resembles a faster one that begins later.
_STRIDES = (
    *((1, 0), (-1, 0), (0, 1), (0, -1), (0, 2), (0, -2), (0, 8), (0, -8)),
    *((3, 0), (-3, 0), (1, -2), (-1, 2), (3, -1), (-3, 1), (3, 1), (-3, -1)),
)
# Points whose log-likelihoods differ by less are told apart by the noise alone [nat].
_EQUAL = 6.0
# How far the latency follows from one time constant to the next.
_FOLLOWED = (0, -1, 1, -2, 2, -4, 4)
# Latencies are compared step by step up to this distance, and then in strides: the edges of a wide
# range need not be known to a step.
_FINE, _STRIDE = 8, 4
_STEPS = 6
_TOLERANCE = 1e-3
_DAMPING = 1e-2
# Residuals below this share of the energy of the force are not distinguished.
_LEAST_SHARE = 1e-9


def basis_at(start: LaguerreBasis, place: Place) -> LaguerreBasis:
    """Return the basis at a point of the grid around `start`."""
    time_constant = start.time_constant * _RATIO ** place[0]
    return LaguerreBasis(start.functions, time_constant, start.latency + _SHIFT * place[1])


def _between(low: int, high: int, first: int, last: int, best: int) -> int:
    """Return the middle of what is equal from `low` to `high`; that of the start if all is."""
    if low - first < _STRIDE and last - high < _STRIDE:
        return 0
    # of two, none is at an edge
    return (low + high + 1) // 2 if high - low > 1 else best


class BasisSearch:
    """Search for the basis that explains a part of a recording best.

    Parameters
    ----------
    record : SampleRecord
        The recording.
    part : Part
        The part that is fitted.
    start : LaguerreBasis
        Basis at the point (0, 0) of the grid.
    theta : ndarray (4,)
        Start of the nonlinear parameters.
    prior : Prior
        Prior and bounds.
    knot_spacing : float
        Distance of the baseline's knots [s].
    """

    def __init__(
        self,
        record: SampleRecord,
        part: Part,
        start: LaguerreBasis,
        theta: FloatArray,
        prior: Prior,
        knot_spacing: float,
    ) -> None:
        self._record, self._part, self._start = record, part, start
        self._theta, self._prior = theta, prior
        first_ns, last_ns = record.span_ns(part)
        intervals = max(round((last_ns - first_ns) / NANOSECONDS_PER_SECOND / knot_spacing), 1)
        spacing_ns = max(-(-(last_ns - first_ns) // intervals), 1)
        self._baseline = BaselineKnots(intervals + 1, first_ns, spacing_ns)
        self._found: dict[Place, float] = {}

    def best(self, place: Place, everywhere: bool) -> Place:
        """Return the middle of the best points found from `place`.

        With `everywhere` the search begins at the best of a coarse grid too.
        """
        if everywhere:
            place = min((place, *_COARSE), key=self._unexplained)
        while True:
            around = [(place[0] + k, place[1] + j) for k, j in _STRIDES]
            nearest = min((place, *filter(self._has, around)), key=self._unexplained)
            if nearest == place:
                break
            place = nearest
        return self._middle(place)

    def _middle(self, best: Place) -> Place:
        """Return the point in the middle of those that are as good as the best.

        A slow change of intensity tells little of the dynamics, and the best of many points that
        are nearly equal is one at the edge as often as not, whose functions just bear the twitch.
        First the middle of the time constants, then that of the latencies there; if all of them
        are equal, that of the start.
        """
        most = self._unexplained(best) + _EQUAL
        found = {best[0]: best[1]}
        for step in (-1, 1):
            place = best
            while True:
                beside = [(place[0] + step, place[1] + j) for j in _FOLLOWED]
                place = min(filter(self._has, beside), key=self._unexplained, default=best)
                if place == best or self._unexplained(place) > most:
                    break
                found[place[0]] = place[1]
        constant = _between(min(found), max(found), _FASTEST, _SLOWEST, best[0])
        low, high = (self._last_latency(constant, found[constant], way, most) for way in (-1, 1))
        soonest = next(j for j in range(_SOONEST, 1) if self._has((constant, j)))
        return constant, _between(low, high, soonest, _LATEST, found[constant])

    def _last_latency(self, constant: int, latency: int, way: int, most: float) -> int:
        """Return the last latency on the way that is as good."""
        distance = 0
        while True:
            further = distance + (1 if distance < _FINE else _STRIDE)
            place = (constant, latency + way * further)
            if not self._has(place) or self._unexplained(place) > most:
                return latency + way * distance
            distance = further

    def _has(self, place: Place) -> bool:
        """Return whether the grid has a point."""
        k, j = place
        sooner = self._start.latency + _SHIFT * j
        return _FASTEST <= k <= _SLOWEST and _SOONEST <= j <= _LATEST and sooner > -1e-12

    def _unexplained(self, place: Place) -> float:
        """Return minus the log-likelihood of a point, without a constant [nat]."""
        if place not in self._found:
            self._found[place] = self._fitted(basis_at(self._start, place))
        return self._found[place]

    def _fitted(self, basis: LaguerreBasis) -> float:
        problem, _, _ = self._record.condensed(basis, self._prior, self._baseline, [self._part])
        # the force of pulses before the part is unknown
        knots = self._baseline.knots
        fit, trial = (empty_fit(self._theta, basis.functions, knots) for _ in range(2))
        fit.damping[0] = _DAMPING
        fit_linear(problem, fit, True)
        fit_linear(problem, fit, True)
        improve(problem, fit, trial, _STEPS, _TOLERANCE, False)
        samples, energy = float(fit.samples[0]), float(fit.energy[0])
        least = _LEAST_SHARE * energy + np.finfo(np.float64).tiny
        return 0.5 * samples * math.log(float(fit.squares[0]) + least)
