# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Analysis of trains as superposed twitches (Eqs. 6 and 7, Figs. 6 to 8).

Three models are fitted to each train: equal pulses, one gain a pulse, and the history law
(`rpms_ros.identification.model.history_law`) behind a series elasticity.  Latency, T_a, gain and
baseline are each train's own, so the models differ only in the weights of the pulses.  For given
(latency, T_a) gains and baseline follow from linear equations; a least-squares problem in two
dimensions remains.

The force of the history law is ``G S(x)`` through a first-order lag tau_s; a single twitch has the
peak G before the lag.  The linear sum of Eq. (6) is the limit a = 0, h = 1, k to infinity,
tau_s = 0.  The law is common to all trains.  A weak prior keeps parameters that the trains do not
determine, such as the decay of the facilitation if all trains have one rate, near their start
values.  It is fitted to the shorter trains and judged on the longest ones if the recording has
both.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, field
from typing import Any

import numba
import numpy as np
import scipy  # its parts are loaded when they are asked for

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.analysis.responses import LEAST_BEFORE, Response
from rpms_ros.identification.analysis.twitch_fits import Progress, derivatives
from rpms_ros.identification.model.history_law import HistoryLaw
from rpms_ros.muscle import twitch
from rpms_ros.pulses import FloatArray, IntArray
from rpms_ros.schema import INTERNAL

# latency [s], time constant [s] -> force in gains, shape (samples,)
TrainShape = Callable[[float, float], FloatArray]

MOST_PULSES = 60
_MOST_TRAINS = 32
_LEAST_PULSES = 3
# Bounds of latency and time constant [s].
_LOWEST, _HIGHEST = (0.0, 1e-3), (0.06, 0.2)
_TIME_SCALE = 1e-3
_STARTS = (0.005, 0.010, 0.020, 0.040)
# Samples in a row that have to be so many standard deviations above the baseline.
_STAYS, _OUTSIDE = 3, 4.0


@dataclass(frozen=True)
class TrainFit:
    """A model fitted to one train.

    Attributes
    ----------
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

    fit: float
    latency: float
    time_constant: float
    gains: FloatArray
    baseline: float
    modelled: FloatArray = field(metadata=INTERNAL)


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
        return cls(*np.exp(logarithms).tolist())

    @property
    def logarithms(self) -> FloatArray:
        """Logarithms (5,) of the parameters, in the order of the fields."""
        return np.log(np.maximum(astuple(self), 1e-6))

    def gains(self, onset: FloatArray) -> FloatArray:
        """Return p of pulses at ascending onsets (pulses,) [s]."""
        left = np.zeros(len(onset))
        for index, share in enumerate(np.exp(-np.diff(onset) / self.facilitation_decay)):
            left[index + 1] = (left[index] + 1.0) * share
        return 1.0 + self.facilitation * left

    def force(self, lag: FloatArray, activation: FloatArray) -> FloatArray:
        """Return the force of an activation at times `lag` in units of G, shape (samples,)."""
        return _lagged(lag, self.saturated(activation), self.series_lag)


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


@dataclass(frozen=True)
class TrainAnalysis:
    """One train with three fitted models.

    Attributes
    ----------
    response : Response
        Its pulses and force.
    equal : TrainFit
        Equal pulses (Eq. 6).
    gains : TrainFit
        One gain a pulse.
    law : TrainFit or None
        History law, if one was fitted.
    held_out : bool
        Whether the law was fitted without this train.
    """

    response: Response
    equal: TrainFit
    gains: TrainFit
    law: TrainFit | None
    held_out: bool

    @property
    def rate_hz(self) -> float:
        """Repetition rate [Hz]."""
        return 1.0 / float(np.median(np.diff(self.response.onset)))


@dataclass(frozen=True)
class SummationAnalysis:
    """Results of the analysis of trains.

    Attributes
    ----------
    order : int
        Order of the twitch.
    trains : tuple of TrainAnalysis
        Those that qualified.
    law : TrainLaw or None
        Common law; None if no train has three pulses.
    time_constant : float
        Mean over the trains of T_a of equal pulses [s].
    rejected : mapping of str to int
        Trains that did not qualify, by reason.
    """

    order: int
    trains: tuple[TrainAnalysis, ...]
    law: TrainLaw | None
    time_constant: float
    rejected: Mapping[str, int]

    def mean_fit(self, model: str, held_out: bool | None = None) -> float:
        """Return the mean fit [%] of ``equal``, ``gains`` or ``law``; NaN without a train.

        Parameters
        ----------
        model : str
            Name of the model.
        held_out : bool, optional
            True: only the trains to which the law was not fitted; False: only the others.
        """
        fits = [
            found.fit
            for train in self.trains
            if held_out in (None, train.held_out) and (found := getattr(train, model))
        ]
        return float(np.mean(fits)) if fits else math.nan


def analyze_trains(
    responses: Sequence[Response],
    order: int,
    rejected: Mapping[str, int] | None = None,
    progress: Progress = lambda *_: None,
) -> SummationAnalysis:
    """Fit superposed twitches of one order to trains (at least one).

    Parameters
    ----------
    responses : sequence of Response
        Trains; they may come from several recordings.
    order : int
        Order of the twitch.
    rejected : mapping of str to int, optional
        Trains that did not qualify, by reason.
    progress : callable
        Called with the number of trains done and of all.
    """
    equal, gains = [], []
    for index, response in enumerate(responses):
        equal.append(fit_train(response, order))
        gains.append(fit_gains(response, order, equal[-1]))
        progress(index + 1, len(responses))
    counts = np.array([len(response.onset) for response in responses])
    # judged on the longest, if shorter ones suffice for a fit
    judged = counts == counts.max()
    judged &= bool((counts[~judged] >= _LEAST_PULSES).any())
    law = None
    if (counts[~judged] >= _LEAST_PULSES).any():
        taught = np.flatnonzero(~judged)
        # more trains would cost time without improving the fit
        picked = taught[evenly(len(taught), _MOST_TRAINS)]
        law = fit_history([responses[k] for k in picked], [equal[k] for k in picked], order)
    trains = tuple(
        TrainAnalysis(
            response, one, each, fit_train(response, order, law) if law else None, bool(out)
        )
        for response, one, each, out in zip(responses, equal, gains, judged, strict=True)
    )
    return SummationAnalysis(
        order=order,
        trains=trains,
        law=law,
        time_constant=float(np.mean([fit.time_constant for fit in equal])),
        rejected=dict(rejected or {}),
    )


def evenly(count: int, most: int) -> IntArray:
    """Return at most so many of `count` places, evenly chosen, first and last included."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(np.int64))


def pulse_twitches(response: Response, order: int, latency: float, constant: float) -> FloatArray:
    """Return the twitch of every pulse, with peak 1 (samples, pulses)."""
    return twitch(response.lag[:, None] - response.onset - latency, constant, order)


def train_shape(
    response: Response, order: int, law: TrainLaw | None, latency: float, constant: float
) -> FloatArray:
    """Return the force (samples,) of a train in gains: of a law, or of equal pulses (Eq. 6)."""
    columns = pulse_twitches(response, order, latency, constant)
    if law is not None:
        return law.force(response.lag, columns @ law.gains(response.onset))
    total: FloatArray = columns.sum(axis=1)
    return total


def fit_train(response: Response, order: int, law: TrainLaw | None = None) -> TrainFit:
    """Fit latency, T_a, gain and baseline of a train with a law, or of equal pulses (Eq. 6)."""
    return fit_scaled(response, lambda *theta: train_shape(response, order, law, *theta))


def fit_scaled(response: Response, shape: TrainShape) -> TrainFit:
    """Fit latency, time constant, one gain and a baseline of a shape to a train."""
    force = response.force[response.usable]

    def residual(theta: FloatArray) -> FloatArray:
        part = shape(*theta)[response.usable]
        gain, base = _line(part, force)
        return force - (base + gain * part)

    def cost(theta: FloatArray) -> float:
        return float(np.sum(residual(theta) ** 2))

    starts = sorted((np.array([0.01, constant]) for constant in _STARTS), key=cost)
    theta = min((_search(residual, start) for start in starts[:2]), key=cost)
    whole = shape(*theta)
    gain, base = _line(whole[response.usable], force)
    return _train_fit(response, theta, np.array([gain]), base, base + gain * whole)


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
        return scipy.optimize.nnls(design[response.usable], force)[0], design

    def residual(theta: FloatArray) -> FloatArray:
        found, design = gains(theta)
        return force - design[response.usable] @ found

    theta = _search(residual, np.array([start.latency, start.time_constant]))
    found, design = gains(theta)
    return _train_fit(response, theta, found[:-2], found[-2] - found[-1], design @ found)


def _line(shape: FloatArray, force: FloatArray) -> tuple[float, float]:
    """Return gain and baseline of a shape."""
    centred = shape - shape.mean()
    power = float(centred @ centred)
    gain = float(centred @ force) / power if power > 0 else 0.0
    return gain, float(force.mean() - gain * shape.mean())


def _search(residual: Callable[[FloatArray], FloatArray], start: FloatArray) -> FloatArray:
    inside = np.clip(start, np.array(_LOWEST) + 1e-6, np.array(_HIGHEST) - 1e-6)
    found = scipy.optimize.least_squares(
        residual, inside, bounds=(_LOWEST, _HIGHEST), x_scale=_TIME_SCALE, max_nfev=60
    )
    return np.asarray(found.x)


def _train_fit(
    response: Response, theta: FloatArray, gains: FloatArray, baseline: float, modelled: FloatArray
) -> TrainFit:
    measured = response.force[response.usable]
    missed = float(np.linalg.norm(measured - modelled[response.usable]))
    fit = 100.0 * (1.0 - missed / max(float(np.linalg.norm(measured - measured.mean())), 1e-300))
    return TrainFit(fit, float(theta[0]), float(theta[1]), gains, float(baseline), modelled)


_NUMBERS = 5
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
    if not any(len(train.onset) >= _LEAST_PULSES for train in trains):
        raise IdentificationError('expected a train of at least 3 pulses, got none')
    centre = TrainLaw().logarithms
    count = len(trains)
    # the prior is weaker where equal pulses already explain the trains well
    prior = _PRIOR * min(1.0, float(np.mean([1.0 - fit.fit / 100.0 for fit in equal])) / 0.1)

    def residual(theta: FloatArray) -> FloatArray:
        law = TrainLaw.of_logarithms(theta[:_NUMBERS])
        own = theta[_NUMBERS:].reshape(count, 2)
        parts = [_misfit(law, train, order, *row) for train, row in zip(trains, own, strict=True)]
        return np.concatenate([*parts, prior * (theta[:_NUMBERS] - centre)])

    # the law's own saturation and lag take part of what T_a and latency explain for equal pulses
    start = [(0.6 * fit.latency, max(0.7 * fit.time_constant, _FASTEST)) for fit in equal]
    lowest = np.concatenate((centre - _REACH, np.tile(_LOWEST, count)))
    highest = np.concatenate((centre + _REACH, np.tile(_HIGHEST, count)))
    # the law acts on every residual, latency and T_a on those of their train
    blocks = [*(np.ones((train.usable.sum(), 2)) for train in trains), np.zeros((_NUMBERS, 0))]
    own: Any = scipy.sparse.block_diag(blocks)
    common = scipy.sparse.coo_array(np.ones((own.shape[0], _NUMBERS)))
    found = scipy.optimize.least_squares(
        residual,
        np.clip(np.concatenate((centre, np.ravel(start))), lowest + 1e-6, highest),
        bounds=(lowest, highest),
        x_scale=np.concatenate((np.full(_NUMBERS, 0.3), np.full(2 * count, _TIME_SCALE))),
        jac_sparsity=scipy.sparse.hstack((common, own)),
        max_nfev=60,
    )
    return TrainLaw.of_logarithms(found.x[:_NUMBERS])


def _misfit(
    law: TrainLaw, train: Response, order: int, latency: float, constant: float
) -> FloatArray:
    """Return the residual (samples,) over the spread of the train, at best gain and baseline."""
    shape = train_shape(train, order, law, latency, constant)[train.usable]
    force = train.force[train.usable]
    shape, force = shape - shape.mean(), force - force.mean()
    gain = float(shape @ force) / max(float(shape @ shape), 1e-300)
    misfit: FloatArray = (force - gain * shape) / np.linalg.norm(force)
    return misfit


def fit_deviations(
    response: Response, fit: TrainFit, order: int, law: TrainLaw | None = None
) -> FloatArray:
    """Return the standard deviations of latency and T_a (2,) of a fit [s].

    Parameters
    ----------
    response : Response
        The train.
    fit : TrainFit
        With equal pulses, or with a law.
    order : int
        Order of the twitch.
    law : TrainLaw, optional
        Its parameters count as unknown too: it may have been fitted to this train.

    Notes
    -----
    A misfit of the model correlates neighbouring residuals: the variance is multiplied by the sum
    of their correlations up to the first that is not positive, as for a mean of such residuals.
    """

    def model(numbers: FloatArray) -> FloatArray:
        latency, constant, gain, base = numbers[:4]
        one = None if law is None else TrainLaw.of_logarithms(numbers[4:])
        force: FloatArray = base + gain * train_shape(response, order, one, latency, constant)
        return force[response.usable]

    own = [fit.latency, fit.time_constant, float(fit.gains[0]), fit.baseline]
    at = np.array(own if law is None else [*own, *law.logarithms])
    force = response.force[response.usable]
    residual = force - fit.modelled[response.usable]
    # the prior of the law, in its fit relative to the residual divided by the spread of the force
    prior = np.zeros(len(at))
    prior[4:] = float(np.sum(np.square(force - force.mean()))) * _PRIOR**2
    jacobian = derivatives(model, at, 1e-4 * np.maximum(np.abs(at), 1e-3))
    matrix = jacobian.T @ jacobian + np.diag(prior)
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse = np.diag(np.linalg.pinv(matrix / np.outer(scale, scale))) / scale**2
    spare = max(1, len(residual) - len(at))
    variance = float(residual @ residual) / spare * _correlated(residual)
    found: FloatArray = np.sqrt(np.maximum(inverse, 0.0) * variance)[:2]
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


def force_onset(response: Response) -> tuple[float, float] | None:
    """Return bounds of the onset of the force after the first pulse [s]; None if noise hides it.

    The latency of a fitted twitch is the onset of that twitch; it is later if the force of the
    muscle rises slower than that of the model.  The upper bound here is measured: the first sample
    from which on the force stays outside the noise before the pulse, which hides the beginning.
    The lower bound is the last sample before it that is a standard deviation below the baseline,
    which is improbable after the force has begun.  Samples that an artifact may affect are not
    used, neither as force nor as baseline.
    """
    lag, force = response.samples
    before, after = force[lag < 0.0], lag > 0.0
    lag, force = lag[after], force[after]
    if len(before) < LEAST_BEFORE or len(force) < _STAYS:
        return None
    deviation = float(np.std(before, ddof=1))
    above = force - float(np.mean(before))
    outside = np.lib.stride_tricks.sliding_window_view(above > _OUTSIDE * deviation, _STAYS)
    stays = outside.all(axis=1)
    if not stays.any() or (deviation == 0.0 and not above.any()):
        return None
    first = int(np.argmax(stays))
    inside = np.flatnonzero(above[:first] <= -deviation)
    return float(lag[inside[-1]]) if len(inside) else 0.0, float(lag[first])
