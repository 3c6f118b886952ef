# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A train as superposed twitches (Eq. 6): equal pulses, a gain a pulse, or a law of its history.

Each train has its own latency, T_a, gain and baseline.  For given (latency, T_a) gain and baseline
follow from linear equations; a least-squares problem in two dimensions remains.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import least_squares
from scipy.optimize import nnls

from rpms_ros.identification.analysis.responses import Response
from rpms_ros.muscle import twitch
from rpms_ros.pulses import FloatArray

# latency [s], time constant [s] -> force in gains, shape (samples,)
TrainShape = Callable[[float, float], FloatArray]

LOWEST = (0.0, 1e-3)
HIGHEST = (0.06, 0.2)
_TIME_SCALE = 1e-3
STARTS = (0.005, 0.010, 0.020, 0.040)


@dataclass(frozen=True)
class TrainFit:
    """A model fitted to one train.

    Attributes
    ----------
    model : str
        ``equal pulses``, ``gain a pulse`` or ``history law``.
    fit : float
        100 (1 - |F - F^| / |F - mean F|) [%].
    latency, time_constant : float
        Of its twitches [s].
    gains : ndarray, shape (pulses,) or (1,)
        Peak force of the twitch of each pulse or of all [N]; G of the history law.
    baseline : float
        Force at rest [N].
    modelled : ndarray, shape (samples,)
        Force of the model [N].
    """

    model: str
    fit: float
    latency: float
    time_constant: float
    gains: FloatArray
    baseline: float
    modelled: FloatArray


def fit_percent(measured: FloatArray, modelled: FloatArray) -> float:
    """Return 100 (1 - |F - F^| / |F - mean F|), the normalised fit [%]."""
    spread = float(np.linalg.norm(measured - measured.mean()))
    return 100.0 * (1.0 - float(np.linalg.norm(measured - modelled)) / max(spread, 1e-300))


def pulse_twitches(response: Response, order: int, latency: float, constant: float) -> FloatArray:
    """Return the twitch of every pulse, with peak 1 (samples, pulses)."""
    return twitch(response.lag[:, None] - response.onset - latency, constant, order)


def fit_equal(response: Response, order: int) -> TrainFit:
    """Fit a train whose pulses all have the same twitch (Eq. 6)."""

    def shape(latency: float, constant: float) -> FloatArray:
        total: FloatArray = pulse_twitches(response, order, latency, constant).sum(axis=1)
        return total

    return fit_scaled('equal pulses', response, shape)


def fit_scaled(model: str, response: Response, shape: TrainShape) -> TrainFit:
    """Fit latency, time constant, one gain and a baseline of a shape to a train."""

    def residual(theta: FloatArray) -> FloatArray:
        force = response.force[response.usable]
        gain, base, force_of = _scaled(shape(*theta)[response.usable], force)
        del gain, base
        return force - force_of

    theta = _best(residual)
    whole = shape(*theta)
    gain, base, _ = _scaled(whole[response.usable], response.force[response.usable])
    return _result(model, response, theta, np.array([gain]), base, base + gain * whole)


def deviations(
    model: Callable[[FloatArray], FloatArray],
    at: FloatArray,
    residual: FloatArray,
    prior: FloatArray,
) -> FloatArray:
    """Return the standard deviations of the numbers of a model (numbers,).

    Parameters
    ----------
    model : callable
        Force (samples,) of the numbers (numbers,), linear ones included.
    at : ndarray (numbers,)
        The fitted parameters; nonlinear ones not 0.
    residual : ndarray (samples,)
        Measured minus modelled force [N].
    prior : ndarray (numbers,)
        Information of the prior, in units of the residual's variance.

    Notes
    -----
    A misfit of the model correlates neighbouring residuals: the variance is multiplied by the sum
    of their correlations up to the first that is not positive, as for a mean of such residuals.
    """
    steps = 1e-4 * np.maximum(np.abs(at), 1e-3)
    jacobian = np.column_stack(
        [
            (model(at + step * unit) - model(at - step * unit)) / (2.0 * step)
            for step, unit in zip(steps, np.eye(len(at)), strict=True)
        ]
    )
    spare = max(1, len(residual) - len(at))
    variance = float(residual @ residual) / spare * _correlated(residual)
    matrix = jacobian.T @ jacobian + np.diag(prior)
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse = np.linalg.pinv(matrix / np.outer(scale, scale)) / np.outer(scale, scale)
    found: FloatArray = np.sqrt(np.maximum(np.diag(inverse), 0.0) * variance)
    return found


def _correlated(residual: FloatArray) -> float:
    """Return 1 + 2 (r(1) + r(2) + ...), up to the first correlation that is not positive."""
    centred = residual - residual.mean()
    power = float(centred @ centred)
    if not power > 0.0:
        return 1.0
    length = 2 * len(centred)
    spectrum = np.abs(np.fft.rfft(centred, length)) ** 2
    correlation = np.fft.irfft(spectrum, length)[: len(centred)] / power
    ends = np.flatnonzero(correlation <= 0.0)
    last = int(ends[0]) if len(ends) else len(correlation)
    return float(1.0 + 2.0 * correlation[1:last].sum())


def fit_deviations(response: Response, fit: TrainFit, order: int) -> FloatArray:
    """Return the standard deviations of latency and T_a (2,) of a fit with equal pulses [s]."""
    chosen = response.usable

    def model(numbers: FloatArray) -> FloatArray:
        latency, constant, gain, base = numbers
        columns = pulse_twitches(response, order, latency, constant)
        total: FloatArray = base + gain * columns.sum(axis=1)
        return total[chosen]

    at = np.array([fit.latency, fit.time_constant, float(fit.gains[0]), fit.baseline])
    residual = (response.force - fit.modelled)[chosen]
    return deviations(model, at, residual, np.zeros(len(at)))[:2]


def fit_gains(response: Response, order: int, start: TrainFit) -> TrainFit:
    """Fit a train with one gain a pulse, none of them negative.

    Parameters
    ----------
    response : Response
        The train.
    order : int
        Order of the twitches.
    start : TrainFit
        Fit with equal pulses, where the search begins.
    """
    force = response.force[response.usable]

    def gains(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        columns = pulse_twitches(response, order, theta[0], theta[1])
        ones = np.ones((len(columns), 1))
        # the baseline may have either sign: a column and its negative
        design = np.hstack((columns, ones, -ones))
        return nnls(design[response.usable], force)[0], design

    def residual(theta: FloatArray) -> FloatArray:
        found, design = gains(theta)
        return force - design[response.usable] @ found

    begin = np.clip([start.latency, start.time_constant], LOWEST, HIGHEST)
    theta = _search(residual, begin)
    found, design = gains(theta)
    base = float(found[-2] - found[-1])
    return _result('gain a pulse', response, theta, found[:-2], base, design @ found)


def _scaled(shape: FloatArray, force: FloatArray) -> tuple[float, float, FloatArray]:
    """Return gain, baseline and force of the best line through a shape."""
    centred = shape - shape.mean()
    power = float(centred @ centred)
    gain = float(centred @ force) / power if power > 0 else 0.0
    base = float(force.mean() - gain * shape.mean())
    return gain, base, base + gain * shape


def _search(residual: Callable[[FloatArray], FloatArray], start: FloatArray) -> FloatArray:
    inside = np.clip(start, np.array(LOWEST) + 1e-6, np.array(HIGHEST) - 1e-6)
    found = least_squares(
        residual, inside, bounds=(LOWEST, HIGHEST), x_scale=_TIME_SCALE, max_nfev=60
    )
    return np.asarray(found.x)


def _best(residual: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Return the best of searches from several time constants."""
    cost = partial(_cost, residual)
    starts = sorted((np.array([0.01, constant]) for constant in STARTS), key=cost)
    return min((_search(residual, start) for start in starts[:2]), key=cost)


def _cost(residual: Callable[[FloatArray], FloatArray], theta: FloatArray) -> float:
    return float(np.sum(residual(theta) ** 2))


def _result(
    model: str,
    response: Response,
    theta: FloatArray,
    gains: FloatArray,
    baseline: float,
    modelled: FloatArray,
) -> TrainFit:
    chosen = response.usable
    fit = fit_percent(response.force[chosen], modelled[chosen])
    return TrainFit(model, fit, float(theta[0]), float(theta[1]), gains, float(baseline), modelled)
