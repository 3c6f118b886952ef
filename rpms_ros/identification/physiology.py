r"""Twitch parameters read off an identified response: time constant, latency, order, gain.

The twitch of Eq. (2) behind a latency is fitted to the coefficients of the basis, not to the
curve that they draw: ``min (w - P m(p))^T (C + e^2 I)^-1 (w - P m(p))`` with P the projection on
the basis, C the coefficients' covariance and e a share of their length that the basis may miss.
So every direction counts as much as the data know it.  Time constant, latency and order pull
the response in similar ways; a prior as wide as people differ (Tables 1 and 2) keeps the answer
physiological where the data leave it open, and the intervals say how far they do.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rpms_ros.identification.laguerre import LaguerreBasis
from rpms_ros.pulses import FloatArray

PHYSIOLOGY_NAMES = ('twitch_time_constant_s', 'latency_s', 'order', 'twitch_peak_n')
_CENTRE = np.array([38e-3, 9.5e-3, 3.0])
_DEVIATION = np.array([15e-3, 8e-3, 0.7])
PRIOR: Mapping[str, tuple[float, float]] = dict(
    zip(PHYSIOLOGY_NAMES, zip(_CENTRE.tolist(), _DEVIATION.tolist(), strict=True), strict=False)
)
"""Mean and standard deviation of what people have, by name; the peak has none."""
# For a basis that was chosen by the samples: any muscle.
_WIDE_DEVIATION = np.array([60e-3, 20e-3, 1.0])
_LOWER = np.array([8e-3, 0.0, 1.5])
_UPPER = np.array([0.15, 60e-3, 6.0])
# Stands for the time before the onset, where the twitch is nothing [T_a].
_NOTHING = 1e-12
# What the basis may miss of a response, relative to its length.
MISFIT = 1e-3
_ITERATIONS = 15


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
        Hardly prefer twitches as people mostly have them.
    """

    basis: LaguerreBasis
    step: float = 4e-3
    wide: bool = False

    @cached_property
    def _deviation(self) -> FloatArray:
        return _WIDE_DEVIATION if self.wide else _DEVIATION

    @cached_property
    def _grid(self) -> FloatArray:
        step = min(self.step, self.basis.time_constant / 10.0)
        return np.arange(step / 2, self.basis.duration, step)

    @cached_property
    def _projection(self) -> FloatArray:
        values = self.basis.evaluate(self._grid)
        return np.asarray(np.linalg.pinv(values), dtype=np.float64)

    def read(self, response: FloatArray, covariance: FloatArray) -> Physiology | None:
        """Fit the twitch.

        Parameters
        ----------
        response, covariance : ndarray (functions,), (functions, functions)
            Coefficients of the response at full intensity, and their covariance.

        Returns
        -------
        Physiology or None
            None if the response is not known to differ from nothing.
        """
        length = float(np.linalg.norm(response))
        if not length > 2.0 * float(np.sqrt(max(np.trace(covariance), 0.0))):
            return None
        noise = covariance + (MISFIT * length) ** 2 * np.eye(len(response))
        whiten = np.linalg.inv(np.linalg.cholesky(noise))
        target = whiten @ response
        fits = [self._fit(start, whiten, target) for start in self._starts()]
        shape, peak, _ = min(fits, key=lambda fit: fit[2])
        jacobian, _ = self._equations(shape, peak, whiten, target)
        inverse = np.linalg.inv(jacobian.T @ jacobian + 1e-12 * np.eye(4))
        return Physiology(np.append(shape, peak), np.sqrt(np.maximum(np.diag(inverse), 0.0)))

    def _starts(self) -> list[FloatArray]:
        """Return the shapes (3,) from which fits begin."""
        if not self.wide:
            return [_CENTRE.copy()]
        constant, latency = self.basis.time_constant, self.basis.latency
        return [np.array([constant, latency + 1e-3, order]) for order in (2.2, 3.0, 4.0)]

    def _fit(
        self, start: FloatArray, whiten: FloatArray, target: FloatArray
    ) -> tuple[FloatArray, float, float]:
        """Return shape (3,), peak and cost of the best twitch near a start (3,)."""
        shape = np.clip(start, _LOWER, _UPPER)
        cost, peak = self._match(shape, whiten, target)
        damping = 1e-4
        for _ in range(_ITERATIONS):
            jacobian, residual = self._equations(shape, peak, whiten, target)
            matrix = jacobian.T @ jacobian
            right = jacobian.T @ residual
            step = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), right)
            candidate = np.clip(shape + step[:3], _LOWER, _UPPER)
            new_cost, new_peak = self._match(candidate, whiten, target)
            if new_cost <= cost:
                done = cost - new_cost < 1e-4 * (cost + 1.0)
                shape, peak, cost = candidate, new_peak, new_cost
                damping *= 0.1
                if done:
                    break
            else:
                damping = max(10.0 * damping, 1e-6)
        return shape, peak, cost

    def _model(self, shape: FloatArray) -> FloatArray:
        """Return the coefficients of a twitch of peak 1 and of its derivatives (functions, 4).

        With ``x = (t - T_1) / T_a`` and ``k = n - 1`` the twitch is ``(x/k)^k e^(k - x)``; its
        derivatives by x and k are ``k/x - 1`` and ``log(x/k)`` times itself.
        """
        time_constant, latency, order = (float(value) for value in shape)
        power = order - 1.0
        scaled = np.maximum((self._grid - latency) / time_constant, _NOTHING)
        logarithm = np.log(scaled / power)
        force = np.exp(power * (logarithm + 1.0) - scaled)
        by_scaled = force * (power / scaled - 1.0)
        columns = (force, -by_scaled * scaled / time_constant, -by_scaled / time_constant)
        result: FloatArray = self._projection @ np.column_stack((*columns, force * logarithm))
        return result

    def _match(
        self, shape: FloatArray, whiten: FloatArray, target: FloatArray
    ) -> tuple[float, float]:
        """Return cost and best peak of a shape."""
        model = whiten @ self._model(shape)[:, 0]
        peak = float(model @ target) / max(float(model @ model), 1e-300)
        residual = target - peak * model
        away = (shape - _CENTRE) / self._deviation
        return float(residual @ residual + away @ away), peak

    def _equations(
        self, shape: FloatArray, peak: float, whiten: FloatArray, target: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return Jacobian (functions + 3, 4) and residual (functions + 3,), prior included."""
        model = whiten @ self._model(shape)
        data = np.column_stack((peak * model[:, 1:], model[:, 0]))
        prior = np.column_stack((np.diag(1.0 / self._deviation), np.zeros(3)))
        residual = target - peak * model[:, 0]
        return np.vstack((data, prior)), np.append(residual, (_CENTRE - shape) / self._deviation)
