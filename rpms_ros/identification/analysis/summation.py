# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Analysis of trains: superposed twitches, history law, mean force and ripple.

Eqs. (6) and (7), Figs. 6 to 8.  Three models are fitted to each train: equal pulses, one gain a
pulse, and the history law, which is fitted to the shorter trains and judged on the longest ones
if the recording has both.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rpms_ros.identification.analysis.latency import force_onset
from rpms_ros.identification.analysis.responses import Response
from rpms_ros.identification.analysis.trains import (
    TrainFit,
    TrainLaw,
    fit_equal,
    fit_gains,
    fit_history,
    fit_with_law,
)
from rpms_ros.identification.analysis.twitch_fits import spread

MOST_PULSES = 60
MOST_TRAINS = 32
LEAST_PULSES = 3

Progress = Callable[[int, int], None]


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
    latency, latency_spread : float
        Mean and standard deviation over the trains of the latency of equal pulses, a parameter
        of that model, not the onset of the force (`onsets`) [s].
    time_constant, time_constant_spread : float
        The same of T_a [s].
    rejected : mapping of str to int
        Trains that did not qualify, by reason.
    """

    order: int
    trains: tuple[TrainAnalysis, ...]
    law: TrainLaw | None
    latency: float
    latency_spread: float
    time_constant: float
    time_constant_spread: float
    rejected: Mapping[str, int]

    @property
    def onsets(self) -> tuple[float, ...]:
        """When the force leaves its baseline after the first pulse of each train [s].

        Trains in which noise hides it are not included.
        """
        found = (force_onset(train.response) for train in self.trains)
        return tuple(one.value for one in found if one is not None)

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
        return float(np.mean(fits)) if fits else float('nan')


def analyze_trains(
    responses: Sequence[Response],
    order: int,
    rejected: Mapping[str, int] | None = None,
    progress: Progress | None = None,
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
    progress : callable, optional
        Called with the number of trains done and of all.
    """
    equal, gains = [], []
    for index, response in enumerate(responses):
        equal.append(fit_equal(response, order))
        gains.append(fit_gains(response, order, equal[-1]))
        if progress is not None:
            progress(index + 1, len(responses))
    held_out = _held_out(responses)
    law = _law(responses, equal, held_out, order)
    trains = tuple(
        TrainAnalysis(
            response, one, each, fit_with_law(law, response, order) if law else None, out
        )
        for response, one, each, out in zip(responses, equal, gains, held_out, strict=True)
    )
    latency = np.array([fit.latency for fit in equal])
    constant = np.array([fit.time_constant for fit in equal])
    return SummationAnalysis(
        order=order,
        trains=trains,
        law=law,
        latency=float(latency.mean()),
        latency_spread=spread(latency),
        time_constant=float(constant.mean()),
        time_constant_spread=spread(constant),
        rejected=dict(rejected or {}),
    )


def _held_out(responses: Sequence[Response]) -> list[bool]:
    """Return which trains the law is judged on: the longest, if shorter ones suffice for a fit."""
    counts = [len(response.onset) for response in responses]
    shorter = [count for count in counts if count < max(counts)]
    if not any(count >= LEAST_PULSES for count in shorter):
        return [False] * len(counts)
    return [count == max(counts) for count in counts]


def _law(
    responses: Sequence[Response],
    equal: Sequence[TrainFit],
    held_out: Sequence[bool],
    order: int,
) -> TrainLaw | None:
    taught = [
        (response, fit)
        for response, fit, out in zip(responses, equal, held_out, strict=True)
        if not out
    ]
    if not any(len(response.onset) >= LEAST_PULSES for response, _ in taught):
        return None
    # evenly spread over the recording; more trains would cost time without improving the fit
    picked = np.unique(np.linspace(0, len(taught) - 1, MOST_TRAINS).round().astype(np.int64))
    some = [taught[index] for index in picked]
    return fit_history([response for response, _ in some], [fit for _, fit in some], order)
