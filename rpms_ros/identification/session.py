# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Identification of a whole recording with the estimator that also runs on line.

Error of the a-priori predictions of a session, in newtons and as a share of the range.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.model.estimate import Estimate, Estimator
from rpms_ros.identification.stream.monitors import Monitor, ProcessedSamples
from rpms_ros.identification.stream.recorded_order import feed
from rpms_ros.identification.stream.stream import IdentificationStream, StreamSettings, save
from rpms_ros.printable import counted
from rpms_ros.pulses import (
    NANOSECONDS_PER_SECOND,
    BoolArray,
    FloatArray,
    ForceTrace,
    IntArray,
    PulseTrain,
)

# Earlier samples do not count, or those of the first half of a shorter session [s].
SETTLING_TIME = 10.0


class OutputError(NamedTuple):
    """Error of the predictions made before each sample was learnt from, after settling.

    Attributes
    ----------
    newton : float
        Root mean square of measured minus predicted force [N].
    of_range : float
        The same divided by the range, maximum minus minimum, of the session's force [1].
    """

    newton: float
    of_range: float


def output_error(
    stamp_ns: IntArray, force: FloatArray, prediction: FloatArray, usable: BoolArray
) -> OutputError:
    """Return the output error of a session.

    Usable samples count from `SETTLING_TIME` after the first one on, or from the middle of the
    session if that is earlier.  The error is related to the range of the whole session, so a force
    near zero at some time makes no difference.

    Parameters
    ----------
    stamp_ns, force, prediction : ndarray (samples,)
        In the order in which they were processed [ns], [N], [N]; NaN where nothing was predicted.
    usable : ndarray of bool (samples,)
        Samples that could be learnt from.

    Returns
    -------
    OutputError
        NaN without a usable sample that was predicted, or with a constant force.
    """
    kept = settled(stamp_ns) & usable & np.isfinite(prediction)
    if not kept.any():
        return OutputError(math.nan, math.nan)
    # Not by BLAS, whose last bits depend on the number of its threads: the results of a study
    # would depend on the number of its processes.
    newton = math.sqrt(float(np.mean(np.square(force[kept] - prediction[kept]))))
    span = float(np.ptp(force[usable]))
    return OutputError(newton, newton / span if span > 0.0 else math.nan)


def settled(stamp_ns: IntArray) -> BoolArray:
    """Return which samples (samples,) are past `SETTLING_TIME`, or past the middle if earlier."""
    # A jump back of the clock does not reduce the time that has passed.
    elapsed = np.concatenate(([0], np.cumsum(np.maximum(np.diff(stamp_ns), 0))))
    late: BoolArray = elapsed >= min(
        SETTLING_TIME * NANOSECONDS_PER_SECOND, 0.5 * float(elapsed[-1])
    )
    return late


# Longer than any recording [s].
_NEVER = 1e9


@dataclass(frozen=True)
class IdentifiedSession:
    """Results of an estimator over a recording.

    Attributes
    ----------
    estimates : list of Estimate
        One every estimate period, and one after the last sample.
    stamp_ns, force, prediction : ndarray (samples,)
        Processed samples and their a-priori prediction [ns], [N], [N].
    usable : ndarray of bool (samples,)
        Whether the sample was learnt from.
    """

    estimates: list[Estimate]
    stamp_ns: IntArray
    force: FloatArray
    prediction: FloatArray
    usable: BoolArray

    @property
    def last(self) -> Estimate:
        """The estimate after the last sample."""
        return self.estimates[-1]

    @property
    def in_order(self) -> BoolArray:
        """Which samples (samples,) are usable and later than all before them."""
        stamps = self.stamp_ns
        newer = np.concatenate(([True], stamps[1:] > np.maximum.accumulate(stamps)[:-1]))
        part: BoolArray = self.usable & newer
        return part

    @property
    def shown_prediction(self) -> FloatArray:
        """The predictions (samples,) [N]; NaN before the first, where estimators state 0."""
        made = np.flatnonzero(self.prediction)
        first = int(made[0]) if len(made) else len(self.prediction)
        return np.where(np.arange(len(self.prediction)) < first, np.nan, self.prediction)

    @property
    def output_error(self) -> OutputError:
        """Error of the a-priori predictions over the whole session after settling."""
        return output_error(self.stamp_ns, self.force, self.shown_prediction, self.usable)


class _Trace(Monitor):
    """Keeps the processed samples."""

    def __init__(self) -> None:
        self.cells: list[ProcessedSamples] = []

    def processed_all(self, samples: ProcessedSamples) -> Mapping[str, int]:
        self.cells.append(samples)
        return {}

    def column(self, name: str) -> Any:
        """Return one of the arrays over all samples (samples,)."""
        return np.concatenate([getattr(cell, name) for cell in self.cells])


def identify(
    estimator: Estimator,
    pulses: PulseTrain,
    forces: ForceTrace,
    settings: StreamSettings | None = None,
    progress: Callable[[int], object] | None = None,
    samples_before_pulse: IntArray | None = None,
    sinks: Sequence[Monitor] = (),
    save_state: Path | None = None,
) -> IdentifiedSession:
    """Run an estimator over a recording, with the same result as on line.

    Parameters
    ----------
    estimator : Estimator
        Fresh estimator.  One that is not `on_line`, as ``batch``, makes a single estimate, after
        the last sample, whatever the period of the settings.
    pulses, forces : PulseTrain, ForceTrace
        The recording, in the order in which it was recorded.
    settings : StreamSettings or None
        Waiting times and estimate period; with those of the node the estimates are the same to
        the bit.
    progress : callable or None
        Called with the number of samples processed since the last call.
    samples_before_pulse : ndarray of int64 (pulses,) or None
        How many samples had arrived before each pulse, as recorded; None: see
        `recorded_order.in_time`.
    sinks : sequence of Monitor
        Further receivers of all samples, predictions and estimates.
    save_state : Path or None
        Where the state after the last sample is saved; see `rpms_ros.saved_state`.

    Returns
    -------
    IdentifiedSession
        Estimates and traces.

    Raises
    ------
    IdentificationError
        If there is no usable force sample.
    """
    settings = settings if settings is not None else StreamSettings()
    if not estimator.on_line:
        settings = replace(settings, estimate_period=_NEVER)
    trace = _Trace()
    stream = IdentificationStream(estimator, settings, [*sinks, trace])
    estimates: list[Estimate] = []
    for taken in feed(stream, pulses, forces, samples_before_pulse):
        estimates += stream.advance()
        if progress is not None:
            progress(taken)
    estimates += stream.finish()
    if not trace.cells:
        raise IdentificationError(_why_nothing(forces.force, settings.largest_force))
    if save_state is not None:
        save(save_state, stream)
    return IdentifiedSession(
        estimates,
        trace.column('stamp_ns'),
        trace.column('force'),
        trace.column('prediction'),
        trace.column('usable'),
    )


def _why_nothing(force: FloatArray, largest: float) -> str:
    """Return why no sample of a recording could be used."""
    finite = force[np.isfinite(force)]
    if not len(finite) or np.abs(finite).min() <= largest:
        return f'expected at least one finite force sample, got none among {len(force)}'
    return (
        f'expected a force of at most {largest:g} N or N m, got '
        f'{counted(len(finite), "sample")} from {finite.min():g} to {finite.max():g}: raw counts '
        'of an amplifier? --force-unit or --force-scale of rpms import decides'
    )
