# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Dynamics from trains of one intensity, at their own rate.

If all pulses have one intensity, no recruitment curve can be determined, but the dynamics of the
trains can.  T_a and latency are those of the better of two models, equal pulses or the history
law.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri, stdtrit

from rpms_ros.identification.analysis.analyze import MuscleAnalysis
from rpms_ros.identification.analysis.recruitment_field import CONFIDENCE
from rpms_ros.identification.analysis.trains import TrainLaw, fit_deviations, force_onset
from rpms_ros.identification.quality.explained_force import Stated
from rpms_ros.muscle import twitch
from rpms_ros.pulses import FloatArray
from rpms_ros.schema import documented

# Least improvement of the fit for which the history law, with five more parameters, is taken [%].
_WORTH = 1.0
# Fine enough for the saturation of the fastest twitch, T_a of 1 ms [s].
_STEP = 1e-4
HISTORY_LAW = 'history law'


@dataclass(frozen=True, kw_only=True)
class TrainDynamics:
    """Dynamics of a muscle from trains of one intensity, at their own rate."""

    trains: int = documented('trains that qualified')
    pulses: int = documented('pulses of all of them')
    rate_hz: float = documented('median repetition rate within the trains [Hz]')
    peak_force: float = documented('greatest force above the baseline, mean of the trains [N]')
    onset_s: Stated | None = documented(
        'when the force leaves its baseline after the first pulse, measured [s]'
    )
    model: str = documented('what explains the trains: equal pulses or history law')
    order: int = documented('order of the twitch')
    twitch_time_constant_s: Stated = documented('T_a of the model with its 95 % interval [s]')
    latency_s: Stated = documented(
        'where the twitch of the model begins, a parameter, with its 95 % interval [s]'
    )
    gain: float = documented(
        'peak of the twitch of equal pulses; of the history law before its lag; mean of the trains'
    )
    fit_percent: float = documented('100 (1 - |residual| / |force - mean|), mean of the trains')
    fit_equal_percent: float = documented('the same with equal pulses')
    fit_gains_percent: float = documented('the same with one gain a pulse')
    law: TrainLaw | None = documented('numbers of the history law, if there is one')


def train_dynamics(analysis: MuscleAnalysis) -> TrainDynamics | None:
    """Return the dynamics of the trains of an analysis; None without a train."""
    found = analysis.summation
    if found is None or not found.trains:
        return None
    responses = [train.response for train in found.trains]
    better = found.mean_fit('law') > found.mean_fit('equal') + _WORTH
    law, model = (found.law, 'law') if better else (None, 'equal')
    fits = [getattr(train, model) for train in found.trains]
    pairs = zip(responses, fits, strict=True)
    deviations = np.array([fit_deviations(*pair, found.order, law) for pair in pairs])

    def numbers(name: str) -> FloatArray:
        """Return latency and T_a of a model for each train (2, trains) [s]."""
        fits = [getattr(train, name) for train in found.trains]
        return np.array([[fit.latency for fit in fits], [fit.time_constant for fit in fits]])

    # Pulses that are not equal, or differ by another law than that of the history, move both: the
    # first one of a train acts more than those that follow it, say
    stated, other = numbers(model), found.mean_fit('gains') > found.mean_fit(model)
    apart = np.abs(np.mean(numbers('gains') - stated, axis=1)) * other
    latency, constant = map(_stated, stated, deviations.T, apart.tolist())
    onsets = np.array([bounds for one in responses if (bounds := force_onset(one)) is not None])
    peaks = [one.force[one.usable].max() - one.baseline for one in responses]
    return TrainDynamics(
        trains=len(fits),
        pulses=sum(len(response.onset) for response in responses),
        rate_hz=float(np.median([train.rate_hz for train in found.trains])),
        peak_force=float(np.mean(peaks)),
        onset_s=Stated(float(np.median(onsets[:, 1])), onsets[:, 0].min(), onsets[:, 1].max())
        if len(onsets)
        else None,
        model=HISTORY_LAW if law else 'equal pulses',
        order=found.order,
        twitch_time_constant_s=constant,
        latency_s=latency,
        gain=float(np.mean([fit.gains[0] for fit in fits])),
        fit_percent=found.mean_fit(model),
        fit_equal_percent=found.mean_fit('equal'),
        fit_gains_percent=found.mean_fit('gains'),
        law=found.law,
    )


def response_to_one_pulse(dynamics: TrainDynamics, time: FloatArray) -> FloatArray:
    """Return the force of the model after one pulse (times,), in the unit of the recording.

    Parameters
    ----------
    dynamics : TrainDynamics
        What was found.
    time : ndarray (times,)
        Ascending times after the pulse, which has the intensity of the trains [s].
    """
    lag = np.arange(0.0, time[-1] + _STEP, _STEP)
    latency, constant = dynamics.latency_s.value, dynamics.twitch_time_constant_s.value
    shape = twitch(lag - latency, constant, dynamics.order)
    if dynamics.law is not None and dynamics.model == HISTORY_LAW:
        shape = dynamics.law.force(lag, shape)
    return dynamics.gain * np.interp(time, lag, shape)


def _stated(values: FloatArray, deviations: FloatArray, by_model: float) -> Stated:
    """Return the mean of the trains with its interval.

    The interval follows from the scatter of the trains or from the uncertainty of each, whichever
    is larger, and from what another model would state instead.
    """
    count = len(values)
    level = 0.5 + CONFIDENCE / 2
    own = float(ndtri(level)) * float(np.sqrt(np.mean(np.square(deviations)) / count))
    scatter = 0.0
    if count > 1:
        scatter = float(stdtrit(count - 1, level) * np.std(values, ddof=1)) / np.sqrt(count)
    # as far as the interval of the other model goes
    half = max(own, scatter) + by_model
    mean = float(values.mean())
    # no muscle answers before its pulse
    return Stated(mean, max(mean - half, 0.0), mean + half)
