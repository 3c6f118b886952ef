# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Alignment of pulses and force by their stamps, in front of an estimator.

A force sample waits until the newest one is `reorder_delay` later; by then every pulse that could
act on it has arrived.  The result depends on stamps, values, sequence numbers and the order of
arrival alone, so a replay of a recording gives the same estimates as on line, to the bit, however
it is cut into blocks.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from rpms_ros.errors import IdentificationError, check_number
from rpms_ros.identification.model.estimate import Estimate, Estimator, PredictingEstimator
from rpms_ros.identification.quality import doubts as faults
from rpms_ros.identification.quality.doubts import (
    CHANGED_LATELY,
    Alignment,
    Doubts,
    FaultCounter,
    IntensitySteps,
    ResponseMisfit,
)
from rpms_ros.identification.stream.arrivals import (
    FAR_NS,
    GAP_NS,
    LONG_AGO,
    ForceIntake,
    PulseQueue,
    StrayPulses,
)
from rpms_ros.identification.stream.monitors import Monitor, ProcessedSamples, Window
from rpms_ros.identification.stream.sensor_checks import MONITORS, monitors_by_name
from rpms_ros.pulses import BoolArray, FloatArray, ForceTrace, IntArray, PulseTrain, nanoseconds

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


CELL_NS = 100_000_000
# With a shorter delay there are no samples around one before it is used.
LEAST_DELAY_NS = 20_000_000
# Cells of a block on line; and of a recording: for the first 20 s, in which outliers are to be
# found as soon as the force is predicted, and then.
_ONE_BY_ONE, _TOGETHER = (1, 1), (10, 100)
_SHORT_FOR_NS = 20_000_000_000
Answer = TypeVar('Answer')
# The columns of `ProcessedSamples`: of samples, and of pulses.
_Samples = tuple[IntArray, FloatArray, FloatArray, BoolArray]
_Pulses = tuple[IntArray, FloatArray]


class Pipeline:
    """Monitors of one stream.

    Parameters
    ----------
    monitors : sequence of Monitor
        Called in this order.
    delay_ns : int
        Least time for which samples wait before they are used [ns]; a cell is at most half as
        long, so that the samples of another cell after it are known.
    look_ahead_ns : int
        Up to this time after a sample the pulses are known [ns]; cells are not longer if samples
        are predicted.
    counter : FaultCounter
        Where faults are counted.
    on_line : bool
        Whether cells are examined one by one.
    """

    def __init__(
        self,
        monitors: Sequence[Monitor],
        delay_ns: int,
        look_ahead_ns: int,
        counter: FaultCounter,
        on_line: bool = True,
    ) -> None:
        self._monitors = list(monitors)
        self._counter = counter
        self._examines = delay_ns >= LEAST_DELAY_NS
        self.cell_ns = min(delay_ns // 2, CELL_NS) if self._examines else CELL_NS
        self._predicts = self._examines and look_ahead_ns >= LEAST_DELAY_NS // 2
        if self._predicts:
            self.cell_ns = min(self.cell_ns, look_ahead_ns)
        self._cells = _ONE_BY_ONE if on_line else _TOGETHER
        self._look_ahead_ns = look_ahead_ns
        self._long_from_ns = 0
        self._block: int | None = None
        self._found: dict[str, BoolArray] = {}
        self._before = np.empty(0, dtype=np.int64), np.empty(0)
        self._samples: list[_Samples] = []
        self._pulses: list[_Pulses] = []

    def begin(self, stamp_ns: int) -> None:
        """Take the stamp of the first sample of a time line [ns]."""
        self._long_from_ns = stamp_ns + _SHORT_FOR_NS

    def blocks_of(self, stamp_ns: IntArray) -> IntArray:
        """Return where the blocks of cells begin to which stamps (samples,) belong [ns]."""
        short_ns, long_ns = (cells * self.cell_ns for cells in self._cells)
        begin_ns = stamp_ns // long_ns * long_ns
        return np.where(begin_ns >= self._long_from_ns, begin_ns, stamp_ns // short_ns * short_ns)

    def block_of(self, stamp_ns: int) -> int:
        """Return where the block of cells begins to which a stamp belongs [ns]."""
        return int(self.blocks_of(np.array([stamp_ns]))[0])

    def examine(
        self,
        stamp_ns: IntArray,
        force: FloatArray,
        first: int,
        last: int,
        predicted: Callable[[IntArray], FloatArray | None],
    ) -> dict[str, BoolArray]:
        """Return which of the samples first .. last - 1 of one block of cells have each fault.

        `stamp_ns` and `force` (samples,) are all waiting samples, ascending; those before `first`
        have been examined.  `predicted` returns the prediction of the samples of a block.
        """
        if not self._examines:
            return {}
        grid_ns = self._grid_ns(int(stamp_ns[first]))
        if int(grid_ns[0]) != self._block:
            self._block = int(grid_ns[0])
            # the block begins with sample `first`; a cell before and after it is seen too
            high = int(np.searchsorted(stamp_ns, grid_ns[-1] + self.cell_ns))
            low = int(np.searchsorted(self._before[0], grid_ns[0] - self.cell_ns))
            stamps = np.concatenate((self._before[0][low:], stamp_ns[first:high]))
            around = np.concatenate((self._before[1][low:], force[first:high]))
            edges = np.concatenate(([0], np.searchsorted(stamps, grid_ns), [len(stamps)]))
            inside = slice(edges[1], edges[-2])
            found = np.zeros_like(stamps[inside], dtype=np.bool_)
            known = predicted(stamps[inside]) if self._predicts else None
            self._found = self._faults(Window(stamps, around, edges, found, known))
        before = (
            np.concatenate((self._before[0], stamp_ns[first:last])),
            np.concatenate((self._before[1], force[first:last])),
        )
        kept = int(np.searchsorted(before[0], grid_ns[-1] - 2 * self.cell_ns))
        self._before = before[0][kept:], before[1][kept:]
        here = {name: one[: last - first] for name, one in self._found.items()}
        self._found = {name: one[last - first :] for name, one in self._found.items()}
        return here

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Keep pulses (pulses,) that the estimator got, ascending, for the present block."""
        self._pulses.append((onset_ns, intensity))

    def add(self, *samples: *_Samples) -> None:
        """Keep processed samples until their block is complete; see `ProcessedSamples`."""
        self._samples.append(samples)

    def flush(self) -> tuple[ProcessedSamples, int] | None:
        """Pass the complete block to the monitors; return it and its number of cells, if any."""
        if not self._samples:
            return None
        samples, pulses = (
            [np.concatenate(parts) for parts in zip(*kept, strict=True)]
            for kept in (self._samples, self._pulses)
        )
        self._samples, self._pulses = [], []
        stamps, onset_ns = samples[0], pulses[0]
        grid_ns = self._grid_ns(int(stamps[0]))
        edges = np.searchsorted(stamps, grid_ns)
        edges = np.append(edges[:-1][np.diff(edges) > 0], len(stamps))
        known_ns = stamps[edges[1:-1] - 1] + self._look_ahead_ns
        inner = np.searchsorted(onset_ns, known_ns, side='right')
        columns = [*samples, *pulses, edges, np.concatenate(([0], inner, [len(onset_ns)]))]
        whole = ProcessedSamples(*columns)
        for monitor in list(self._monitors):
            none: Mapping[str, int] = {}
            for name, count in self._ask(monitor, monitor.processed_all, whole, none).items():
                self._counter.add(name, int(count))
        return whole, len(grid_ns) - 1

    def estimated(self, estimate: Estimate) -> None:
        """Pass an estimate to the monitors."""
        for monitor in list(self._monitors):
            self._ask(monitor, monitor.estimated, estimate, None)

    def restart(self) -> None:
        """Forget earlier stamps: the clock has jumped back."""
        self._block, self._found = None, {}
        self._before = np.empty(0, dtype=np.int64), np.empty(0)
        for monitor in self._monitors:
            monitor.restart()

    def _grid_ns(self, stamp_ns: int) -> IntArray:
        """Return where the cells of the block of a stamp begin, and where the last one ends."""
        begin_ns = self.block_of(stamp_ns)
        long_ns = self._cells[1] * self.cell_ns
        long = stamp_ns // long_ns * long_ns >= self._long_from_ns
        return begin_ns + self.cell_ns * np.arange(self._cells[long] + 1)

    def _faults(self, window: Window) -> dict[str, BoolArray]:
        """Return which samples of a block have each fault, all monitors together."""
        faulty: dict[str, BoolArray] = {}
        for monitor in list(self._monitors):
            found: Mapping[str, BoolArray] = self._ask(monitor, monitor.examine_all, window, {})
            for name, concerned in found.items():
                faulty.setdefault(name, np.zeros_like(window.found))[concerned] = True
                window.found[concerned] = True
        return {name: one for name, one in faulty.items() if one.any()}

    def _ask(
        self, monitor: Monitor, method: Callable[..., Answer], what: object, otherwise: Answer
    ) -> Answer:
        """Return the result of a monitor; remove the monitor if it raises."""
        try:
            return method(what)
        # A monitor that fails must not stop the identification.
        except Exception:  # noqa: BLE001
            self._monitors.remove(monitor)
            self._counter.add(faults.MONITOR_FAILED)
            return otherwise


# A spike within this time after a pulse is a stimulation artifact [ns].
_ARTIFACT_NS = 10_000_000
# Cells of the monitors' grid between two records of the counts of faults.
_NOTE_CELLS = 10
# The same between two looks at how pulses and force belong together; every half minute where what
# was found stays.
_ALIGN_CELLS = 50
# For so long after a change a recursion may not have seen what it left, on a slow course [s].
_SLOWLY_S = 20.0


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
        # and as it was before any sample, for a beginning amid stimulation: there is one at most
        self.estimator, self._fresh = estimator, deepcopy(vars(estimator))
        self._counter = FaultCounter(further)
        self._memory_ns = nanoseconds(estimator.memory)
        self._reorder_delay_ns = nanoseconds(settings.reorder_delay)
        self._pulse_look_ahead_ns = nanoseconds(settings.pulse_look_ahead)
        self._queue = PulseQueue(self._memory_ns, self._pulse_look_ahead_ns, self._counter)
        overtaking_ns = 2 * self._pulse_look_ahead_ns + self._memory_ns
        self._strays = StrayPulses(overtaking_ns, self._counter)
        self._intake = ForceIntake(
            self._queue, self._reorder_delay_ns, settings.largest_force, self._jump_back
        )
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
        self._last_ns = self._samples = self._cells = 0
        self._acting_ns = np.empty(0, dtype=np.int64)
        self._misfit, self._steps = ResponseMisfit(), IntensitySteps()

    @property
    def held(self) -> bool:
        """Whether `hold` was called: samples are predicted only."""
        return self._held_ns is not None

    @property
    def fault_counts(self) -> dict[str, int]:
        """Counts of faults so far by name, those of waiting samples included."""
        newest_ns = self._intake.newest_ns
        return self._counter.counts(LONG_AGO if newest_ns is None else newest_ns)

    def miss(self, samples: int) -> None:
        """Count force samples that were lost before they could be added."""
        self._counter.add(faults.FORCE_QUEUE_FULL, samples)

    def add_pulses(self, pulses: PulseTrain) -> None:
        """Add pulses, in any order, valid or not."""
        newest_ns = self._intake.newest_ns
        if newest_ns is None or not len(pulses):
            self._queue.add(pulses)
            return
        late = pulses.onset_ns <= newest_ns - self._reorder_delay_ns + self._pulse_look_ahead_ns
        apart = late | (pulses.onset_ns > newest_ns + FAR_NS)
        if apart.any():
            self._alignment.arrived_apart(pulses.onset_ns[apart], newest_ns)
        self._queue.add(pulses[~late], newest_ns)
        # Far too late for this time line; they belong to the next one if the clock has jumped.
        stray = late & (pulses.onset_ns < newest_ns - GAP_NS)
        self._strays.add(pulses[stray], newest_ns)
        for onset_ns in pulses.onset_ns[late & ~stray].tolist():
            self._counter.postpone(faults.PULSE_LATE, newest_ns)
            self._intake.exclude(onset_ns, onset_ns + self._memory_ns)

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
            self._queue.exclude(held_ns, newest_ns + self._memory_ns)

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
        newest_ns = self._intake.newest_ns
        # There is room for so many pulses before the first sample.
        if newest_ns is None or not self._intake.believes(forces.force).all():
            return False
        line = np.append(newest_ns, forces.stamp_ns)
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
        doubts += self._misfit.doubts(estimate, self.estimator.on_line)
        found, slow = self._alignment.found, self._steps.reasons(estimate)
        # seen once on a slow course, a muscle that goes on changing leaves no trace yet
        seen = 'unknown' in estimate.change_kinds and estimate.change_ago[-1] < _SLOWLY_S
        if slow and (seen or self._steps.tires_anew(estimate)):
            doubts = tuple(dict.fromkeys((*doubts, CHANGED_LATELY)))
        reasons = (*estimate.reasons, *found.values(), *slow)
        return replace(estimate, doubts=(*found, *doubts), reasons=reasons)

    def _jump_back(self, newest_ns: int, stamp_ns: int) -> None:
        """Start a new time line; waiting samples belong to the old one."""
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

    def _end_of_line(self) -> None:
        if self._intake.newest_ns is not None:
            self._release(self._intake.newest_ns)
        self._counter.count_until(None)
        self._flush()

    def _release(self, until_ns: int, complete: bool = False) -> None:
        """Process the waiting samples with stamps up to `until_ns`; off line `complete` blocks."""
        first_ns = self._intake.first_ns
        if first_ns is None:
            return
        if self._cell is None:
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
            self._counter.count_until(self._last_ns)
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
        block = self._pipeline.flush()
        if block is None:
            return
        done, cells = block
        self._alignment.add(done.stamp_ns, done.force, done.onset_ns, done.intensity)
        self._samples += len(done.stamp_ns)
        before, self._cells = self._cells, self._cells + cells
        if self._cells // _NOTE_CELLS > before // _NOTE_CELLS:
            self._doubts.note(self._cells, self._samples, self._counter.counts())
        align = _ALIGN_CELLS if self.estimator.on_line else 6 * _ALIGN_CELLS
        if self._cells // align > before // align:
            self._alignment.judge(self._last_ns)

    def _process(
        self, stamps: IntArray, values: FloatArray, marks: Mapping[str, BoolArray]
    ) -> None:
        self._settle(int(stamps[-1]))
        usable = ~np.logical_or.reduce([self._queue.unknown(stamps), *marks.values()])
        if self._held_ns is not None:
            usable &= stamps <= self._held_ns
        prediction = self.estimator.update(stamps, values, usable)
        self._misfit.add(stamps, values, prediction, usable)
        self._counter.count_until(int(stamps[-1]))
        self._count_marks(stamps, marks)
        self._counter.add(faults.SAMPLES_EXCLUDED, int(np.count_nonzero(~usable)))
        self._last_ns = int(stamps[-1])
        self._pipeline.add(stamps, values, prediction, usable)

    def _settle(self, stamp_ns: int) -> None:
        """Pass the pulses that are settled with a sample to the estimator."""
        begun_ns = self._pipeline.block_of(stamp_ns)
        onset, intensity = self._queue.settle(
            stamp_ns + self._pulse_look_ahead_ns, begun_ns + self._pulse_look_ahead_ns
        )
        if self._queue.began_amid:
            # what was learnt as rest may have been the force of pulses that nobody heard
            self._queue.began_amid = False
            vars(self.estimator).update(self._fresh)
        self.estimator.add_pulses(onset, intensity)
        self._pipeline.add_pulses(onset, intensity)
        self._misfit.add_pulses(onset, intensity)
        self._steps.add_pulses(onset, intensity)
        self._acting_ns = np.concatenate((self._acting_ns, onset))

    def _predicted(self, stamp_ns: IntArray) -> FloatArray | None:
        """Return the prediction of samples (samples,) that the estimator has not seen [N]."""
        if self._predictor is None:
            return None
        # all that is due, and no more: later pulses may still arrive
        self._settle(max(int(stamp_ns[0]), int(stamp_ns[-1]) - self._pulse_look_ahead_ns))
        return self._predictor.predict(stamp_ns)

    def _count_marks(self, stamps: IntArray, marks: Mapping[str, BoolArray]) -> None:
        """Count the faults that the monitors found; spikes after a pulse are artifacts."""
        acting = self._acting_ns
        self._acting_ns = acting[acting > stamps[-1] - _ARTIFACT_NS]
        for name, concerned in marks.items():
            count = int(np.count_nonzero(concerned))
            if name == faults.FORCE_SPIKE and len(acting):
                stamp_ns = stamps[concerned]
                before = np.searchsorted(acting, stamp_ns, side='right') - 1
                since = stamp_ns - acting[np.maximum(before, 0)]
                artifacts = int(np.count_nonzero((since >= 0) & (since <= _ARTIFACT_NS)))
                self._counter.add(faults.FORCE_ARTIFACT, artifacts)
                count -= artifacts
            self._counter.add(name, count)
