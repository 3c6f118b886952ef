# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Alignment of pulses and force by their stamps, in front of an estimator.

A force sample waits until the newest one is `reorder_delay` later; by then every pulse that could
act on it has arrived.  The result depends on stamps, values, sequence numbers and the order of
arrival alone, so a replay of a recording gives the same estimates as on line, to the bit, however
it is cut into blocks.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rpms_ros.errors import IdentificationError, check_number
from rpms_ros.identification.model.estimate import Estimate, Estimator, PredictingEstimator
from rpms_ros.identification.quality import doubts as faults
from rpms_ros.identification.quality.doubts import (
    RESPONSE_MISFIT,
    Doubts,
    FaultCounter,
    ResponseMisfit,
)
from rpms_ros.identification.stream.monitors import Monitor, Pipeline
from rpms_ros.identification.stream.pulse_queue import (
    FAR_NS,
    LONG_AGO,
    Alignment,
    PulseQueue,
    StrayPulses,
)
from rpms_ros.identification.stream.sensor_checks import MONITORS, monitors_by_name
from rpms_ros.pulses import (
    NANOSECONDS_PER_SECOND,
    BoolArray,
    FloatArray,
    ForceTrace,
    IntArray,
    PulseTrain,
    nanoseconds,
)

LARGEST_FORCE = 10_000.0
"""No muscle and no sensor for people reaches it [N]."""


@dataclass(frozen=True)
class StreamSettings:
    """Settings of the alignment of samples and pulses.

    Attributes
    ----------
    reorder_delay : float
        How long a sample waits for late pulses, and for the samples after it that show whether it
        is an outlier [s]; below 20 ms samples are not checked before they are learnt from.
    pulse_look_ahead : float
        Up to this time after a sample pulses are checked before it is used [s]; a pulse may be
        late by the rest of `reorder_delay`.
    estimate_period : float
        Time between two estimates, by the stamps [s].
    largest_force : float
        Samples with a larger force, of either sign, are dropped [N].
    monitors : tuple of str
        Names of the monitors, of `rpms_ros.identification.stream.sensor_checks` or of other
        packages.

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    reorder_delay: float = 0.2
    pulse_look_ahead: float = 0.1
    estimate_period: float = 0.1
    largest_force: float = LARGEST_FORCE
    monitors: tuple[str, ...] = tuple(MONITORS)

    def __post_init__(self) -> None:
        refused = IdentificationError
        check_number(refused, 'reorder_delay', self.reorder_delay, 0, unit='s')
        most = self.reorder_delay
        check_number(refused, 'pulse_look_ahead', self.pulse_look_ahead, 0, most, unit='s')
        for name, unit in (('estimate_period', 's'), ('largest_force', 'N')):
            check_number(refused, name, getattr(self, name), 0, above=True, unit=unit)


# Longest pause of the force that does not count as a gap [ns].
GAP_NS = NANOSECONDS_PER_SECOND
# Most samples that may wait: a block of the batch at 100 kHz, and the delays before and after it.
MOST_WAITING = 600_000
# So many samples out of order within this time are treated as a fault that lasts [1], [ns].
_DISORDER = 3
_DISORDER_NS = NANOSECONDS_PER_SECOND


class ForceIntake:
    """Takes samples in the order of arrival and keeps them, with rising stamps, until processed.

    Samples that are not finite, larger than a limit, repeated or stamped wrongly are dropped and
    counted; a stamp far from its predecessor is accepted when a second one follows it.

    Parameters
    ----------
    stream : IdentificationStream
        Receives faults and gaps.
    memory_ns : int
        How long learning is suspended after samples out of order [ns].
    """

    def __init__(self, stream: 'IdentificationStream', memory_ns: int) -> None:
        self._line = stream
        self._memory_ns = memory_ns
        self._largest_force = stream.settings.largest_force
        self._waiting: list[tuple[IntArray, FloatArray]] = []
        self._count = 0
        self.newest_ns: int | None = None
        self._newest_force = 0.0
        # a sample that waits for another one to confirm its stamp
        self.alone: tuple[int, float] | None = None
        self._out_of_order: deque[int] = deque(maxlen=_DISORDER)

    def add(self, forces: ForceTrace) -> None:
        """Add force samples; bad ones are dropped and counted."""
        if not len(forces):
            return
        finite = np.isfinite(forces.force)
        bad = ~self.believes(forces.force)
        start = 0
        for place in (*np.flatnonzero(bad).tolist(), len(bad)):
            if place > start:
                self._take(forces.stamp_ns[start:place], forces.force[start:place])
            if place < len(bad):
                name = faults.FORCE_OUT_OF_BOUNDS if finite[place] else faults.FORCE_NOT_FINITE
                self._line.postpone(name)
            start = place + 1

    def believes(self, force: FloatArray) -> BoolArray:
        """Return which values (samples,) can be forces."""
        with np.errstate(invalid='ignore'):
            believed: BoolArray = np.abs(force) <= self._largest_force
        return believed

    @property
    def first_ns(self) -> int | None:
        """Stamp of the first sample that waits [ns]."""
        return int(self._waiting[0][0][0]) if self._waiting else None

    def take(self, until_ns: int) -> tuple[IntArray, FloatArray, int]:
        """Return all waiting samples (samples,), and how many have stamps up to `until_ns` [ns].

        The latter are removed; some have to wait.
        """
        stamps = np.concatenate([stamps for stamps, _ in self._waiting])
        values = np.concatenate([values for _, values in self._waiting])
        due = int(np.searchsorted(stamps, until_ns, side='right'))
        self._waiting = [(stamps[due:], values[due:])] if due < len(stamps) else []
        self._count = len(stamps) - due
        return stamps, values, due

    def drop_alone(self) -> None:
        """Drop the sample whose stamp was not confirmed."""
        if self.alone is not None:
            self._line.postpone(faults.FORCE_STAMP_ALONE)
            self.alone = None

    def _take(self, stamps: IntArray, values: FloatArray) -> None:
        """Take samples (samples,) of possible values, with stamps of any kind."""
        steps = np.diff(stamps)
        irregular = np.flatnonzero((steps <= 0) | (steps > GAP_NS)) + 1
        ends = np.append(irregular, len(stamps))
        start = 0
        while start < len(stamps):
            if not self._goes_on(int(stamps[start]), float(values[start])):
                start += 1
                continue
            end = int(ends[np.searchsorted(ends, start, side='right')])
            self._keep(stamps[start:end], values[start:end])
            start = end

    def _goes_on(self, stamp_ns: int, value: float) -> bool:
        """Return whether a sample continues the time line."""
        if self.newest_ns is None:
            return True
        step = stamp_ns - self.newest_ns
        if -GAP_NS <= step <= 0:
            self._refuse(step, value)
            return False
        if abs(step) > GAP_NS and not self._follow_alone(stamp_ns, value):
            return False
        self.drop_alone()
        return True

    def _keep(self, stamps: IntArray, values: FloatArray) -> None:
        room = MOST_WAITING - self._count
        for _ in range(len(stamps) - room):
            self._line.postpone(faults.FORCE_QUEUE_FULL)
        if room > 0:
            self._waiting.append((stamps[:room], values[:room]))
            self._count += len(stamps[:room])
        self.newest_ns = int(stamps[-1])
        self._newest_force = float(values[-1])

    def _refuse(self, step: int, value: float) -> None:
        """Count a sample that is stamped like or before its predecessor."""
        assert self.newest_ns is not None
        if step == 0 and value == self._newest_force:
            self._line.postpone(faults.FORCE_DUPLICATE)
            return
        if step == 0:
            self._line.postpone(faults.FORCE_CONFLICT)
            self._line.exclude(self.newest_ns - 1, self.newest_ns)
        else:
            self._line.postpone(faults.FORCE_STAMP_NOT_AFTER_LAST)
        self._out_of_order.append(self.newest_ns)
        first_ns = self._out_of_order[0]
        if len(self._out_of_order) == _DISORDER and self.newest_ns - first_ns <= _DISORDER_NS:
            self._line.exclude(first_ns - 1, self.newest_ns + self._memory_ns)

    def _follow_alone(self, stamp_ns: int, value: float) -> bool:
        """Accept a stamp far from its predecessor when a second one follows it.

        Otherwise one wrong stamp would count as two jumps of the clock.  Returns whether
        `stamp_ns` confirms the sample that is waiting alone; if not, it waits in its place.
        """
        if self.alone is None or not 0 < stamp_ns - self.alone[0] <= GAP_NS:
            self.drop_alone()
            self.alone = (stamp_ns, value)
            return False
        (first_ns, first), self.alone = self.alone, None
        assert self.newest_ns is not None
        if first_ns < self.newest_ns:
            self._line.jump_back(first_ns)
        else:
            # unknown pulses may have been given during the gap
            self._line.postpone(faults.FORCE_GAP)
            self._line.exclude(self.newest_ns, first_ns + self._memory_ns)
        self._out_of_order.clear()
        self._keep(np.array([first_ns]), np.array([first]))
        return True


# A spike within this time after a pulse is a stimulation artifact [ns].
_ARTIFACT_NS = 10_000_000
# Cells of the monitors' grid between two records of the counts of faults.
_NOTE_CELLS = 10
# The same between two looks at how pulses and force belong together; every half minute where what
# was found stays.
_ALIGN_CELLS = 50


class IdentificationStream:
    """Aligns pulses and force by their stamps and feeds an estimator.

    Parameters
    ----------
    estimator : Estimator
        The estimator.
    settings : StreamSettings
        Waiting times, estimate period, bounds and the names of monitors.
    sinks : sequence of Monitor
        Further monitors, which receive all samples, predictions and estimates.
    """

    def __init__(
        self,
        estimator: Estimator,
        settings: StreamSettings | None = None,
        sinks: Sequence[Monitor] = (),
    ) -> None:
        settings = settings if settings is not None else StreamSettings()
        monitors = [*monitors_by_name(settings.monitors), *sinks]
        further = {name: what for one in monitors for name, what in one.faults.items()}
        shares = {name: share for one in monitors for name, share in one.doubtful.items()}
        self.settings = settings
        self.estimator = estimator
        self._counter = FaultCounter(further)
        self._memory_ns = nanoseconds(estimator.memory)
        self._reorder_delay_ns = nanoseconds(settings.reorder_delay)
        self._pulse_look_ahead_ns = nanoseconds(settings.pulse_look_ahead)
        self._queue = PulseQueue(self._memory_ns, self._pulse_look_ahead_ns, self._counter)
        self._strays = StrayPulses(2 * self._pulse_look_ahead_ns + self._memory_ns)
        self._intake = ForceIntake(self, self._memory_ns)
        # samples after this stamp are predicted and not learnt from [ns]
        self._held_ns: int | None = None
        self._alignment = Alignment(lasting=not estimator.on_line)
        self._doubts = Doubts(shares, lasting=not estimator.on_line)
        self._period_ns = nanoseconds(settings.estimate_period)
        waits_ns = self._reorder_delay_ns, self._pulse_look_ahead_ns
        self._pipeline = Pipeline(monitors, *waits_ns, self._counter, estimator.on_line)
        self._cell: int | None = None
        self._block: int | None = None
        self._finished: list[Estimate] = []
        self._predictor = estimator if isinstance(estimator, PredictingEstimator) else None
        self._last_ns = 0
        self._samples = 0
        self._cells = 0
        self._acting_ns = np.empty(0, dtype=np.int64)
        self._settled_early = np.empty(0, dtype=np.int64), np.empty(0)
        self._misfit = ResponseMisfit()

    @property
    def held(self) -> bool:
        """Whether `hold` was called: samples are predicted only."""
        return self._held_ns is not None

    @property
    def fault_counts(self) -> dict[str, int]:
        """Counts of faults so far by name, those of waiting samples included."""
        return self._counter.counts(postponed=True)

    def add_pulses(self, pulses: PulseTrain) -> None:
        """Add pulses, in any order, valid or not."""
        newest_ns = self._intake.newest_ns
        if newest_ns is None or not len(pulses):
            self._queue.add(pulses)
            return
        late = pulses.onset_ns <= newest_ns - self._reorder_delay_ns + self._pulse_look_ahead_ns
        apart = late | (pulses.onset_ns > newest_ns + FAR_NS)
        self._alignment.arrived_apart(pulses.onset_ns[apart], newest_ns)
        self._queue.add(pulses[~late], newest_ns)
        # Far too late for this time line; they belong to the next one if the clock has jumped.
        stray = pulses.onset_ns < newest_ns - GAP_NS
        self._strays.add(pulses[stray], newest_ns)
        for onset_ns in pulses.onset_ns[late & ~stray].tolist():
            self._counter.postpone(faults.PULSE_LATE, newest_ns)
            self.exclude(onset_ns, onset_ns + self._memory_ns)

    def hold(self) -> None:
        """Predict without learning, from the sample after the newest one on."""
        if self._held_ns is None:
            newest_ns = self._intake.newest_ns
            self._held_ns = LONG_AGO if newest_ns is None else newest_ns

    def resume(self) -> None:
        """Learn again as soon as the pulses given meanwhile no longer act."""
        held_ns, newest_ns = self._held_ns, self._intake.newest_ns
        self._held_ns = None
        if held_ns is not None and newest_ns is not None:
            self.exclude(held_ns, newest_ns + self._memory_ns)

    def add(self, pulses: PulseTrain, forces: ForceTrace, before: IntArray) -> None:
        """Add samples, and pulses in the order in which they came between them.

        Parameters
        ----------
        pulses, forces : PulseTrain, ForceTrace
            In the order of arrival.
        before : ndarray of int64 (pulses,)
            How many of the samples had arrived before each pulse, ascending.
        """
        stamps, values = forces.stamp_ns, forces.force
        if not len(pulses) or (len(stamps) and self._takes_early(pulses, forces, before)):
            # None of them is late, so their place among the samples makes no difference.
            self.add_pulses(pulses)
            self.add_forces(forces)
            return
        begin = 0
        for end in np.unique(before).tolist():
            self.add_forces(ForceTrace(stamps[begin:end], values[begin:end]))
            begin = end
            first, last = np.searchsorted(before, (end, end + 1)).tolist()
            for index in range(first, last):
                self.add_pulses(pulses[index : index + 1])
        self.add_forces(ForceTrace(stamps[begin:], values[begin:]))

    def _takes_early(self, pulses: PulseTrain, forces: ForceTrace, before: IntArray) -> bool:
        """Return whether pulses may be added before samples that arrived before them.

        They may if the forces (samples,) can be forces and have no gap or jump, and no pulse is
        late or far; `before` (pulses,) is how many of the samples arrived before each pulse.
        """
        newest_ns, stamp_ns = self._intake.newest_ns, forces.stamp_ns
        if not self._intake.believes(forces.force).all():
            return False
        if newest_ns is None and len(pulses):
            # There is room for so many before the first sample.
            return False
        line = stamp_ns if newest_ns is None else np.append(newest_ns, stamp_ns)
        steps = np.diff(line)
        if self._intake.alone is not None or not ((steps > 0) & (steps <= GAP_NS)).all():
            return False
        if not (pulses.onset_ns <= line[0] + FAR_NS).all():
            return False
        used_ns = line[before] - self._reorder_delay_ns
        return bool((pulses.onset_ns > used_ns + self._pulse_look_ahead_ns).all())

    def add_forces(self, forces: ForceTrace) -> None:
        """Add force samples; bad ones are dropped and counted."""
        self._intake.add(forces)

    def postpone(self, name: str) -> None:
        """Count a fault when the samples up to the newest one are processed."""
        self._counter.postpone(name, self._intake.newest_ns)

    def exclude(self, start_ns: int, end_ns: int) -> None:
        """Do not learn from samples after `start_ns` up to `end_ns` that are not yet due.

        Samples are due `reorder_delay` before the newest one.  Due samples that wait all the same
        are learnt from, so that the result does not depend on when `advance` is called.
        """
        if self._intake.newest_ns is not None:
            start_ns = max(start_ns, self._intake.newest_ns - self._reorder_delay_ns)
        if start_ns < end_ns:
            self._queue.exclude(start_ns, end_ns)

    def advance(self) -> list[Estimate]:
        """Process the samples that have waited long enough; return the estimates due."""
        if self._intake.newest_ns is not None:
            self._release(self._intake.newest_ns - self._reorder_delay_ns, complete=True)
        finished, self._finished = self._finished, []
        return finished

    def finish(self) -> list[Estimate]:
        """Process all waiting samples; return the estimates, the last one included."""
        self._intake.drop_alone()
        self._end_of_line()
        if self._intake.newest_ns is not None:
            self._alignment.judge(self._intake.newest_ns)
            self._make_estimate()
        finished, self._finished = self._finished, []
        return finished

    def estimate(self) -> Estimate:
        """Return the estimate after the newest processed sample."""
        counts = self._counter.counts()
        estimate = self.estimator.estimate(self._last_ns, counts)
        doubts = (*self._doubts.names(self._samples, counts), *estimate.doubts)
        if self._misfit.doubted and estimate.curve_known:
            doubts = (*doubts, RESPONSE_MISFIT)
        found = self._alignment.found
        reasons = (*estimate.reasons, *found.values())
        return replace(estimate, doubts=(*found, *doubts), reasons=reasons)

    def jump_back(self, stamp_ns: int) -> None:
        """Start a new time line; waiting samples belong to the old one."""
        newest_ns = self._intake.newest_ns
        assert newest_ns is not None
        overtaking = self._strays.taken(newest_ns)
        self._end_of_line()
        self._counter.add(faults.CLOCK_JUMP)
        self._queue.restart()
        self._queue.add(overtaking, stamp_ns)
        self._pipeline.restart()
        self._misfit.restart()
        self._alignment.restart()
        self.estimator.forget_pulses()
        self._queue.exclude(stamp_ns - 1, stamp_ns + self._memory_ns)
        if self._held_ns is not None:
            self._held_ns = stamp_ns - 1
        self._cell = self._block = None
        self._acting_ns = np.empty(0, dtype=np.int64)
        self._settled_early = np.empty(0, dtype=np.int64), np.empty(0)

    def _end_of_line(self) -> None:
        if self._intake.newest_ns is not None:
            self._release(self._intake.newest_ns)
        self._count_postponed(None)
        self._flush()

    def _release(self, until_ns: int, complete: bool = False) -> None:
        """Process the waiting samples with stamps up to `until_ns`; off line `complete` blocks."""
        first_ns = self._intake.first_ns
        if first_ns is None:
            return
        if self._cell is None:
            self._queue.begin(first_ns)
            self._pipeline.begin(first_ns)
        if complete and not self.estimator.on_line:
            until_ns = self._pipeline.block_of(until_ns) - 1
        stamps, values, due = self._intake.take(until_ns)
        if not due:
            return
        cell = stamps[:due] // self._period_ns
        block = self._pipeline.blocks_of(stamps[:due])
        starts = np.flatnonzero((np.diff(cell) != 0) | (np.diff(block) != 0)) + 1
        for first, last in zip((0, *starts.tolist()), (*starts.tolist(), due), strict=True):
            self._cross_into(int(cell[first]), int(block[first]))
            marks = self._pipeline.examine(stamps, values, first, last, self._predicted)
            self._process(stamps[first:last], values[first:last], marks)

    def _cross_into(self, cell: int, block: int) -> None:
        """Pass a complete block to the monitors; make an estimate when one is due."""
        ends_cell = self._cell is not None and cell != self._cell
        ends_block = self._block is not None and block != self._block
        if ends_cell or ends_block:
            # Faults found after the last sample of the old cell count here, however the data are
            # cut into blocks.
            self._count_postponed(self._last_ns)
        if ends_block:
            self._flush()
        if ends_cell:
            self._make_estimate()
        self._cell, self._block = cell, block

    def _make_estimate(self) -> None:
        estimate = self.estimate()
        self._finished.append(estimate)
        self._pipeline.estimated(estimate)

    def _flush(self) -> None:
        samples, cells = self._pipeline.flush()
        self._samples += samples
        before, self._cells = self._cells, self._cells + cells
        if self._cells // _NOTE_CELLS > before // _NOTE_CELLS:
            self._doubts.note(self._cells, self._samples, self._counter.counts())
        align = _ALIGN_CELLS if self.estimator.on_line else 6 * _ALIGN_CELLS
        if self._cells // align > before // align:
            self._alignment.judge(self._last_ns)

    def _process(self, stamps: IntArray, values: FloatArray, marks: IntArray) -> None:
        onset, intensity = self._settle(int(stamps[-1]))
        usable = ~self._queue.unknown(stamps) & (marks == 0)
        if self._held_ns is not None:
            usable &= stamps <= self._held_ns
        prediction = self.estimator.update(stamps, values, usable)
        if self.estimator.on_line:
            self._misfit.add_pulses(onset, intensity)
            self._misfit.add(stamps, values, prediction, usable)
        self._count_postponed(int(stamps[-1]))
        self._count_marks(stamps, marks, onset)
        self._counter.add(faults.SAMPLES_EXCLUDED, int(np.count_nonzero(~usable)))
        self._last_ns = int(stamps[-1])
        self._alignment.add(stamps, values, onset, intensity)
        self._pipeline.add(stamps, values, prediction, usable, onset, intensity)

    def _settle(self, stamp_ns: int) -> tuple[IntArray, FloatArray]:
        """Pass settled pulses to the estimator; return those since the last sample."""
        begun_ns = self._pipeline.block_of(stamp_ns)
        onset, intensity = self._queue.settle(
            stamp_ns + self._pulse_look_ahead_ns, begun_ns + self._pulse_look_ahead_ns
        )
        self.estimator.add_pulses(onset, intensity)
        before, self._settled_early = self._settled_early, (onset[:0], intensity[:0])
        return np.concatenate((before[0], onset)), np.concatenate((before[1], intensity))

    def _predicted(self, stamp_ns: IntArray) -> FloatArray | None:
        """Return the prediction of samples (samples,) that the estimator has not seen [N]."""
        if self._predictor is None:
            return None
        # all that is due, and no more: later pulses may still arrive
        due_ns = max(int(stamp_ns[0]), int(stamp_ns[-1]) - self._pulse_look_ahead_ns)
        self._settled_early = self._settle(due_ns)
        return self._predictor.predict(stamp_ns)

    def _count_marks(self, stamps: IntArray, marks: IntArray, onset_ns: IntArray) -> None:
        """Count the faults that the monitors found; spikes after a pulse are artifacts."""
        acting = np.concatenate((self._acting_ns, onset_ns))
        self._acting_ns = acting[acting > stamps[-1] - _ARTIFACT_NS]
        for name, concerned in self._pipeline.concerned(marks).items():
            count = int(np.count_nonzero(concerned))
            if name == faults.FORCE_SPIKE and len(acting):
                artifacts = int(np.count_nonzero(_after(stamps[concerned], acting)))
                self._counter.add(faults.FORCE_ARTIFACT, artifacts)
                count -= artifacts
            self._counter.add(name, count)

    def _count_postponed(self, until_ns: int | None) -> None:
        self._counter.count_until(until_ns)
        self._counter.add(faults.PULSE_LATE, self._strays.given_up(until_ns))


def _after(stamp_ns: IntArray, onset_ns: IntArray) -> BoolArray:
    """Return which stamps (samples,) are soon after one of the onsets (pulses,), ascending."""
    place = np.searchsorted(onset_ns, stamp_ns, side='right')
    since: BoolArray = stamp_ns - onset_ns[np.maximum(place - 1, 0)] <= _ARTIFACT_NS
    return since & (place > 0)
