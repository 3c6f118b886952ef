# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Monitors of a stream: their interface, and the pipeline that passes them samples.

Monitors receive the stream in cells: consecutive intervals of a fixed grid of the stamps, 0.1 s
long or shorter, each once and complete.  For an estimator that learns at the end of a recording
several at a time are examined, and then processed: ten, and later a hundred.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, TypeVar

import numpy as np

from rpms_ros.identification.model.estimate import Estimate
from rpms_ros.identification.quality import doubts as faults
from rpms_ros.identification.quality.doubts import FaultCounter
from rpms_ros.pulses import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Window:
    """Cells before the estimator learns from them, with the samples around them.

    Attributes
    ----------
    stamp_ns, force : ndarray (samples,)
        Samples of the cells, and those of the cell before and after them [ns], [N].
    edges : ndarray of int (cells + 3,)
        Where the cell before, each cell and the one after begin, and the number of samples.  Any
        of them may be empty.
    found : ndarray of bool (last - first,)
        Samples of the cells in which a monitor before this one has found a fault.
    prediction : ndarray (last - first,) or None
        Prediction of them before the estimator has learnt from any of them [N]; None if the
        estimator cannot, or `StreamSettings.pulse_look_ahead` is too short.
    """

    stamp_ns: IntArray
    force: FloatArray
    edges: IntArray
    found: BoolArray
    prediction: FloatArray | None

    @property
    def first(self) -> int:
        """The samples of the cells themselves are ``first .. last - 1``."""
        return int(self.edges[1])

    @property
    def last(self) -> int:
        """See `first`."""
        return int(self.edges[-2])

    def cells(self) -> Iterator[tuple[slice, 'Window']]:
        """Yield the cells that are not empty, each with its place from `first` on."""
        for cell in range(len(self.edges) - 3):
            edges = self.edges[cell : cell + 4]
            around = slice(int(edges[0]), int(edges[-1]))
            here = slice(int(edges[1]) - self.first, int(edges[2]) - self.first)
            if here.stop > here.start:
                prediction = None if self.prediction is None else self.prediction[here]
                samples = self.stamp_ns[around], self.force[around]
                yield here, Window(*samples, edges - edges[0], self.found[here], prediction)


@dataclass(frozen=True)
class ProcessedSamples:
    """Cells after they were processed.

    Attributes
    ----------
    stamp_ns, force, prediction : ndarray (samples,)
        Samples and their a-priori prediction [ns], [N], [N].
    usable : ndarray of bool (samples,)
        Whether each was learnt from.
    onset_ns, intensity : ndarray (pulses,)
        Pulses added to the estimator meanwhile, ascending [ns], share of the maximum.
    edges, pulse_edges : ndarray of int (cells + 1,)
        Where the samples and the pulses of each cell begin, and their numbers; none is empty of
        samples.
    """

    stamp_ns: IntArray
    force: FloatArray
    prediction: FloatArray
    usable: BoolArray
    onset_ns: IntArray
    intensity: FloatArray
    edges: IntArray
    pulse_edges: IntArray

    def cells(self) -> Iterator['ProcessedSamples']:
        """Yield the cells one by one."""
        for cell in range(len(self.edges) - 1):
            samples, pulses = self.edges[cell : cell + 2], self.pulse_edges[cell : cell + 2]
            here, added = slice(*samples.tolist()), slice(*pulses.tolist())
            learnt = self.prediction[here], self.usable[here]
            given = self.onset_ns[added], self.intensity[added]
            edges = samples - samples[0], pulses - pulses[0]
            yield ProcessedSamples(self.stamp_ns[here], self.force[here], *learnt, *given, *edges)

    @cached_property
    def fits(self) -> list[tuple[int, float, float, float]]:
        """How the prediction fits the usable samples of each cell that has some.

        Their number, the root mean square and the largest of the residuals, and the range of the
        prediction [N].
        """
        edges = np.concatenate(([0], np.cumsum(self.usable)))[self.edges]
        count = np.diff(edges)
        begin, count = edges[:-1][count > 0], count[count > 0]
        if not len(begin):
            return []
        prediction = self.prediction[self.usable]
        residual = np.abs(self.force[self.usable] - prediction)
        error = np.sqrt(np.add.reduceat(residual**2, begin) / count)
        largest = np.maximum.reduceat(residual, begin)
        high, low = (end.reduceat(prediction, begin) for end in (np.maximum, np.minimum))
        columns = count, error, largest, high - low
        return list(zip(*(column.tolist() for column in columns), strict=True))


class Monitor:
    """Receives samples, predictions and estimates of a stream; override what you need.

    `examine` and `processed` are called with single cells, in order and each cell once, so that
    the result cannot depend on how messages arrive or are cut into blocks.  To be faster, override
    `examine_all` and `processed_all`, which get all cells that are examined at a time.  A monitor
    that raises is removed, and `monitor_failed` is counted.

    Attributes
    ----------
    faults : mapping of str to str
        Further faults that the monitor counts besides those of
        `rpms_ros.identification.quality.doubts`, each with its meaning.
    doubtful : mapping of str to float
        Faults that make estimates doubtful if they affect a larger share of the samples than
        this, of the last half minute or of all.
    """

    faults: ClassVar[Mapping[str, str]] = {}
    doubtful: ClassVar[Mapping[str, float]] = {}

    def examine(self, window: Window) -> Mapping[str, BoolArray]:
        """Return which samples of the cell (last - first,) must not be learnt from, by fault."""
        del window
        return {}

    def examine_all(self, window: Window) -> Mapping[str, BoolArray]:
        """Return which samples (last - first,) must not be learnt from, by fault."""
        found: dict[str, BoolArray] = {}
        if type(self).examine is Monitor.examine:
            return found
        for here, cell in window.cells():
            for name, concerned in self.examine(cell).items():
                found.setdefault(name, np.zeros_like(window.found))[here] = concerned
        return found

    def processed(self, samples: ProcessedSamples) -> Mapping[str, int]:
        """Receive a processed cell; return how many of its samples have each fault."""
        del samples
        return {}

    def processed_all(self, samples: ProcessedSamples) -> Mapping[str, int]:
        """Receive processed cells; return how many of their samples have each fault."""
        counts: Counter[str] = Counter()
        if type(self).processed is Monitor.processed:
            return counts
        for cell in samples.cells():
            counts.update(self.processed(cell))
        return counts

    def estimated(self, estimate: Estimate) -> None:
        """Receive an estimate."""

    def restart(self) -> None:
        """Forget earlier stamps: the clock has jumped back."""


CELL_NS = 100_000_000
# With a shorter delay there are no samples around one before it is used.
LEAST_DELAY_NS = 20_000_000
# Cells of a block of a recording: for the first 20 s, in which outliers are to be found as soon as
# the force is predicted, and then.
_SHORT_CELLS, _LONG_CELLS = 10, 100
_SHORT_FOR_NS = 20_000_000_000
# Each fault is one bit in the marks of a sample.
_MOST_FAULTS = 62
Answer = TypeVar('Answer')
# The columns of `ProcessedSamples`.
_Part = tuple[IntArray, FloatArray, FloatArray, BoolArray, IntArray, FloatArray]


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
        self._on_line = on_line
        self._look_ahead_ns = look_ahead_ns
        self._names: list[str] = []
        self._long_from_ns = 0
        self._block: int | None = None
        self._marks = np.empty(0, dtype=np.int64)
        self._before = np.empty(0, dtype=np.int64), np.empty(0)
        self._parts: list[_Part] = []

    def begin(self, stamp_ns: int) -> None:
        """Take the stamp of the first sample of a time line [ns]."""
        self._long_from_ns = stamp_ns + _SHORT_FOR_NS

    def blocks_of(self, stamp_ns: IntArray) -> IntArray:
        """Return where the blocks of cells begin to which stamps (samples,) belong [ns]."""
        if self._on_line:
            return stamp_ns // self.cell_ns * self.cell_ns
        long_ns, short_ns = _LONG_CELLS * self.cell_ns, _SHORT_CELLS * self.cell_ns
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
    ) -> IntArray:
        """Return the faults of samples first .. last - 1 of one block of cells, one bit each.

        `stamp_ns` and `force` (samples,) are all waiting samples, ascending; those before `first`
        have been examined.  `predicted` returns the prediction of the samples of a block.
        """
        if not self._examines:
            return np.zeros(last - first, dtype=np.int64)
        grid_ns = self._grid_ns(int(stamp_ns[first]))
        if int(grid_ns[0]) != self._block:
            self._block = int(grid_ns[0])
            self._marks = self._marks_of(self._window(stamp_ns, force, first, grid_ns, predicted))
        before = (
            np.concatenate((self._before[0], stamp_ns[first:last])),
            np.concatenate((self._before[1], force[first:last])),
        )
        kept = int(np.searchsorted(before[0], grid_ns[-1] - 2 * self.cell_ns))
        self._before = before[0][kept:], before[1][kept:]
        marks, self._marks = self._marks[: last - first], self._marks[last - first :]
        return marks

    def concerned(self, marks: IntArray) -> dict[str, BoolArray]:
        """Return which samples (samples,) have each fault."""
        found = int(np.bitwise_or.reduce(marks)) if len(marks) else 0
        return {
            name: (marks & (1 << bit)) != 0
            for bit, name in enumerate(self._names)
            if found & (1 << bit)
        }

    def add(self, *part: *_Part) -> None:
        """Keep processed samples until their block is complete; see `ProcessedSamples`."""
        self._parts.append(part)

    def flush(self) -> tuple[int, int]:
        """Pass the complete block to the monitors; return how many samples and cells it had."""
        if not self._parts:
            return 0, 0
        columns = [np.concatenate(parts) for parts in zip(*self._parts, strict=True)]
        self._parts = []
        stamps, onset_ns = columns[0], columns[4]
        grid_ns = self._grid_ns(int(stamps[0]))
        edges = np.searchsorted(stamps, grid_ns)
        edges = np.append(edges[:-1][np.diff(edges) > 0], len(stamps))
        known_ns = stamps[edges[1:-1] - 1] + self._look_ahead_ns
        inner = np.searchsorted(onset_ns, known_ns, side='right')
        columns = [*columns, edges, np.concatenate(([0], inner, [len(onset_ns)]))]
        whole = ProcessedSamples(*columns)
        for monitor in list(self._monitors):
            none: Mapping[str, int] = {}
            for name, count in self._ask(monitor, monitor.processed_all, whole, none).items():
                self._counter.add(name, int(count))
        return len(stamps), len(grid_ns) - 1

    def estimated(self, estimate: Estimate) -> None:
        """Pass an estimate to the monitors."""
        for monitor in list(self._monitors):
            self._ask(monitor, monitor.estimated, estimate, None)

    def restart(self) -> None:
        """Forget earlier stamps: the clock has jumped back."""
        self._block = None
        self._marks = np.empty(0, dtype=np.int64)
        self._before = np.empty(0, dtype=np.int64), np.empty(0)
        for monitor in self._monitors:
            monitor.restart()

    def _window(
        self,
        stamp_ns: IntArray,
        force: FloatArray,
        first: int,
        grid_ns: IntArray,
        predicted: Callable[[IntArray], FloatArray | None],
    ) -> Window:
        """Return the block that begins with sample `first`, and a cell before and after it."""
        high = int(np.searchsorted(stamp_ns, grid_ns[-1] + self.cell_ns))
        low = int(np.searchsorted(self._before[0], grid_ns[0] - self.cell_ns))
        stamps = np.concatenate((self._before[0][low:], stamp_ns[first:high]))
        edges = np.concatenate(([0], np.searchsorted(stamps, grid_ns), [len(stamps)]))
        return Window(
            stamps,
            np.concatenate((self._before[1][low:], force[first:high])),
            edges,
            np.zeros(edges[-2] - edges[1], dtype=np.bool_),
            predicted(stamps[edges[1] : edges[-2]]) if self._predicts else None,
        )

    def _grid_ns(self, stamp_ns: int) -> IntArray:
        """Return where the cells of the block of a stamp begin, and where the last one ends."""
        begin_ns, cells = self.block_of(stamp_ns), 1
        if not self._on_line:
            long_ns = _LONG_CELLS * self.cell_ns
            long = stamp_ns // long_ns * long_ns >= self._long_from_ns
            cells = _LONG_CELLS if long else _SHORT_CELLS
        return begin_ns + self.cell_ns * np.arange(cells + 1)

    def _marks_of(self, window: Window) -> IntArray:
        marks = np.zeros(window.last - window.first, dtype=np.int64)
        for monitor in list(self._monitors):
            found: Mapping[str, BoolArray] = self._ask(monitor, monitor.examine_all, window, {})
            for name, concerned in found.items():
                marks[concerned] |= 1 << self._bit(name)
                window.found[concerned] = True
        return marks

    def _bit(self, name: str) -> int:
        if name not in self._names:
            if len(self._names) >= _MOST_FAULTS:
                raise KeyError(f'expected at most {_MOST_FAULTS} faults of samples, got {name}')
            self._names.append(name)
        return self._names.index(name)

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
