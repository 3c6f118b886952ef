# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Hands what passes a stream to its monitors, cell by cell of a grid of the stamps."""

from collections.abc import Callable
from collections.abc import Mapping
from collections.abc import Sequence
from typing import Any
from typing import TypeVar

import numpy as np

from rpms_ros.identification import faults
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.faults import FaultCounter
from rpms_ros.identification.monitors.interface import Monitor
from rpms_ros.identification.monitors.interface import ProcessedSamples
from rpms_ros.identification.monitors.interface import Window
from rpms_ros.identification.saved_state import Restorable
from rpms_ros.identification.saved_state import State
from rpms_ros.identification.saved_state import expect
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

CELL_NS = 100_000_000
# A shorter delay leaves no room to look around a sample before it is used.
LEAST_DELAY_NS = 20_000_000
# One bit a fault, in what is noted of a sample.
_MOST_FAULTS = 62
_MONITORS = 'monitors'
Answer = TypeVar('Answer')


class Pipeline(Restorable):
    """Monitors of one stream.

    Parameters
    ----------
    monitors : sequence of Monitor
        In the order in which they are asked.
    sinks : sequence of Monitor
        Are asked after them, and are no part of the state.
    delay_ns : int
        How long samples wait, at least, before they are used [ns]; at most half of it is a cell of
        the grid, the other half is how far a cell is looked at beyond its end.
    look_ahead_ns : int
        How far pulses are known beyond a sample that is used [ns]; no cell is longer if its
        samples are to be foretold.
    counter : FaultCounter
        Where faults are counted.
    """

    _names: list[str]
    _cell: int | None
    _marks: IntArray
    _before: tuple[IntArray, FloatArray]
    _parts: list[ProcessedSamples]

    def __init__(
        self,
        monitors: Sequence[Monitor],
        sinks: Sequence[Monitor],
        delay_ns: int,
        look_ahead_ns: int,
        counter: FaultCounter,
    ) -> None:
        self._named = tuple(monitors)
        self._monitors = [*monitors, *sinks]
        self._counter = counter
        self._examines = delay_ns >= LEAST_DELAY_NS
        self.cell_ns = min(delay_ns // 2, CELL_NS) if self._examines else CELL_NS
        self._predicts = self._examines and look_ahead_ns >= LEAST_DELAY_NS // 2
        if self._predicts:
            self.cell_ns = min(self.cell_ns, look_ahead_ns)
        self._names = []
        self._cell = None
        self._marks = np.empty(0, dtype=np.int64)
        self._before = np.empty(0, dtype=np.int64), np.empty(0)
        self._parts = []

    def state(self) -> State:
        """Return what is remembered, here and by monitors that have not failed."""
        monitors = [one.state() if one in self._monitors else None for one in self._named]
        return {**super().state(), _MONITORS: monitors}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Remember what was saved; see `Restorable.restore`."""
        saved = state.get(_MONITORS)
        fits = isinstance(saved, list) and len(saved) == len(self._named)
        expect(fits, 'Pipeline', f'{len(self._named)} monitors')
        for monitor, one in zip(self._named, state[_MONITORS], strict=True):
            if one is None:
                self._monitors.remove(monitor)
            else:
                monitor.restore(one)
        super().restore({name: value for name, value in state.items() if name != _MONITORS})

    def _check_restored(self) -> None:
        fits = len(self._before[0]) == len(self._before[1]) and len(self._names) <= _MOST_FAULTS
        for part in self._parts:
            samples = (part.stamp_ns, part.force, part.prediction, part.usable)
            fits = fits and len({len(column) for column in samples}) == 1
            fits = fits and len(part.onset_ns) == len(part.intensity)
        expect(fits, 'Pipeline', 'columns of one length')

    def examine(
        self,
        stamp_ns: IntArray,
        force: FloatArray,
        first: int,
        last: int,
        predicted: Callable[[IntArray], FloatArray | None],
    ) -> IntArray:
        """Return what is wrong with samples first .. last - 1 of one cell, one bit a fault.

        `stamp_ns` and `force` (samples,) are all that wait, ascending; the samples before `first`
        have been examined.  `predicted` foretells the samples of a cell.
        """
        if not self._examines:
            return np.zeros(last - first, dtype=np.int64)
        cell = int(stamp_ns[first]) // self.cell_ns
        if cell != self._cell:
            self._cell = cell
            self._marks = self._marks_of(self._window(stamp_ns, force, first, cell, predicted))
        before = (
            np.concatenate((self._before[0], stamp_ns[first:last])),
            np.concatenate((self._before[1], force[first:last])),
        )
        kept = int(np.searchsorted(before[0], (cell - 1) * self.cell_ns))
        self._before = before[0][kept:], before[1][kept:]
        marks, self._marks = self._marks[: last - first], self._marks[last - first :]
        return marks

    def concerned(self, marks: IntArray) -> dict[str, BoolArray]:
        """Return which samples (samples,) each fault concerns."""
        found = int(np.bitwise_or.reduce(marks)) if len(marks) else 0
        return {
            name: (marks & (1 << bit)) != 0
            for bit, name in enumerate(self._names)
            if found & (1 << bit)
        }

    def add(self, part: ProcessedSamples) -> None:
        """Keep what was processed until its cell is complete."""
        self._parts.append(part)

    def flush(self) -> int:
        """Hand over the cell that has been kept; return how many samples it had."""
        if not self._parts:
            return 0
        columns = ('stamp_ns', 'force', 'prediction', 'usable', 'onset_ns', 'intensity')
        whole = ProcessedSamples(
            *(np.concatenate([getattr(part, name) for part in self._parts]) for name in columns)
        )
        self._parts = []
        for monitor in list(self._monitors):
            none: Mapping[str, int] = {}
            for name, count in self._ask(monitor, monitor.processed, whole, none).items():
                self._counter.add(name, int(count))
        return len(whole.stamp_ns)

    def estimated(self, estimate: Estimate) -> None:
        """Hand over an estimate."""
        for monitor in list(self._monitors):
            self._ask(monitor, monitor.estimated, estimate, None)

    def restart(self) -> None:
        """Forget what is noted by stamps: the clock has jumped back."""
        self._cell = None
        self._marks = np.empty(0, dtype=np.int64)
        self._before = np.empty(0, dtype=np.int64), np.empty(0)
        for monitor in self._monitors:
            monitor.restart()

    def _window(
        self,
        stamp_ns: IntArray,
        force: FloatArray,
        first: int,
        cell: int,
        predicted: Callable[[IntArray], FloatArray | None],
    ) -> Window:
        """Return the cell that begins with sample `first`, and a cell before and after it."""
        begin_ns = cell * self.cell_ns
        stop, high = np.searchsorted(
            stamp_ns, (begin_ns + self.cell_ns, begin_ns + 2 * self.cell_ns)
        ).tolist()
        low = int(np.searchsorted(self._before[0], begin_ns - self.cell_ns))
        before = len(self._before[0]) - low
        return Window(
            np.concatenate((self._before[0][low:], stamp_ns[first:high])),
            np.concatenate((self._before[1][low:], force[first:high])),
            before,
            before + stop - first,
            np.zeros(stop - first, dtype=np.bool_),
            predicted(stamp_ns[first:stop]) if self._predicts else None,
        )

    def _marks_of(self, window: Window) -> IntArray:
        marks = np.zeros(window.last - window.first, dtype=np.int64)
        for monitor in list(self._monitors):
            found: Mapping[str, BoolArray] = self._ask(monitor, monitor.examine, window, {})
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
        """Return the answer of a monitor; take it out if it fails."""
        try:
            return method(what)
        # Whatever somebody's monitor does, learning goes on.
        except Exception:  # noqa: BLE001
            self._monitors.remove(monitor)
            self._counter.add(faults.MONITOR_FAILED)
            return otherwise
