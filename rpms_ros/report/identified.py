# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A recording identified as the options of a command say."""

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import DEFAULT_RATE
from rpms_ros.identification import Estimator
from rpms_ros.identification import IdentifiedSession
from rpms_ros.identification import StreamSettings
from rpms_ros.identification import identify
from rpms_ros.identification.catalogue import estimator_by_name
from rpms_ros.identification.constancy.answer import FOLLOWER
from rpms_ros.identification.constancy.answer import is_mixture
from rpms_ros.identification.settings import PEOPLE_PRESET
from rpms_ros.identification.temporal_summation import TemporalSummation
from rpms_ros.identification.verdict import doublings
from rpms_ros.identification.verdict import period_of_estimates
from rpms_ros.identification.warm_start import warm_start
from rpms_ros.pulses import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from rpms_ros.recording import Recording

FOLLOWED = f'followed by {FOLLOWER}, since no constant muscle explains the whole recording'
"""Reason of estimates that were made in place of those of a fit of everything."""

# So many estimates tell when a muscle changed.
_COURSE = 1000


@dataclass(frozen=True)
class IdentificationOptions:
    """How a recording is identified.

    Attributes
    ----------
    estimator : str
        Name of the algorithm.  With ``batch``, a muscle that changed is followed by ``tracking``
        instead; see `identified`.
    preset : str
        ``people``, or one that reproduces the paper; see `PRESET_NAMES`.
    rate_hz : float
        Repetition rate for which the recruitment curve is stated [Hz].
    seed : int
        Of the estimator's random start.
    history : TemporalSummation or None
        What pulses do to those after them.
    start_from : Path or None
        Saved state or result of an earlier session.
    save_state : Path or None
        Where what is known at the end is saved.
    """

    estimator: str = 'batch'
    preset: str = PEOPLE_PRESET
    rate_hz: float = DEFAULT_RATE
    seed: int = 0
    history: TemporalSummation | None = None
    start_from: Path | None = None
    save_state: Path | None = None

    def build(self) -> Estimator:
        """Return a new estimator."""
        estimator = estimator_by_name(
            self.estimator, self.preset, self.seed, self.rate_hz, self.history
        )
        if self.start_from is not None:
            warm_start(estimator, self.start_from)
        return estimator


def history_of(path: Path | None) -> TemporalSummation | None:
    """Return the history law in a file, None without one."""
    return TemporalSummation.of_file(path) if path is not None else None


def identified(
    recording: 'Recording',
    options: IdentificationOptions,
    progress: Callable[[int], object] | None = None,
    most_estimates: int | None = None,
) -> IdentifiedSession:
    """Return what an estimator makes of a recording, as it would have on line.

    Where no constant muscle explains a recording, a fit of all of it is a mixture.  ``batch`` says
    so, and `tracking` goes over the recording in its place if its predictions are better.

    Parameters
    ----------
    recording : Recording
        Pulses and forces.
    options : IdentificationOptions
        Which estimator, and how.
    progress : callable or None
        Called with the number of samples that were taken since the last call.
    most_estimates : int or None
        So many estimates are enough, evenly spaced, each of them one of those on line, and those
        that the verdict needs in any case; None makes all of them, ten a second.  The last one is
        the same in any case.

    Raises
    ------
    IdentificationError
        If no estimate at all is asked for, or see `build` and `identify`.
    """
    if most_estimates is not None and not _is_count(most_estimates):
        raise IdentificationError(
            f'expected most_estimates as a whole number from 1 on, got {most_estimates!r}'
        )
    settings = StreamSettings(estimate_period=_period(recording, most_estimates))
    session = _followed(recording, options, settings, progress)
    # a preset of the paper is chosen for its model
    chosen = options.estimator == 'batch' and options.preset == PEOPLE_PRESET
    if chosen and is_mixture(session.last):
        most = None if most_estimates is None else max(most_estimates, _COURSE)
        many = StreamSettings(estimate_period=_period(recording, most))
        other = _followed(recording, replace(options, estimator=FOLLOWER), many, None)
        if _missed(other) < _missed(session):
            estimates = [replace(o, reasons=(*o.reasons, FOLLOWED)) for o in other.estimates]
            session = replace(other, estimates=estimates)
        elif options.save_state is not None:
            # what is saved is to be what is returned
            session = _followed(recording, options, settings, None)
    if recording.unit == session.last.unit:
        return session
    # as the node does
    return replace(session, estimates=[replace(o, unit=recording.unit) for o in session.estimates])


def _followed(
    recording: 'Recording',
    options: IdentificationOptions,
    settings: StreamSettings,
    progress: Callable[[int], object] | None,
) -> IdentifiedSession:
    estimator = options.build()
    # Only what could have run on line has to leave out the pulses that came too late for it.
    arrival = recording.samples_before_pulse if estimator.on_line else None
    return identify(
        estimator,
        recording.pulses,
        recording.forces,
        settings,
        progress,
        arrival,
        save_state=options.save_state,
        foreign=recording.foreign,
    )


def _missed(session: IdentifiedSession) -> float:
    """Return the mean square of the prediction errors over the later half [N^2]."""
    error = (session.force - session.prediction)[session.usable]
    later = error[len(error) // 2 :]
    return float(np.mean(later**2)) if len(later) else 0.0


def _is_count(value: object) -> bool:
    return isinstance(value, int | np.integer) and bool(value >= 1)


def _period(recording: 'Recording', most_estimates: int | None) -> float:
    """Return a whole multiple of the period on line [s]: every estimate is one of those."""
    on_line = StreamSettings().estimate_period
    if most_estimates is None:
        return on_line
    stamps = recording.forces.stamp_ns
    duration = float(np.ptp(stamps)) / NANOSECONDS_PER_SECOND if len(stamps) else 0.0
    enough = on_line * doublings(duration / (on_line * most_estimates))
    return min(enough, period_of_estimates(duration))
