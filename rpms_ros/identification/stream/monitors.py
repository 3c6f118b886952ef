# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Monitors of a stream: their interface, and what they receive.

Monitors receive the stream in cells: consecutive intervals of a fixed grid of the stamps, 0.1 s
long or shorter, each once and complete.  For an estimator that learns at the end of a recording
several at a time are examined, and then processed: ten, and later a hundred.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from rpms_ros.identification.model.estimate import Estimate
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
