# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Identification of a whole recording with the estimator that also runs on line.

Pulses and samples are fed to its stream in the order in which they arrived.

Error of the a-priori predictions of a session, in newtons and as a share of the range.
"""

import math
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.estimation.estimator import ProjectionEstimator
from rpms_ros.identification.estimation.prior import FittedMuscle
from rpms_ros.identification.model.estimate import Estimate, Estimator
from rpms_ros.identification.stream.arrivals import GAP_NS
from rpms_ros.identification.stream.monitors import Monitor, ProcessedSamples
from rpms_ros.identification.stream.stream import IdentificationStream, StreamSettings
from rpms_ros.printable import counted
from rpms_ros.pulses import (
    NANOSECONDS_PER_SECOND,
    BoolArray,
    FloatArray,
    ForceTrace,
    IntArray,
    PulseTrain,
    nanoseconds,
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
    # Not by BLAS, whose last bits depend on the number of its threads.
    newton = math.sqrt(float(np.mean(np.square(force[kept] - prediction[kept]))))
    span = float(np.ptp(force[usable]))
    return OutputError(newton, newton / span if span > 0.0 else math.nan)


def settled(stamp_ns: IntArray) -> BoolArray:
    """Return which samples (samples,) are past `SETTLING_TIME`, or past the middle if earlier."""
    # A jump back of the clock does not reduce the time that has passed.
    elapsed = np.cumsum(np.maximum(np.diff(stamp_ns, prepend=stamp_ns[:1]), 0))
    return elapsed >= min(SETTLING_TIME * NANOSECONDS_PER_SECOND, 0.5 * float(elapsed[-1]))


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
    muscle : FittedMuscle or None
        What a warm start needs, of an estimator that offers it and knows a curve.
    """

    estimates: list[Estimate]
    stamp_ns: IntArray
    force: FloatArray
    prediction: FloatArray
    usable: BoolArray
    muscle: FittedMuscle | None = None

    @property
    def last(self) -> Estimate:
        """The estimate after the last sample."""
        return self.estimates[-1]

    @property
    def in_order(self) -> BoolArray:
        """Which samples (samples,) are usable and later than all before them."""
        stamps = self.stamp_ns
        newer = np.concatenate(([True], stamps[1:] > np.maximum.accumulate(stamps)[:-1]))
        return self.usable & newer

    @property
    def shown_prediction(self) -> FloatArray:
        """The predictions (samples,) [N]; NaN before the first, where estimators state 0."""
        made = np.flatnonzero(self.prediction)
        first = int(made[0]) if len(made) else len(self.prediction)
        return np.where(np.arange(len(self.prediction)) < first, np.nan, self.prediction)

    @cached_property
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


def identify(
    estimator: Estimator,
    pulses: PulseTrain,
    forces: ForceTrace,
    settings: StreamSettings | None = None,
    progress: Callable[[int], object] | None = None,
    samples_before_pulse: IntArray | None = None,
    sinks: Sequence[Monitor] = (),
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
        `in_time`.
    sinks : sequence of Monitor
        Further receivers of all samples, predictions and estimates.

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
    with interrupts_held() as heed:
        for taken in feed(stream, pulses, forces, samples_before_pulse):
            estimates += stream.advance()
            heed()
            if progress is not None:
                progress(taken)
        estimates += stream.finish()
    if not trace.cells:
        raise IdentificationError(_why_nothing(forces.force, settings.largest_force))
    muscle = estimator.fitted() if isinstance(estimator, ProjectionEstimator) else None
    muscle = muscle if estimates[-1].curve_known else None
    names = ('stamp_ns', 'force', 'prediction', 'usable')
    columns = {name: np.concatenate([getattr(one, name) for one in trace.cells]) for name in names}
    return IdentifiedSession(estimates, muscle=muscle, **columns)


@contextmanager
def interrupts_held() -> Iterator[Callable[[], None]]:
    """Hold back an interrupt until the function that is yielded is called, or the end.

    Raised while numba loads a function, it crashes the process or is lost.  A second one is raised
    at once.
    """
    came: list[int] = []

    def hold(number: int, _: object) -> None:
        heed()
        came.append(number)

    def heed() -> None:
        if came:
            raise KeyboardInterrupt

    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield heed
        return
    signal.signal(signal.SIGINT, hold)
    try:
        yield heed
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    heed()


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


BLOCK = 10_000
# Pulses more than 10 s ahead of the force count as far: shorter blocks do not cause that.
_BLOCK_NS = nanoseconds(9.0)


def feed(
    stream: IdentificationStream,
    pulses: PulseTrain,
    forces: ForceTrace,
    samples_before_pulse: IntArray | None = None,
) -> Iterator[int]:
    """Add a recording to a stream block by block; yield how many samples each block had.

    Parameters
    ----------
    stream : IdentificationStream
        The stream; the caller advances it after each block.
    pulses, forces : PulseTrain, ForceTrace
        The recording, in the order in which it was recorded.
    samples_before_pulse : ndarray of int64 (pulses,) or None
        How many samples had arrived before each pulse; None: as `in_time` returns.
    """
    if samples_before_pulse is None:
        samples_before_pulse = in_time(pulses, forces, GAP_NS)
    order = np.argsort(samples_before_pulse, kind='stable')
    pulses, before = pulses[order], np.asarray(samples_before_pulse, dtype=np.int64)[order]
    start = 0
    while start < len(forces):
        stamps = forces.stamp_ns[start : start + BLOCK]
        far = np.flatnonzero(np.abs(stamps - stamps[0]) > _BLOCK_NS)
        stop = start + (int(far[0]) if len(far) else len(stamps))
        # Pulses after the last sample belong to the last block.
        end = stop if stop < len(forces) else stop + 1
        first, last = np.searchsorted(before, (start, end)).tolist()
        block = ForceTrace(forces.stamp_ns[start:stop], forces.force[start:stop])
        stream.add(pulses[first:last], block, before[first:last] - start)
        yield stop - start
        start = stop
    if not len(forces):
        stream.add_pulses(pulses)


def in_time(pulses: PulseTrain, forces: ForceTrace, gap_ns: int) -> IntArray:
    """Return how many samples precede each pulse (pulses,) if every message arrives in time.

    Pulses and samples are separate lists: the n-th jump back of the stamps in one is taken to be
    the n-th in the other.  Pulses of further jumps come after all samples.
    """
    starts = _line_starts(forces.stamp_ns, gap_ns)
    onsets = _line_starts(pulses.onset_ns, gap_ns)
    before = np.full(len(pulses), len(forces), dtype=np.int64)
    lines = pairwise([*starts, len(forces)]), pairwise([*onsets[: len(starts)], len(pulses)])
    for (start, stop), (first, last) in zip(*lines, strict=False):
        stamps = np.maximum.accumulate(_settled(forces.stamp_ns[start:stop], gap_ns))
        # The second sample of a time line confirms that the clock has jumped.
        least = start + 2 if start else 0
        found = start + np.searchsorted(stamps, pulses.onset_ns[first:last])
        before[first:last] = np.minimum(np.maximum(found, least), len(forces))
    return before


def _settled(stamp_ns: IntArray, gap_ns: int) -> IntArray:
    """Return the stamps (samples,); single ones far ahead are replaced by those before them.

    Otherwise one wrong stamp would make all later samples look late.
    """
    settled = stamp_ns.copy()
    for place in (np.flatnonzero(np.diff(stamp_ns) > gap_ns) + 1).tolist():
        if place + 1 < len(stamp_ns) and stamp_ns[place + 1] - stamp_ns[place - 1] <= gap_ns:
            settled[place] = settled[place - 1]
    return settled


def _line_starts(stamp_ns: IntArray, gap_ns: int) -> list[int]:
    """Return 0 and the places where stamps (n,) jump back by more than a gap for good."""
    starts = [0]
    for place in np.flatnonzero(np.diff(stamp_ns) < -gap_ns) + 1:
        # A single wrong stamp is no new time line: the stamps after it have to follow it.
        before, here = int(stamp_ns[place - 1]), int(stamp_ns[place])
        after = int(stamp_ns[place + 1]) if place + 1 < len(stamp_ns) else here
        jumped_ahead = place > 1 and before - int(stamp_ns[place - 2]) > gap_ns >= (
            abs(here - int(stamp_ns[place - 2]))
        )
        if after < before - gap_ns and not jumped_ahead:
            starts.append(int(place))
    return starts
