# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""The last session of a returning patient as a prior, which is reduced where it is wrong.

The covariance P of parameters and response of the last session is increased by the changes from
one day to the next, most of all by the new position of the coil,

.. math:: P' = P + Q_\theta + g^2 w w^T + t^2 (D w) (D w)^T + h^2 \|w\|^2 I / n ,

with D the derivative by the logarithm of the time constant (`tracking.stretching`),
and becomes the arrival cost of a horizon (`projection.arrival_cost`), which is compared with the
samples before every step and reduced where it contradicts them, or the prior of `tracking`, which
is dropped where a fit without it contradicts it.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from typing import Protocol
from typing import runtime_checkable

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import checkpoint
from rpms_ros.identification.estimate import Estimator
from rpms_ros.identification.laguerre import LaguerreBasis
from rpms_ros.identification.projection.basis_search import basis_at
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.tracking.stretching import slowed
from rpms_ros.muscle.identified_form import PARAMETER_NAMES
from rpms_ros.muscle.identified_form import RecruitmentParameters
from rpms_ros.muscle.identified_form import identified_recruitment
from rpms_ros.pulses import FloatArray

# Grid on which a response is converted to another basis [s].
_LAG: FloatArray = np.arange(0.0, 0.6, 1e-3)
_LARGEST_RESULT = 64_000_000
# Functions on which the response of a result may have been found: 7 to 105 ms, 0 to 35 ms.
_BASIS = LaguerreBasis(7, 38e-3, 8e-3)
_PLACES = tuple((k, j) for k in range(-16, 11) for j in range(-32, 109, 4))
# Standard deviations that the JSON of a result lacks: response, as a share of it, and parameters.
_RESULT_SHARE = 0.02
_RESULT_DEVIATION = (0.02, 0.02, 0.3, 0.2)


@dataclass(frozen=True)
class DayToDay:
    """Standard deviations of the changes of a muscle from one session to the next.

    Attributes
    ----------
    threshold : float
        Of u_thr and u_sat.
    slope : float
        Of the logarithms of alpha_sat and alpha_thr.
    gain : float
        Of the force, as a share of it.
    slowing : float
        Of the logarithm of the response's time constant.
    shape : float
        Of the response otherwise, as a share of it.
    """

    threshold: float = 0.01
    slope: float = 0.1
    gain: float = 0.1
    slowing: float = 0.05
    shape: float = 0.005


@dataclass(frozen=True)
class Knowledge:
    """Result of a session for a warm start.

    Attributes
    ----------
    theta : ndarray (4,)
        u_thr, u_sat, alpha_sat, alpha_thr.
    linear : ndarray (functions,)
        Coefficients of the response.
    covariance : ndarray (4 + functions, 4 + functions)
        Of both, alpha as logarithms.
    variance : float
        Of the residuals [N^2].
    basis : LaguerreBasis
        Functions of the response.
    """

    theta: FloatArray
    linear: FloatArray
    covariance: FloatArray
    variance: float
    basis: LaguerreBasis

    def __post_init__(self) -> None:
        joint = PARAMETERS + self.basis.functions
        fits = self.theta.shape == (PARAMETERS,) and self.linear.shape == (self.basis.functions,)
        if not (fits and self.covariance.shape == (joint, joint)):
            raise IdentificationError('expected parameters of one model, got other shapes')
        values = np.concatenate((self.theta, self.linear, self.covariance.ravel()))
        if not (np.isfinite(values).all() and 0.0 < self.variance < math.inf):
            raise IdentificationError('expected finite parameters of a muscle, got others')
        if not (self.theta[2:] > 0.0).all():
            raise IdentificationError(f'expected alpha above 0, got {self.theta[2:].tolist()}')

    def on(self, basis: LaguerreBasis) -> 'Knowledge':
        """Return the same on another basis, by least squares."""
        if basis == self.basis:
            return self
        change = np.linalg.lstsq(basis.evaluate(_LAG), self.basis.evaluate(_LAG), rcond=None)[0]
        joint = np.zeros((PARAMETERS + basis.functions, len(self.covariance)))
        joint[:PARAMETERS, :PARAMETERS] = np.eye(PARAMETERS)
        joint[PARAMETERS:, PARAMETERS:] = change
        covariance = joint @ self.covariance @ joint.T
        return Knowledge(self.theta, change @ self.linear, covariance, self.variance, basis)

    def widened(self, change: DayToDay) -> FloatArray:
        """Return the covariance (4 + functions, 4 + functions) after a change from day to day."""
        size = float(self.linear @ self.linear)
        spread = np.concatenate(
            (
                np.full(2, change.threshold**2),
                np.full(2, change.slope**2),
                np.full(len(self.linear), change.shape**2 * size / len(self.linear)),
            )
        )
        covariance: FloatArray = self.covariance + np.diag(spread)
        response = covariance[PARAMETERS:, PARAMETERS:]
        response += change.gain**2 * np.outer(self.linear, self.linear)
        stretch = slowed(self.linear)
        response += change.slowing**2 * np.outer(stretch, stretch)
        return covariance


@runtime_checkable
class WarmStarting(Estimator, Protocol):
    """An estimator that can start from an earlier session."""

    def start_from(self, known: Knowledge) -> None:
        """Use the result of an earlier session as prior.

        Raises
        ------
        IdentificationError
            If there have been data.
        """


def warm_start(estimator: Estimator, path: Path | str) -> None:
    """Start a fresh estimator from a saved state, or from the JSON of ``rpms identify``.

    Raises
    ------
    IdentificationError
        If the file holds no recruitment curve, or the estimator cannot start from one.
    """
    if not isinstance(estimator, WarmStarting):
        raise IdentificationError(
            'expected an estimator that can start from an earlier session, such as horizon or '
            f'tracking, got {estimator.name}'
        )
    estimator.start_from(known_from(path))


def known_from(path: Path | str) -> Knowledge:
    """Return the knowledge in a saved state, or in the JSON of ``rpms identify``.

    Raises
    ------
    IdentificationError
        If it holds no recruitment curve.
    """
    try:
        if checkpoint.is_state(path):
            state = checkpoint.read_state(path)['estimator_state']
            return _of_tracking(state) if '_window' in state else _of_state(state)
        return _of_result(_read_result(Path(path)))
    except (KeyError, TypeError, ValueError, AttributeError, np.linalg.LinAlgError) as error:
        raise IdentificationError(
            f'expected a session with a recruitment curve in {path}, got {error!r}'
        ) from error


def _of_state(state: Mapping[str, Any]) -> Knowledge:
    """Return the knowledge in the state of a batch or a horizon."""
    settings, fit, prior = state['settings'], state['_fit'], state['_problem']['prior']
    variance = float(fit['variance'][0])
    lower = np.tril(fit['complete'])
    matrix = lower + np.tril(lower, -1).T
    joint = len(prior['reference'])
    matrix[:joint, :joint] += prior['information']
    known = np.arange(PARAMETERS)
    matrix[known, known] += variance / prior['deviation'] ** 2
    size = float(np.trace(matrix))
    matrix += 1e-9 * size / len(matrix) * np.eye(len(matrix))
    inverse = np.linalg.inv(matrix)[:joint, :joint]
    basis = LaguerreBasis(
        settings['basis.functions'], settings['basis.time_constant'], settings['basis.latency']
    )
    if settings.get('choose_basis') and '_place' in state:
        basis = basis_at(basis, state['_place'])
    return Knowledge(fit['theta'], fit['linear'], variance * inverse, variance, basis)


def _of_tracking(state: Mapping[str, Any]) -> Knowledge:
    """Return the knowledge in the state of `tracking`: the muscle at the end."""
    fit, basis = state['_window'], LaguerreBasis(**state['_basis'])
    point, joint = fit['point'], PARAMETERS + basis.functions
    covariance = np.array(fit['covariance'][:joint, :joint], dtype=np.float64)
    return Knowledge(point['theta'], point['linear'], covariance, fit['variance'], basis)


def _of_result(document: Mapping[str, Any]) -> Knowledge:
    """Return the knowledge in the JSON of ``rpms identify``, with assumed covariance."""
    recruitment = document['recruitment']
    if unknown := [name for name in PARAMETER_NAMES if recruitment[name] is None]:
        raise IdentificationError(
            f'expected a result that knows {", ".join(PARAMETER_NAMES)}, got none of '
            f'{", ".join(unknown)}'
        )
    theta = np.array([float(recruitment[name]) for name in PARAMETER_NAMES])
    response = document['impulse_response']
    time = np.array(response['time_s'], dtype=np.float64)
    force = np.array(response['force'], dtype=np.float64)
    # the coefficients are those of recruitment 1, the response is that at full intensity
    force /= float(identified_recruitment(RecruitmentParameters(*theta.tolist()), 1.0))
    basis, linear = _fitted_basis(time, force)
    share = _RESULT_SHARE**2 * float(linear @ linear) / len(linear)
    deviation = np.array(_RESULT_DEVIATION)
    covariance = np.diag(np.concatenate((deviation**2, np.full(len(linear), share))))
    return Knowledge(theta, linear, covariance, float(document['output_error_n']) ** 2, basis)


def _fitted_basis(time: FloatArray, force: FloatArray) -> tuple[LaguerreBasis, FloatArray]:
    """Return the basis that represents a response (times,) best, and its coefficients.

    A result does not say on which functions its response was found.
    """
    found = {}
    for place in _PLACES:
        basis = basis_at(_BASIS, place)
        functions = basis.evaluate(time)
        linear = np.linalg.lstsq(functions, force, rcond=None)[0]
        found[basis] = float(np.sum((force - functions @ linear) ** 2)), linear
    best = min(found, key=lambda basis: found[basis][0])
    return best, np.array(found[best][1], dtype=np.float64)


def _read_result(path: Path) -> Mapping[str, Any]:
    try:
        if not path.is_file() or path.stat().st_size > _LARGEST_RESULT:
            raise IdentificationError(f'expected a saved state or a result, got {path}')
        document: Mapping[str, Any] = json.loads(path.read_text())
    except (OSError, RecursionError) as error:
        raise IdentificationError(f'expected to read {path}, got {error}') from error
    return document
