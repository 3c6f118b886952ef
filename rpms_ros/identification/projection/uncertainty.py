# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""Uncertainty of an estimate: covariance of [theta, w], intervals of what depends on them.

The covariance is ``s^2 (M + C)^-1`` with M the Gauss-Newton matrix of the joint problem and C that
of prior and arrival cost.  ``s^2`` is the variance of the residuals, times the factor by which
sums of neighbouring residuals vary more than those of white noise: drift, an artifact or a misfit
of the basis correlate neighbouring residuals, and then a sample informs less than an independent
one.
"""

from dataclasses import dataclass
from dataclasses import replace

import numpy as np
from scipy.special import ndtri

from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.fit import weak_ridge
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.projection.problem import Prior
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

_ROUNDING = 1e-12
# Lengths over which residuals are summed to find their correlation [ns].
_BLOCK_NS = (100_000_000, 500_000_000, 2_000_000_000)
# Error of theta, alpha as logarithms, where the area of the response is wrong by all of it.
_TAKEN_UP: FloatArray = np.array([0.1, 0.1, 1.0, 1.0])
SHORTEST_CELL_NS = _BLOCK_NS[0]
"""Shortest of them [ns]."""


def residual_spread(start_ns: IntArray, count: FloatArray, sums: FloatArray) -> FloatArray:
    """Return, for some lengths, the mean of (sum of residuals)^2 / samples in blocks [N^2].

    For white residuals each is their variance; where they are correlated it is larger, by the
    factor by which a naive covariance is too small.

    Parameters
    ----------
    start_ns, count, sums : ndarray (blocks,)
        Begin, number of samples and sum of the residuals of consecutive blocks.
    """
    spread = np.zeros(len(_BLOCK_NS))
    for place, length in enumerate(_BLOCK_NS):
        begins = np.flatnonzero(np.diff(start_ns // length)) + 1
        begins = np.concatenate(([0], begins))
        samples = np.add.reduceat(count, begins)
        inside = np.add.reduceat(sums, begins)
        some = samples > 0.0
        if some.any():
            spread[place] = float(np.mean(inside[some] ** 2 / samples[some]))
    return spread


@dataclass(frozen=True)
class Uncertainty:
    """Gaussian uncertainty of [theta, w], alpha as logarithms.

    Attributes
    ----------
    covariance : ndarray (4 + functions, 4 + functions)
        Of theta and w.
    theta : ndarray (4,)
        Parameters at which it is expanded.
    confidence : float
        Level of the intervals.
    """

    covariance: FloatArray
    theta: FloatArray
    confidence: float

    @property
    def parameter_covariance(self) -> FloatArray:
        """Covariance of u_thr, u_sat, alpha_sat, alpha_thr themselves (4, 4)."""
        scale = np.concatenate((np.ones(2), self.theta[2:]))
        part = self.covariance[:PARAMETERS, :PARAMETERS]
        result: FloatArray = part * np.outer(scale, scale)
        return result

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations of theta, alpha as logarithms (4,)."""
        result: FloatArray = np.sqrt(np.diag(self.covariance)[:PARAMETERS])
        return result

    @property
    def quantile(self) -> float:
        """Half width of an interval in standard deviations."""
        return float(ndtri(0.5 + 0.5 * self.confidence))

    def with_misfit(self, share: float, deviation: FloatArray) -> 'Uncertainty':
        """Return the uncertainty where the response is wrong by a share of its area.

        The recruitment takes up a part of what the response lacks.  No standard deviation exceeds
        that of the prior, `deviation` (4,).
        """
        own = np.diag(self.covariance)[:PARAMETERS]
        most = np.maximum(deviation**2 - own, 0.0)
        covariance = self.covariance.copy()
        place = np.arange(PARAMETERS)
        covariance[place, place] += np.minimum((share * _TAKEN_UP) ** 2, most)
        return replace(self, covariance=covariance)

    def half_width(self, gradient: FloatArray, misfit: FloatArray | float = 0.0) -> FloatArray:
        """Return half the interval (n,) of quantities with this gradient (n, 4 + functions).

        `misfit` is the standard deviation (n,) of the error of the model itself.
        """
        variance = np.einsum('ij,jk,ik->i', gradient, self.covariance, gradient)
        width: FloatArray = self.quantile * np.sqrt(np.maximum(variance, 0.0) + misfit**2)
        return width


def uncertainty(
    fit: Fit, prior: Prior, spread: FloatArray, confidence: float
) -> Uncertainty | None:
    """Return the uncertainty of a fit whose equations are complete.

    Parameters
    ----------
    fit, prior : Fit, Prior
        State of the estimator.
    spread : ndarray (lengths,)
        See `residual_spread` [N^2].
    confidence : float
        Level of the intervals.

    Returns
    -------
    Uncertainty or None
        None while there is no sample.
    """
    if not fit.samples[0] > 0.0:
        return None
    joint = len(prior.reference)
    lower = np.tril(fit.complete)
    matrix = lower + lower.T - np.diag(np.diag(lower))
    matrix[:joint, :joint] += prior.information
    variance = float(fit.variance[0])
    theta = np.arange(PARAMETERS)
    matrix[theta, theta] += variance / prior.deviation**2
    linear = np.arange(PARAMETERS, len(matrix))
    matrix[linear, linear] += weak_ridge(fit)
    scale = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(scale, scale) + _ROUNDING * np.eye(len(matrix))
    inverse = np.linalg.inv(scaled) / np.outer(scale, scale)
    together = max(1.0, float(spread.max(initial=0.0)) / variance)
    inverse = 0.5 * (inverse + inverse.T) * variance
    inverse[PARAMETERS:] *= np.sqrt(together)
    inverse[:, PARAMETERS:] *= np.sqrt(together)
    inverse = _inflate_parameters(inverse, prior, together)
    return Uncertainty(inverse[:joint, :joint], fit.theta.copy(), confidence)


def _inflate_parameters(covariance: FloatArray, prior: Prior, factor: float) -> FloatArray:
    """Inflate the covariance of theta, each deviation at most to that of the prior."""
    deviation = np.sqrt(np.maximum(np.diag(covariance)[:PARAMETERS], 0.0))
    most = np.maximum(prior.deviation / np.maximum(deviation, 1e-300), 1.0)
    scale = np.ones(len(covariance))
    scale[:PARAMETERS] = np.minimum(np.sqrt(factor), most)
    result: FloatArray = covariance * np.outer(scale, scale)
    return result
