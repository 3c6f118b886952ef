# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Force simulated from the pulses with one estimate, compared with the measured force.

The a-priori prediction shows how well an estimator follows the force; an estimator that forgets
fast can follow it with parameters that explain nothing else.  The result of a session is a single
estimate, so the force is simulated with the recruitment and response of that estimate alone.

Which numbers of an estimate come from the data, and not from the prior.

Where the data determine little, an estimator with a prior returns the values of the prior.  Such
a number is no measurement and is not shown as one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from rpms_ros.identification.estimation.estimate_builder import LEAST_GAIN, PRIOR
from rpms_ros.identification.model.estimate import NOT_INFORMED, Estimate
from rpms_ros.muscle.recruitment import RateRecruitment
from rpms_ros.pulses import (
    NANOSECONDS_PER_SECOND,
    BoolArray,
    FloatArray,
    IntArray,
    PulseTrain,
    nanoseconds,
)

# What estimators make of the interval before a pulse; no estimate says which.
LAWS = (None, RateRecruitment())
_JUDGED_PULSES = 101
_AFTER_LAST_NS = 500_000_000


class SimulatedFit(NamedTuple):
    """How well the force simulated with one estimate fits the measured one.

    Attributes
    ----------
    explained : float
        Variance accounted for, white noise excluded, with a constant baseline [1]; below 0 if the
        simulated force is further from the measured one than a constant.
    explained_straight : float
        The same with a straight baseline, which removes a drift [1].
    gain : float
        Factor on the simulated force that would fit best [1]; NaN if it is constant.
    error : float
        Root mean square of measured minus simulated force and baseline [N].
    slope : float
        Slope of measured minus simulated force [N/s].
    noise : float
        Standard deviation of the white noise of the force [N].
    signal : float
        Standard deviation of the force [N].
    """

    explained: float
    explained_straight: float
    gain: float
    error: float
    slope: float
    noise: float
    signal: float


def simulated_force(
    estimate: Estimate, pulses: PulseTrain, stamp_ns: IntArray, law: RateRecruitment | None = None
) -> FloatArray:
    """Return the force (samples,) simulated from pulses with an estimate [N].

    Parameters
    ----------
    estimate : Estimate
        Response and recruitment; pulses of unknown intensity get the median intensity.
    pulses : PulseTrain
        In any order.
    stamp_ns : ndarray of int64 (samples,)
        Ascending times [ns].
    law : RateRecruitment, optional
        Weight of a pulse by the interval to the pulse before it; None: all weights are equal.
    """
    force = np.zeros(len(stamp_ns))
    reach_ns = nanoseconds(float(estimate.response_time[-1]))
    weight = _weights(estimate, pulses.intensity)
    if law is not None:
        weight = weight * rate_weights(estimate.repetition_rate, pulses.onset_ns, law)
    first = np.searchsorted(stamp_ns, pulses.onset_ns)
    last = np.searchsorted(stamp_ns, pulses.onset_ns + reach_ns, side='right')
    response = estimate.response_time, estimate.response_force
    for pulse, onset_ns in enumerate(pulses.onset_ns):
        acts = slice(first[pulse], last[pulse])
        lag = (stamp_ns[acts] - onset_ns) / NANOSECONDS_PER_SECOND
        force[acts] += weight[pulse] * np.interp(lag, *response)
    return force


def weight_at_own_rate(
    estimate: Estimate, pulses: PulseTrain, stamp_ns: IntArray, force: FloatArray
) -> float:
    """Return the weight of the pulses at their own rate, 1 at the rate of the estimate.

    An estimate is stated for one rate; where the recruitment is not known, only the response at
    the rate of the recording was measured.  Whether the estimator weighted pulses by their rate
    shows in which of the simulated forces is nearer to force (samples,) [N] at ascending stamps
    (samples,) [ns], over the last hundred pulses.
    """
    last = pulses[np.argsort(pulses.onset_ns, kind='stable')[-_JUDGED_PULSES:]]
    if len(last) < 2:
        return 1.0
    part = (stamp_ns >= last.onset_ns[0]) & (stamp_ns <= last.onset_ns[-1] + _AFTER_LAST_NS)
    after = stamp_ns[part] >= last.onset_ns[1]

    def missed(law: RateRecruitment | None) -> float:
        # the weight of the first pulse is that of a pulse without another before it
        simulated = simulated_force(estimate, last[1:], stamp_ns[part], law)
        residual = (force[part] - simulated)[after]
        return float(np.var(residual)) if len(residual) else 0.0

    best = min(LAWS, key=missed)
    if best is None:
        return 1.0
    return float(np.median(rate_weights(estimate.repetition_rate, last.onset_ns, best)[1:]))


def simulated_fit(
    estimate: Estimate, pulses: PulseTrain, stamp_ns: IntArray, force: FloatArray
) -> SimulatedFit:
    """Compare the simulated force with force (samples,) [N] at ascending stamps (samples,) [ns].

    Whether pulses are weighted by their rate differs between estimators and is not part of an
    estimate: the better of the two fits is returned.
    """
    return max(
        (_held(simulated_force(estimate, pulses, stamp_ns, law), stamp_ns, force) for law in LAWS),
        key=lambda found: found.explained,
    )


def _held(stated: FloatArray, stamp_ns: IntArray, force: FloatArray) -> SimulatedFit:
    time = (stamp_ns - stamp_ns[0]) / NANOSECONDS_PER_SECOND
    time -= time.mean()
    residual = force - stated - np.mean(force - stated)
    noise = white_noise(force)
    signal, error = float(np.var(force)), float(np.mean(np.square(residual)))
    spread = product(time, time)
    slope = product(time, residual) / spread if spread > 0.0 else 0.0
    moved = stated - stated.mean()
    energy = product(moved, moved)
    return SimulatedFit(
        explained=_explained(force, residual, noise),
        explained_straight=_explained(force - slope * time, residual - slope * time, noise),
        gain=product(moved, force) / energy if energy > 0.0 else float('nan'),
        error=float(np.sqrt(error)),
        slope=slope,
        noise=noise,
        signal=float(np.sqrt(signal)),
    )


def product(one: FloatArray, other: FloatArray) -> float:
    """Return the scalar product of two courses (samples,).

    Not by BLAS, the last bits of which depend on its threads; and these wait by turning.
    """
    return float(np.sum(one * other))


def _explained(force: FloatArray, residual: FloatArray, noise: float) -> float:
    power = float(np.var(force)) - noise**2
    left = max(float(np.mean(np.square(residual))) - noise**2, 0.0)
    return 1.0 - left / power if power > 0.0 else 0.0


def white_noise(force: FloatArray) -> float:
    """Return the standard deviation of the white noise in evenly sampled force (samples,) [N].

    The force of a muscle is smooth from sample to sample, so its second differences are those of
    the noise, with six times its variance.  The median is robust against artifacts.
    """
    if len(force) < 3:
        return 0.0
    return float(np.median(np.abs(np.diff(force, 2)))) / (0.6744897501960817 * math.sqrt(6.0))


def rate_weights(rate_hz: float, onset_ns: IntArray, by_rate: RateRecruitment) -> FloatArray:
    """Return weights (pulses,) by the intervals before pulses, 1 at the rate `rate_hz` [Hz]."""
    order = np.argsort(onset_ns, kind='stable')
    weight = np.empty(len(onset_ns))
    weight[order] = by_rate.of_train(onset_ns[order], rate_hz)
    return weight


def _weights(estimate: Estimate, intensity: FloatArray) -> FloatArray:
    """Return the recruitment of pulses (pulses,), 1 at full intensity."""
    known = np.isfinite(intensity)
    middle = float(np.median(intensity[known])) if known.any() else 1.0
    applied = np.where(known, intensity, middle)
    share = estimate.relative_recruitment(applied)
    return share if np.isfinite(share).all() else np.ones(len(applied))


# A twitch whose peak is further from that of the response does not describe the response.
_PEAK_DIFFERENCE = 0.3


def informed_parameters(estimate: Estimate) -> BoolArray:
    """Return which nonlinear parameters (p,) are informed; all if the estimator has no flags."""
    flags = estimate.nonlinear_identifiability
    if len(flags) != len(estimate.nonlinear):
        return np.ones(len(estimate.nonlinear), dtype=np.bool_)
    informed: BoolArray = flags != NOT_INFORMED
    return informed


@dataclass(frozen=True)
class Stated:
    """A number with its interval."""

    value: float
    lower: float
    upper: float


def stated(names: Sequence[str], *columns: FloatArray) -> dict[str, Stated]:
    """Return values and the ends of their intervals, by name."""
    rows = np.stack(columns, axis=1).tolist()
    return {name: Stated(*row) for name, row in zip(names, rows, strict=True)}


def is_no_twitch(twitch: Stated | None, peak: float) -> bool:
    """Return whether the peak of a response is none of the twitch that was fitted to it.

    It is outside the interval of that of the twitch, and by 5 % of it more.
    """
    return twitch is not None and not 0.95 * twitch.lower < peak < 1.05 * twitch.upper


def informed_physiology(estimate: Estimate) -> dict[str, Stated]:
    """Return the numbers of the physiology of which the data inform, by name.

    Informed is a number whose standard deviation is below 0.7 (as in `identifiability`) of that
    of the prior, or of the value itself where there is no prior.  None is if the twitch has
    another peak than the response to which it was fitted.
    """
    if not estimate.confidence > 0.0 or not len(estimate.response_force):
        return {}
    quantile = float(ndtri(0.5 + 0.5 * estimate.confidence))
    columns = (estimate.physiology, estimate.physiology_lower, estimate.physiology_upper)
    found = stated(estimate.physiology_names, *columns)
    peak = float(estimate.response_force.max())
    twitch = found.get('twitch_peak_n')
    if twitch and abs(twitch.value - peak) > _PEAK_DIFFERENCE * abs(peak):
        return {}

    def informs(name: str, one: Stated) -> bool:
        _, before = PRIOR.get(name, (0.0, abs(one.value)))
        # the lower end may have been cut off at 0
        return (one.upper - one.value) / quantile < LEAST_GAIN * before

    return {name: one for name, one in found.items() if informs(name, one)}
