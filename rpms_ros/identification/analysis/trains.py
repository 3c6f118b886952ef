# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A train as superposed twitches (Eq. 6): equal pulses, a gain a pulse, or a law of its history.

Each train has its own latency, T_a, gain and baseline.  For given (latency, T_a) gain and baseline
follow from linear equations; a least-squares problem in two dimensions remains.

Force of a train by the history law (`rpms_ros.identification.model.summation`), behind a lag.

Force is ``G S(x)`` through a series elasticity, a first-order lag tau_s.  A single twitch has the
peak G before the lag.  The linear sum of Eq. (6) is the limit a = 0, h = 1, k to infinity,
tau_s = 0.

The history law of a muscle, fitted to several trains at once and judged on others.

The law is common; latency, T_a, gain and baseline are each train's own, as for equal pulses, so
the three models differ only in the weights of the pulses.  A weak prior keeps parameters that the
trains do not determine, such as the decay of the facilitation if all trains have one rate, near
their start values.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numba
import numpy as np
from scipy.optimize import least_squares, nnls
from scipy.sparse import csr_matrix, lil_matrix

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.analysis.responses import Response
from rpms_ros.identification.model.summation import HistoryLaw
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


@dataclass(frozen=True)
class TrainLaw(HistoryLaw):
    """History law with a series lag.

    Attributes
    ----------
    series_lag : float
        tau_s [s].

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    POSITIVE = (*HistoryLaw.POSITIVE, 'series_lag')

    series_lag: float = 0.01

    @classmethod
    def of_logarithms(cls, logarithms: FloatArray) -> 'TrainLaw':
        """Return the law from the logarithms (5,) of its parameters, in the order of fields."""
        return cls(*(float(value) for value in np.exp(logarithms)))

    @property
    def logarithms(self) -> FloatArray:
        """Logarithms (5,) of the parameters, in the order of the fields."""
        values = [
            self.half_level,
            self.cooperation,
            max(self.facilitation, 1e-6),
            self.facilitation_decay,
            self.series_lag,
        ]
        return np.log(values)

    def gains(self, onset: FloatArray) -> FloatArray:
        """Return p of pulses at ascending onsets (pulses,) [s]."""
        decay = np.exp(-np.diff(onset) / self.facilitation_decay)
        left = np.zeros(len(onset))
        for index, share in enumerate(decay):
            left[index + 1] = (left[index] + 1.0) * share
        return 1.0 + self.facilitation * left

    def force(self, response: Response, order: int, latency: float, constant: float) -> FloatArray:
        """Return the force of a train in units of G, shape (samples,)."""
        columns = pulse_twitches(response, order, latency, constant)
        activation = columns @ self.gains(response.onset)
        return _lagged(response.lag, self.saturated(activation), self.series_lag)

    def single(self, lag: FloatArray, order: int, latency: float, constant: float) -> FloatArray:
        """Return the force after a pulse without another before it, in units of G (samples,)."""
        return _lagged(
            lag, self.saturated(twitch(lag - latency, constant, order)), self.series_lag
        )


@numba.njit(cache=True)
def _lagged(time: FloatArray, force: FloatArray, constant: float) -> FloatArray:
    """Return the force behind a first-order lag, exact for a force linear between samples."""
    result = np.empty_like(force)
    result[0] = force[0]
    for k in range(1, len(force)):
        step = (time[k] - time[k - 1]) / constant
        decay = np.exp(-step)
        mean = (1.0 - decay) / step
        result[k] = decay * result[k - 1] + (mean - decay) * force[k - 1] + (1.0 - mean) * force[k]
    return result


NUMBERS = 5
_REACH = 6.0
_PRIOR = 0.02
_FASTEST = 2e-3


def fit_history(trains: Sequence[Response], equal: Sequence[TrainFit], order: int) -> TrainLaw:
    """Return the law that explains the trains best.

    Parameters
    ----------
    trains : sequence of Response
        Trains of any number of pulses and any rate, at least one with three pulses.
    equal : sequence of TrainFit
        Their fits with equal pulses, where the search begins.
    order : int
        Order of the twitch.

    Raises
    ------
    IdentificationError
        If no train has three pulses.
    """
    if not any(len(train.onset) >= 3 for train in trains):
        raise IdentificationError('expected a train of at least 3 pulses, got none')
    centre = TrainLaw().logarithms
    count = len(trains)
    # the prior is weaker where equal pulses already explain the trains well
    misfit = float(np.mean([1.0 - fit.fit / 100.0 for fit in equal]))
    prior = _PRIOR * min(1.0, misfit / 0.1)

    def residual(theta: FloatArray) -> FloatArray:
        law = TrainLaw.of_logarithms(theta[:NUMBERS])
        own = theta[NUMBERS:].reshape(count, 2)
        parts = [_misfit(law, train, order, *row) for train, row in zip(trains, own, strict=True)]
        return np.concatenate([*parts, prior * (theta[:NUMBERS] - centre)])

    # the law's own saturation and lag take part of what T_a and latency explain for equal pulses
    start = [(0.6 * fit.latency, max(0.7 * fit.time_constant, _FASTEST)) for fit in equal]
    own = np.clip(np.ravel(start), np.tile(LOWEST, count) + 1e-6, np.tile(HIGHEST, count))
    found = least_squares(
        residual,
        np.concatenate((centre, own)),
        bounds=(
            np.concatenate((centre - _REACH, np.tile(LOWEST, count))),
            np.concatenate((centre + _REACH, np.tile(HIGHEST, count))),
        ),
        x_scale=np.concatenate((np.full(NUMBERS, 0.3), np.full(2 * count, 1e-3))),
        jac_sparsity=_sparsity(trains),
        max_nfev=60,
    )
    return TrainLaw.of_logarithms(found.x[:NUMBERS])


def fit_with_law(law: TrainLaw, train: Response, order: int) -> TrainFit:
    """Fit latency, T_a, gain and baseline of a train with a given law."""

    def shape(latency: float, constant: float) -> FloatArray:
        return law.force(train, order, latency, constant)

    return fit_scaled('history law', train, shape)


def law_deviations(law: TrainLaw, train: Response, fit: TrainFit, order: int) -> FloatArray:
    """Return the standard deviations of latency and T_a (2,) of a train and its law [s].

    The parameters of the law count as unknown too: it may have been fitted to this train.
    """
    chosen = train.usable

    def model(numbers: FloatArray) -> FloatArray:
        latency, constant, gain, base = numbers[:4]
        shape = TrainLaw.of_logarithms(numbers[4:]).force(train, order, latency, constant)
        force: FloatArray = base + gain * shape
        return force[chosen]

    own = [fit.latency, fit.time_constant, float(fit.gains[0]), fit.baseline]
    force = train.force[chosen]
    residual = force - fit.modelled[chosen]
    # the prior of the fit, there relative to the residual divided by the spread of the force
    weight = float(np.sum(np.square(force - force.mean()))) * _PRIOR**2
    prior = np.concatenate((np.zeros(4), np.full(NUMBERS, weight)))
    at = np.concatenate((own, law.logarithms))
    return deviations(model, at, residual, prior)[:2]


def _misfit(
    law: TrainLaw, train: Response, order: int, latency: float, constant: float
) -> FloatArray:
    """Return the residual (samples,) over the spread of the train, at best gain and baseline."""
    shape = law.force(train, order, latency, constant)[train.usable]
    force = train.force[train.usable]
    shape, force = shape - shape.mean(), force - force.mean()
    gain = float(shape @ force) / max(float(shape @ shape), 1e-300)
    misfit: FloatArray = (force - gain * shape) / float(np.linalg.norm(force))
    return misfit


def _sparsity(trains: Sequence[Response]) -> csr_matrix:
    """Return the pattern of the Jacobian."""
    lengths = [int(train.usable.sum()) for train in trains]
    pattern = lil_matrix((sum(lengths) + NUMBERS, NUMBERS + 2 * len(trains)), dtype=np.int8)
    pattern[:, :NUMBERS] = 1
    first = 0
    for index, length in enumerate(lengths):
        place = NUMBERS + 2 * index
        pattern[first : first + length, place : place + 2] = 1
        first += length
    return pattern.tocsr()
