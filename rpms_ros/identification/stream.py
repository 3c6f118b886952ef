"""From messages in any order to an estimator that sees time pass once.

Stamps are the truth.  A force sample is held back until the newest one is `reorder_delay` later;
by then every pulse that could act on it has come.  What is done with a sample depends on stamps
and sequence numbers alone, so a replay of a recording gives the on-line estimates bit for bit,
however it is cut into blocks.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import faults
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.estimate import Estimator
from rpms_ros.identification.faults import FaultCounter
from rpms_ros.identification.pulse_queue import PulseQueue
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain
from rpms_ros.pulses import nanoseconds

_LONG_AGO = -(2**63)
_FAR_AHEAD = 2**63 - 1
Trace = Callable[[IntArray, FloatArray, FloatArray, BoolArray], None]


@dataclass(frozen=True)
class StreamSettings:
    """How samples and pulses are brought together.

    Attributes
    ----------
    reorder_delay : float
        How long a sample waits for pulses [s].
    pulse_look_ahead : float
        How far beyond a sample pulses are looked at before it is used [s]; the rest of
        `reorder_delay` is what a pulse may be late.
    estimate_period : float
        Stamps between two estimates [s].
    longest_gap : float
        Longest pause of the force that does not count as a gap [s].
    """

    reorder_delay: float = 0.2
    pulse_look_ahead: float = 0.1
    estimate_period: float = 0.1
    longest_gap: float = 1.0

    def __post_init__(self) -> None:
        if not 0 <= self.pulse_look_ahead <= self.reorder_delay < math.inf:
            raise IdentificationError(
                'expected 0 <= pulse_look_ahead <= reorder_delay, got '
                f'{self.pulse_look_ahead} and {self.reorder_delay}'
            )
        if not (0 < self.estimate_period < math.inf and 0 < self.longest_gap < math.inf):
            raise IdentificationError(
                'expected an estimate period and a longest gap above 0 s, got '
                f'{self.estimate_period} and {self.longest_gap}'
            )


class IdentificationStream:
    """Aligns pulses and force by their stamps and feeds an estimator.

    Parameters
    ----------
    estimator : Estimator
        What learns.
    settings : StreamSettings
        Waiting times and cadence.
    trace : callable or None
        Called with stamps, forces, a-priori predictions and usable flags (samples,) of
        everything that was processed, in order.
    """

    def __init__(
        self,
        estimator: Estimator,
        settings: StreamSettings | None = None,
        trace: Trace | None = None,
    ) -> None:
        self.estimator = estimator
        self.settings = settings if settings is not None else StreamSettings()
        self._trace = trace
        self._counter = FaultCounter()
        self._memory_ns = nanoseconds(estimator.memory)
        self._reorder_delay_ns = nanoseconds(self.settings.reorder_delay)
        self._pulse_look_ahead_ns = nanoseconds(self.settings.pulse_look_ahead)
        self._period_ns = nanoseconds(self.settings.estimate_period)
        self._gap_ns = nanoseconds(self.settings.longest_gap)
        self._queue = PulseQueue(self._memory_ns, self._pulse_look_ahead_ns, self._counter)
        self._waiting: list[tuple[IntArray, FloatArray]] = []
        self._newest_ns: int | None = None
        self._cell: int | None = None
        self._finished: list[Estimate] = []
        self._last_ns = 0
        self._postponed: dict[tuple[int, str], int] = {}
        self._alone: tuple[int, float] | None = None

    @property
    def fault_counts(self) -> dict[str, int]:
        """What went wrong so far, by name, in samples that are still held back too."""
        counter = FaultCounter()
        for name, count in self._counter.counts().items():
            counter.add(name, count)
        for (_, name), count in self._postponed.items():
            counter.add(name, count)
        return counter.counts()

    def count_fault(self, name: str, count: int = 1) -> None:
        """Count faults that were found before the data came here."""
        self._counter.add(name, count)

    def add_pulses(self, pulses: PulseTrain) -> None:
        """Add pulses, in any order, valid or not."""
        self._queue.add(pulses)

    def add_forces(self, forces: ForceTrace) -> None:
        """Add force samples; bad ones are dropped and counted."""
        if not len(forces):
            return
        finite = np.isfinite(forces.force)
        start = 0
        while start < len(finite):
            if not finite[start]:
                self._postpone(faults.FORCE_NOT_FINITE)
                start += 1
                continue
            bad = np.flatnonzero(~finite[start:])
            stop = start + int(bad[0]) if len(bad) else len(finite)
            self._take(forces.stamp_ns[start:stop], forces.force[start:stop])
            start = stop

    def advance(self) -> list[Estimate]:
        """Process what no pulse can still change; return the estimates that fell due."""
        if self._newest_ns is not None:
            self._release(self._newest_ns - self._reorder_delay_ns)
        finished, self._finished = self._finished, []
        return finished

    def finish(self) -> list[Estimate]:
        """Process everything that is held back; return the estimates, the last one included."""
        self._drop_alone()
        if self._newest_ns is not None:
            self._release(self._newest_ns)
        self._count_postponed(_FAR_AHEAD)
        if self._newest_ns is not None:
            self._finished.append(self.estimate())
        finished, self._finished = self._finished, []
        return finished

    def estimate(self) -> Estimate:
        """Return what is known after the newest sample that was processed."""
        return self.estimator.estimate(self._last_ns, self._counter.counts())

    def _postpone(self, name: str) -> None:
        """Count a fault when the samples up to here are processed, whenever that is."""
        after_ns = self._newest_ns if self._newest_ns is not None else _LONG_AGO
        key = (after_ns, name)
        self._postponed[key] = self._postponed.get(key, 0) + 1

    def _take(self, stamps: IntArray, values: FloatArray) -> None:
        """Take finite samples (samples,), irregular stamps among them."""
        start = 0
        while start < len(stamps):
            start = self._take_run(stamps, values, start)

    def _take_run(self, stamps: IntArray, values: FloatArray, start: int) -> int:
        """Take samples from `start` on up to the next irregular one; return where it is."""
        if self._newest_ns is not None:
            stamp_ns = int(stamps[start])
            step = stamp_ns - self._newest_ns
            if -self._gap_ns <= step <= 0:
                self._postpone(faults.FORCE_STAMP_NOT_AFTER_LAST)
                return start + 1
            if abs(step) > self._gap_ns and not self._follow_alone(stamp_ns, values[start]):
                return start + 1
            self._drop_alone()
        steps = np.diff(stamps[start:])
        irregular = np.flatnonzero((steps <= 0) | (steps > self._gap_ns))
        end = start + 1 + int(irregular[0]) if len(irregular) else len(stamps)
        self._waiting.append((stamps[start:end], values[start:end]))
        self._newest_ns = int(stamps[end - 1])
        return end

    def _follow_alone(self, stamp_ns: int, value: float) -> bool:
        """Believe a stamp far from its predecessor when a second one follows it.

        One wrong stamp would look like two jumps of the clock.  Returns whether `stamp_ns`
        confirms the sample that is waiting alone; otherwise it waits in its place.
        """
        if self._alone is None or not 0 < stamp_ns - self._alone[0] <= self._gap_ns:
            self._drop_alone()
            self._alone = (stamp_ns, float(value))
            return False
        (first_ns, first), self._alone = self._alone, None
        assert self._newest_ns is not None
        if first_ns < self._newest_ns:
            self._jump_back(first_ns)
        else:
            self._postpone(faults.FORCE_GAP)
            self._queue.exclude(self._newest_ns, first_ns + self._memory_ns)
        self._waiting.append((np.array([first_ns]), np.array([first])))
        self._newest_ns = first_ns
        return True

    def _drop_alone(self) -> None:
        if self._alone is not None:
            self._postpone(faults.FORCE_STAMP_ALONE)
            self._alone = None

    def _jump_back(self, stamp_ns: int) -> None:
        """Start a new time line: what is held back belongs to the old one."""
        assert self._newest_ns is not None
        self._release(self._newest_ns)
        self._count_postponed(_FAR_AHEAD)
        self._counter.add(faults.CLOCK_JUMP)
        self._queue.restart()
        self.estimator.forget_pulses()
        self._queue.exclude(stamp_ns - 1, stamp_ns + self._memory_ns)
        self._cell = None

    def _release(self, until_ns: int) -> None:
        """Process the held-back samples with stamps up to `until_ns`."""
        if not self._waiting:
            return
        stamps = np.concatenate([stamps for stamps, _ in self._waiting])
        values = np.concatenate([values for _, values in self._waiting])
        due = int(np.searchsorted(stamps, until_ns, side='right'))
        self._waiting = [(stamps[due:], values[due:])] if due < len(stamps) else []
        if not due:
            return
        stamps, values = stamps[:due], values[:due]
        cell = stamps // self._period_ns
        starts = np.flatnonzero(np.diff(cell)) + 1
        for first, last in zip((0, *starts), (*starts, due), strict=True):
            self._cross_into(int(cell[first]))
            self._process(stamps[first:last], values[first:last])

    def _cross_into(self, cell: int) -> None:
        """Make an estimate when the stamps enter a new cell of the estimate grid."""
        if self._cell is not None and cell != self._cell:
            # Faults after the last sample of the old cell, whether or not they have come by now
            # with it in one block.
            self._count_postponed(self._last_ns)
            self._finished.append(self.estimate())
        self._cell = cell

    def _process(self, stamps: IntArray, values: FloatArray) -> None:
        onset, intensity = self._queue.settle(int(stamps[-1]) + self._pulse_look_ahead_ns)
        self.estimator.add_pulses(onset, intensity)
        usable = ~self._queue.unknown(stamps)
        prediction = self.estimator.update(stamps, values, usable)
        self._count_postponed(int(stamps[-1]))
        self._counter.add(faults.SAMPLES_EXCLUDED, int(np.count_nonzero(~usable)))
        self._last_ns = int(stamps[-1])
        if self._trace is not None:
            self._trace(stamps, values, prediction, usable)

    def _count_postponed(self, until_ns: int) -> None:
        for key in [key for key in self._postponed if key[0] <= until_ns]:
            self._counter.add(key[1], self._postponed.pop(key))
