# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Twitch parameters from an identified response: time constant, latency, order, peak.

The twitch of Eq. (2) behind a latency is fitted to the coefficients of the basis:
``min (w - P m(p))^T (C + e^2 I)^-1 (w - P m(p))`` with P the projection on the basis, C the
covariance of the coefficients and e the error of the basis, as a share of their norm.  Each
direction has the weight of its information.  Time constant, latency and order have similar effects
on the response; a prior as wide as people differ (Tables 1 and 2) keeps them physiological where
the data do not separate them, and the intervals show it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rpms_ros.identification.laguerre import LaguerreBasis
from rpms_ros.identification.twitch_match import Coefficients
from rpms_ros.identification.twitch_match import TwitchPrior
from rpms_ros.identification.twitch_match import match_twitch
from rpms_ros.pulses import FloatArray

PHYSIOLOGY_NAMES = ('twitch_time_constant_s', 'latency_s', 'order', 'twitch_peak_n')
_PEOPLE = TwitchPrior(
    centre=np.array([38e-3, 9.5e-3, 3.0]),
    deviation=np.array([15e-3, 8e-3, 0.7]),
    lower=np.array([8e-3, 0.0, 1.5]),
    upper=np.array([0.15, 60e-3, 6.0]),
)
PRIOR: Mapping[str, tuple[float, float]] = dict(
    zip(
        PHYSIOLOGY_NAMES,
        zip(_PEOPLE.centre.tolist(), _PEOPLE.deviation.tolist(), strict=True),
        strict=False,
    )
)
"""Mean and standard deviation among people, by name; none for the peak."""
# Prior with a basis that was chosen by the samples.
_WIDE_DEVIATION = np.array([60e-3, 20e-3, 1.0])
# Error of the basis, relative to the norm of the coefficients.
MISFIT = 1e-3


@dataclass(frozen=True)
class Physiology:
    """Numbers of `PHYSIOLOGY_NAMES` and their standard deviations, (4,) each."""

    values: FloatArray
    deviations: FloatArray


@dataclass(frozen=True)
class TwitchReader:
    """Reads the twitch off coefficients of a basis.

    Attributes
    ----------
    basis : LaguerreBasis
        The basis.
    step : float
        Grid on which twitches are projected [s].
    wide : bool
        Use a wide prior around the basis instead of that of `PRIOR`.
    """

    basis: LaguerreBasis
    step: float = 4e-3
    wide: bool = False

    @cached_property
    def _prior(self) -> TwitchPrior:
        if not self.wide:
            return _PEOPLE
        centre = np.array([self.basis.time_constant, self.basis.latency + 1e-3, 3.0])
        centre = np.clip(centre, _PEOPLE.lower, _PEOPLE.upper)
        return _PEOPLE._replace(centre=centre, deviation=_WIDE_DEVIATION)

    @cached_property
    def _grid(self) -> FloatArray:
        finest = self.basis.time_constant / 10.0
        step = min(self.step, finest) if self.wide else self.step
        return np.arange(step / 2, self.basis.duration, step)

    @cached_property
    def _projection(self) -> FloatArray:
        values = self.basis.evaluate(self._grid)
        return np.asarray(np.linalg.pinv(values), dtype=np.float64)

    def read(
        self, response: FloatArray, covariance: FloatArray, misfit: float = MISFIT
    ) -> Physiology | None:
        """Fit the twitch.

        Parameters
        ----------
        response, covariance : ndarray (functions,), (functions, functions)
            Coefficients of the response at full intensity, and their covariance.
        misfit : float
            Error of the basis, relative to the norm of the coefficients.

        Returns
        -------
        Physiology or None
            None if the response does not differ from zero by two standard deviations.
        """
        length = float(np.linalg.norm(response))
        if not length > 2.0 * float(np.sqrt(max(np.trace(covariance), 0.0))):
            return None
        noise = covariance + (misfit * length) ** 2 * np.eye(len(response))
        whiten = np.linalg.inv(np.linalg.cholesky(noise))
        found = Coefficients(self._grid, whiten @ self._projection, whiten @ response, self._prior)
        match = match_twitch(found)
        jacobian = np.column_stack((match.peak * match.columns[:, 1:], match.columns[:, 0]))
        information = jacobian.T @ jacobian
        information[:3, :3] += np.diag(self._prior.deviation**-2)
        inverse = np.linalg.inv(information + 1e-12 * np.eye(4))
        deviations = np.sqrt(np.maximum(np.diag(inverse), 0.0))
        return Physiology(np.append(match.theta, match.peak), deviations)
