# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The history law of a muscle, fitted to several trains at once and judged on others.

The law is common; latency, T_a, gain and baseline are each train's own, as for equal pulses, so
the three models differ only in the weights of the pulses.  A weak prior keeps parameters that the
trains do not determine, such as the decay of the facilitation if all trains have one rate, near
their start values.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix
from scipy.sparse import lil_matrix

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.analysis.history_law import TrainLaw
from rpms_ros.identification.analysis.responses import Response
from rpms_ros.identification.analysis.train_model import HIGHEST
from rpms_ros.identification.analysis.train_model import LOWEST
from rpms_ros.identification.analysis.train_model import TrainFit
from rpms_ros.identification.analysis.train_model import deviations
from rpms_ros.identification.analysis.train_model import fit_scaled
from rpms_ros.pulses import FloatArray

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
