# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Alignment of pulses and force by their stamps, in front of an estimator.

A force sample waits until the newest one is `reorder_delay` later; by then every pulse that could
act on it has arrived.  The result depends on stamps, values, sequence numbers and the order of
arrival alone, so a replay of a recording gives the same estimates as on line, to the bit, however
it is cut into blocks.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.model.estimate import Estimate, Estimator, PredictingEstimator
from rpms_ros.identification.stream import faults
from rpms_ros.identification.stream.doubts import RESPONSE_MISFIT, Doubts, ResponseMisfit
from rpms_ros.identification.stream.faults import FaultCounter
from rpms_ros.identification.stream.monitors import Monitor
from rpms_ros.identification.stream.pulse_checks import Alignment
from rpms_ros.identification.stream.sensor_checks import Pipeline, monitors_by_name
from rpms_ros.identification.stream.stream_input import StreamInput, StreamSettings
from rpms_ros.pulses import BoolArray, FloatArray, IntArray, nanoseconds
from rpms_ros.saved_state import State, described

# A spike within this time after a pulse is a stimulation artifact [ns].
_ARTIFACT_NS = 10_000_000
# Cells of the monitors' grid between two records of the counts of faults.
_NOTE_CELLS = 10
# The same between two looks at how pulses and force belong together.
_ALIGN_CELLS = 50


class IdentificationStream(StreamInput):
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

    _doubts: Doubts
    _pipeline: Pipeline
    _cell: int | None
    _block: int | None
    _last_ns: int
    _samples: int
    _cells: int
    _acting_ns: IntArray
    _settled_early: tuple[IntArray, FloatArray]
    _misfit: ResponseMisfit

    def __init__(
        self,
        estimator: Estimator,
        settings: StreamSettings | None = None,
        sinks: Sequence[Monitor] = (),
    ) -> None:
        settings = settings if settings is not None else StreamSettings()
        monitors = monitors_by_name(settings.monitors)
        further: dict[str, str] = {}
        shares: dict[str, float] = {}
        for monitor in [*monitors, *sinks]:
            further |= monitor.faults
            shares |= monitor.doubtful
        super().__init__(settings, estimator.memory, FaultCounter(further))
        self.estimator = estimator
        self._alignment = Alignment(lasting=not estimator.on_line)
        self._doubts = Doubts(shares, lasting=not estimator.on_line)
        self._period_ns = nanoseconds(self.settings.estimate_period)
        self._pipeline = Pipeline(
            monitors,
            sinks,
            self._reorder_delay_ns,
            self._pulse_look_ahead_ns,
            self._counter,
            1 if estimator.on_line else _NOTE_CELLS,
        )
        self._cell = None
        self._block = None
        self._finished: list[Estimate] = []
        self._predictor = estimator if isinstance(estimator, PredictingEstimator) else None
        self._last_ns = 0
        self._samples = 0
        self._cells = 0
        self._acting_ns = np.empty(0, dtype=np.int64)
        self._settled_early = np.empty(0, dtype=np.int64), np.empty(0)
        self._misfit = ResponseMisfit()

    def described_settings(self) -> State:
        """Return all settings by name."""
        return described(self.settings)

    def state(self) -> State:
        """Return the whole state, without that of the estimator.

        Raises
        ------
        IdentificationError
            If `advance` has not been called for the newest estimates.
        """
        if self._finished:
            raise IdentificationError(
                f'expected all estimates taken before a state is saved, got {len(self._finished)}'
            )
        return super().state()

    def change(self, settings: StreamSettings) -> None:
        """Make estimates at another period from now on.

        Raises
        ------
        IdentificationError
            If anything else differs: it must not change while samples wait.
        """
        if replace(settings, estimate_period=self.settings.estimate_period) != self.settings:
            raise IdentificationError(
                f'expected settings that differ in the estimate period alone, got {settings}'
            )
        self.settings = settings
        self._period_ns = nanoseconds(settings.estimate_period)
        if self._cell is not None:
            self._cell = self._last_ns // self._period_ns

    def advance(self) -> list[Estimate]:
        """Process the samples that have waited long enough; return the estimates due."""
        if self._intake.newest_ns is not None:
            until_ns = self._intake.newest_ns - self._reorder_delay_ns
            if not self.estimator.on_line:
                # complete blocks alone
                until_ns = until_ns // self._pipeline.block_ns * self._pipeline.block_ns - 1
            self._release(until_ns)
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

    def _release(self, until_ns: int) -> None:
        """Process the waiting samples with stamps up to `until_ns`."""
        stamps, values, due = self._intake.take(until_ns)
        if not due:
            return
        if self._cell is None:
            self._queue.begin(int(stamps[0]))
        cell = stamps[:due] // self._period_ns
        block = stamps[:due] // self._pipeline.block_ns
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
        self._samples += self._pipeline.flush()
        self._cells += 1
        if self._cells % _NOTE_CELLS == 0 or not self.estimator.on_line:
            self._doubts.note(self._samples, self._counter.counts())
        blocks = _ALIGN_CELLS if self.estimator.on_line else _ALIGN_CELLS // _NOTE_CELLS
        if self._cells % blocks == 0:
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
        block_ns = self._pipeline.block_ns
        onset, intensity = self._queue.settle(
            stamp_ns + self._pulse_look_ahead_ns,
            stamp_ns // block_ns * block_ns + self._pulse_look_ahead_ns,
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
        self._postponed.count(until_ns)
        self._postponed.add_now(faults.PULSE_LATE, self._strays.given_up(until_ns))


def _after(stamp_ns: IntArray, onset_ns: IntArray) -> BoolArray:
    """Return which stamps (samples,) are soon after one of the onsets (pulses,), ascending."""
    place = np.searchsorted(onset_ns, stamp_ns, side='right')
    since: BoolArray = stamp_ns - onset_ns[np.maximum(place - 1, 0)] <= _ARTIFACT_NS
    return since & (place > 0)
