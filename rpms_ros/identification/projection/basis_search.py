# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Latency and time constant of the basis of a whole recording, by how well it is explained.

Seven Laguerre functions describe a twitch whose time constant is not far from their own, and none
that begins before their latency.  All bases have as many unknowns, so the one that leaves the
least of the force unexplained is the most likely one.  They lie on a lattice, and the search ends
at the same point of it wherever it began.
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
"""Point of the lattice: steps of the time constant and of the latency from those of the start."""

# 38 ms times 1.5^(k / 4): 5 to 105 ms; 8 ms and j / 4 ms: 0 to 35 ms.
_RATIO = 1.5**0.25
_SHIFT = 0.25e-3
_FASTEST, _SLOWEST = -20, 10
_SOONEST, _LATEST = -32, 108
_COARSE = tuple((k, j) for k in range(-16, 11, 4) for j in (-32, -16, 0, 20, 44, 72))
# A slower basis that begins earlier is much like a faster one that begins later.
_STRIDES = (
    *((1, 0), (-1, 0), (0, 1), (0, -1), (0, 2), (0, -2), (0, 8), (0, -8)),
    *((3, 0), (-3, 0), (1, -2), (-1, 2), (3, -1), (-3, 1), (3, 1), (-3, -1)),
)
# Another basis has to be this much better than that of the start [nat].
_DECISION = 15.0
_STEPS = 6
_TOLERANCE = 1e-3
_DAMPING = 1e-2
# Of the energy of the force: what is explained better than that is explained.
_LEAST_SHARE = 1e-9


def basis_at(start: LaguerreBasis, place: Place) -> LaguerreBasis:
    """Return the basis at a point of the lattice around `start`."""
    time_constant = start.time_constant * _RATIO ** place[0]
    return LaguerreBasis(start.functions, time_constant, start.latency + _SHIFT * place[1])


class BasisSearch:
    """Search for the basis that explains a part of a recording best.

    Parameters
    ----------
    record : SampleRecord
        The recording.
    part : Part
        What is explained.
    start : LaguerreBasis
        Middle of the lattice.
    theta : ndarray (4,)
        Where the nonlinear parameters begin.
    prior : Prior
        What is known besides.
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
        """Return the best point, going downhill from one, or from the best of a coarse grid."""
        if everywhere:
            place = min((place, *_COARSE), key=self._unexplained)
        while True:
            around = [(place[0] + k, place[1] + j) for k, j in _STRIDES]
            nearest = min((place, *filter(self._has, around)), key=self._unexplained)
            if nearest == place:
                break
            place = nearest
        start = (0, 0)
        gain = self._unexplained(start) - self._unexplained(place)
        return place if gain > _DECISION else start

    def _has(self, place: Place) -> bool:
        """Return whether a point is one of the lattice."""
        k, j = place
        sooner = self._start.latency + _SHIFT * j
        return _FASTEST <= k <= _SLOWEST and _SOONEST <= j <= _LATEST and sooner > -1e-12

    def _unexplained(self, place: Place) -> float:
        """Return minus the log-likelihood of a point, but for a constant [nat]."""
        if place not in self._found:
            self._found[place] = self._fitted(basis_at(self._start, place))
        return self._found[place]

    def _fitted(self, basis: LaguerreBasis) -> float:
        problem, _, _ = self._record.condensed(basis, self._prior, self._baseline, [self._part])
        # the force of pulses before the part is not known well enough
        knots = self._baseline.knots
        fit, trial = (empty_fit(self._theta, basis.functions, knots) for _ in range(2))
        fit.damping[0] = _DAMPING
        fit_linear(problem, fit, True)
        fit_linear(problem, fit, True)
        improve(problem, fit, trial, _STEPS, _TOLERANCE, False)
        samples, energy = float(fit.samples[0]), float(fit.energy[0])
        least = _LEAST_SHARE * energy + np.finfo(np.float64).tiny
        return 0.5 * samples * math.log(float(fit.squares[0]) + least)
