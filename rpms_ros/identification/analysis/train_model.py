"""A train as superposed twitches (Eq. 6): equal pulses, a gain a pulse, or a law of its history.

Latency, T_a, gain and baseline belong to the train.  For given (latency, T_a) gain and baseline
follow from linear equations; least squares in two dimensions remain.
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
        Peak force of each pulse's twitch, or of all [N]; of the history law its scale.
    baseline : float
        [N]
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
    """Return the twitch of every pulse (samples, pulses), in its peak."""
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
