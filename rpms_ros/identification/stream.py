"""Alignment of pulses and force by their stamps, in front of an estimator.

Stamps are the truth.  A force sample waits until the newest one is `reorder_delay` later; by then
every pulse that could act on it has come.  What is done with a sample depends on stamps, values,
sequence numbers and the order of arrival alone, so a replay of a recording gives the on-line
estimates bit for bit, however it is cut into blocks.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import faults
from rpms_ros.identification.doubts import Doubts
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.estimate import Estimator
from rpms_ros.identification.estimate import ForetellingEstimator
from rpms_ros.identification.far_pulses import FAR_NS
from rpms_ros.identification.faults import FaultCounter
from rpms_ros.identification.force_intake import ForceIntake
from rpms_ros.identification.monitors import Monitor
from rpms_ros.identification.monitors import ProcessedSamples
from rpms_ros.identification.monitors import monitors_by_name
from rpms_ros.identification.monitors.pipeline import Pipeline
from rpms_ros.identification.postponed import PostponedFaults
from rpms_ros.identification.pulse_queue import PulseQueue
from rpms_ros.identification.saved_state import RestorableWithSettings
from rpms_ros.identification.saved_state import State
from rpms_ros.identification.saved_state import described
from rpms_ros.identification.stray_pulses import StrayPulses
from rpms_ros.identification.stream_settings import StreamSettings
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain
from rpms_ros.pulses import nanoseconds

# An excursion so soon after a pulse is a stimulation artifact [ns].
_ARTIFACT_NS = 10_000_000
# Pulses of other publishers that are looked at, of those that come together.
_MOST_EXCLUDED = 1000
# Cells of the monitors' grid between two looks at the shares of faults.
_NOTE_CELLS = 10
# Earlier than any stamp [ns].
_BEFORE_ALL = -(2**63)


class IdentificationStream(RestorableWithSettings):
    """Aligns pulses and force by their stamps and feeds an estimator.

    Parameters
    ----------
    estimator : Estimator
        What learns.
    settings : StreamSettings
        Waiting times, cadence, bounds and the names of monitors.
    sinks : sequence of Monitor
        Further monitors: they are handed all samples, predictions and estimates too.
    """

    _counter: FaultCounter
    _doubts: Doubts
    _pipeline: Pipeline
    _queue: PulseQueue
    _strays: StrayPulses
    _postponed: PostponedFaults
    _intake: ForceIntake
    _cell: int | None
    _monitor_cell: int | None
    _last_ns: int
    _samples: int
    _cells: int
    _acting_ns: IntArray
    _foreseen: tuple[IntArray, FloatArray]
    # samples after this stamp are predicted and not learnt from [ns]
    _held_ns: int | None

    def __init__(
        self,
        estimator: Estimator,
        settings: StreamSettings | None = None,
        sinks: Sequence[Monitor] = (),
    ) -> None:
        self.estimator = estimator
        self.settings = settings if settings is not None else StreamSettings()
        monitors = monitors_by_name(self.settings.monitors)
        further: dict[str, str] = {}
        shares: dict[str, float] = {}
        for monitor in [*monitors, *sinks]:
            further |= monitor.faults
            shares |= monitor.doubtful
        self._counter = FaultCounter(further)
        self._doubts = Doubts(shares, lasting=not estimator.on_line)
        self._memory_ns = nanoseconds(estimator.memory)
        self._reorder_delay_ns = nanoseconds(self.settings.reorder_delay)
        self._pulse_look_ahead_ns = nanoseconds(self.settings.pulse_look_ahead)
        self._period_ns = nanoseconds(self.settings.estimate_period)
        self._pipeline = Pipeline(
            monitors, sinks, self._reorder_delay_ns, self._pulse_look_ahead_ns, self._counter
        )
        self._queue = PulseQueue(self._memory_ns, self._pulse_look_ahead_ns, self._counter)
        self._strays = StrayPulses(2 * self._pulse_look_ahead_ns + self._memory_ns)
        self._postponed = PostponedFaults(self._counter)
        self._intake = ForceIntake(
            self,
            nanoseconds(self.settings.longest_gap),
            self._memory_ns,
            self.settings.largest_force,
        )
        self._cell = None
        self._monitor_cell = None
        self._finished: list[Estimate] = []
        self._foretelling = estimator if isinstance(estimator, ForetellingEstimator) else None
        self._last_ns = 0
        self._samples = 0
        self._cells = 0
        self._acting_ns = np.empty(0, dtype=np.int64)
        self._foreseen = np.empty(0, dtype=np.int64), np.empty(0)
        self._held_ns = None

    @property
    def held(self) -> bool:
        """Whether samples are predicted only, because somebody asked for it."""
        return self._held_ns is not None

    @property
    def fault_counts(self) -> dict[str, int]:
        """What went wrong so far, by name, in samples that still wait too."""
        return self._postponed.counts()

    def described_settings(self) -> State:
        """Return all settings by name."""
        return described(self.settings)

    def state(self) -> State:
        """Return all that is remembered besides the estimator's own state.

        Raises
        ------
        IdentificationError
            If estimates wait to be taken by `advance`.
        """
        if self._finished:
            raise IdentificationError(
                f'expected all estimates taken before a state is saved, got {len(self._finished)}'
            )
        return super().state()

    def count_fault(self, name: str, count: int = 1) -> None:
        """Count faults that were found before the data came here."""
        self._counter.add(name, count)

    def add_pulses(self, pulses: PulseTrain) -> None:
        """Add pulses, in any order, valid or not."""
        newest_ns = self._intake.newest_ns
        if newest_ns is None or not len(pulses):
            self._queue.add(pulses)
            return
        used_ns = newest_ns - self._reorder_delay_ns
        late = pulses.onset_ns <= used_ns + self._pulse_look_ahead_ns
        self._queue.add(pulses[~late], newest_ns)
        # Much too late: not of this time line, and of the next one if the clock has jumped.
        stray = pulses.onset_ns < newest_ns - self._intake.gap_ns
        self._strays.add(pulses[stray], newest_ns)
        for onset_ns in pulses.onset_ns[late & ~stray].tolist():
            self._postponed.add(faults.PULSE_LATE, newest_ns)
            self.exclude(onset_ns, onset_ns + self._memory_ns)

    def exclude_pulses(self, onset_ns: IntArray) -> None:
        """Do not learn while pulses (pulses,) of a publisher that is not believed may act.

        They are counted.  If they were given, they are part of the force; if not, the force goes
        on without them, and nobody knows.
        """
        self._counter.add(faults.PULSE_PUBLISHERS, len(onset_ns))
        newest_ns = self._intake.newest_ns
        near_ns = onset_ns if newest_ns is None else onset_ns[onset_ns <= newest_ns + FAR_NS]
        for onset in near_ns[-_MOST_EXCLUDED:].tolist():
            self.exclude(onset, onset + self._memory_ns)

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

    def hold(self) -> None:
        """Predict and do not learn, from the sample after the newest one on."""
        if self._held_ns is None:
            newest_ns = self._intake.newest_ns
            self._held_ns = _BEFORE_ALL if newest_ns is None else newest_ns

    def resume(self) -> None:
        """Learn again, from when pulses that were given meanwhile act no more."""
        held_ns, newest_ns = self._held_ns, self._intake.newest_ns
        self._held_ns = None
        if held_ns is not None and newest_ns is not None:
            self.exclude(held_ns, newest_ns + self._memory_ns)

    def takes_early(self, pulses: PulseTrain, stamp_ns: IntArray, before: IntArray) -> bool:
        """Return whether pulses may come before samples of which some came before them.

        That is so where nothing is irregular: `stamp_ns` (samples,) go on without a jump, and no
        pulse, `before` (pulses,) of them ahead of it, is late or far.
        """
        newest_ns = self._intake.newest_ns
        line = stamp_ns if newest_ns is None else np.append(newest_ns, stamp_ns)
        steps = np.diff(line)
        if self._intake.in_doubt or not ((steps > 0) & (steps <= self._intake.gap_ns)).all():
            return False
        if not (pulses.onset_ns <= line[0] + FAR_NS).all():
            return False
        seen = before if newest_ns is not None else before - 1
        used_ns = line[np.maximum(seen, 0)] - self._reorder_delay_ns
        return bool((pulses.onset_ns > used_ns + self._pulse_look_ahead_ns).all())

    def add_forces(self, forces: ForceTrace) -> None:
        """Add force samples; bad ones are dropped and counted."""
        self._intake.add(forces)

    def advance(self) -> list[Estimate]:
        """Process what no pulse can still change; return the estimates that fell due."""
        if self._intake.newest_ns is not None:
            self._release(self._intake.newest_ns - self._reorder_delay_ns)
        finished, self._finished = self._finished, []
        return finished

    def finish(self) -> list[Estimate]:
        """Process everything that waits; return the estimates, the last one included."""
        self._intake.drop_alone()
        self._end_of_line()
        if self._intake.newest_ns is not None:
            self._make_estimate()
        finished, self._finished = self._finished, []
        return finished

    def estimate(self) -> Estimate:
        """Return what is known after the newest sample that was processed."""
        counts = self._counter.counts()
        estimate = self.estimator.estimate(self._last_ns, counts)
        doubts = (*self._doubts.names(self._samples, counts), *estimate.doubts)
        return replace(estimate, doubts=doubts)

    def postpone(self, name: str) -> None:
        """Count a fault when the samples up to here are processed, whenever that is."""
        self._postponed.add(name, self._intake.newest_ns)

    def exclude(self, start_ns: int, end_ns: int) -> None:
        """Do not learn from samples after `start_ns` up to `end_ns`, those apart that were used.

        Where nothing is used before it must be, they are still there: they are used all the same.
        """
        if self._intake.newest_ns is not None:
            start_ns = max(start_ns, self._intake.newest_ns - self._reorder_delay_ns)
        if start_ns < end_ns:
            self._queue.exclude(start_ns, end_ns)

    def meet_gap(self, until_ns: int) -> None:
        """Go on after a gap: pulses may have been given meanwhile of which nobody knows."""
        self.postpone(faults.FORCE_GAP)
        assert self._intake.newest_ns is not None
        self.exclude(self._intake.newest_ns, until_ns + self._memory_ns)

    def jump_back(self, stamp_ns: int) -> None:
        """Start a new time line: what waits belongs to the old one."""
        newest_ns = self._intake.newest_ns
        assert newest_ns is not None
        overtaking = self._strays.taken(newest_ns)
        self._end_of_line()
        self._counter.add(faults.CLOCK_JUMP)
        self._queue.restart()
        self._queue.add(overtaking, stamp_ns)
        self._pipeline.restart()
        self.estimator.forget_pulses()
        self._queue.exclude(stamp_ns - 1, stamp_ns + self._memory_ns)
        if self._held_ns is not None:
            self._held_ns = stamp_ns - 1
        self._cell = self._monitor_cell = None
        self._acting_ns = np.empty(0, dtype=np.int64)
        self._foreseen = np.empty(0, dtype=np.int64), np.empty(0)

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
        cell = stamps[:due] // self._period_ns
        monitor_cell = stamps[:due] // self._pipeline.cell_ns
        starts = np.flatnonzero((np.diff(cell) != 0) | (np.diff(monitor_cell) != 0)) + 1
        for first, last in zip((0, *starts.tolist()), (*starts.tolist(), due), strict=True):
            self._cross_into(int(cell[first]), int(monitor_cell[first]))
            marks = self._pipeline.examine(stamps, values, first, last, self._predicted)
            self._process(stamps[first:last], values[first:last], marks)

    def _cross_into(self, cell: int, monitor_cell: int) -> None:
        """Hand a complete cell to the monitors; make an estimate when one is due."""
        ends_cell = self._cell is not None and cell != self._cell
        ends_monitor_cell = self._monitor_cell is not None and monitor_cell != self._monitor_cell
        if ends_cell or ends_monitor_cell:
            # Faults after the last sample of the old cell, whether or not they have come by now
            # with it in one block.
            self._count_postponed(self._last_ns)
        if ends_monitor_cell:
            self._flush()
        if ends_cell:
            self._make_estimate()
        self._cell, self._monitor_cell = cell, monitor_cell

    def _make_estimate(self) -> None:
        estimate = self.estimate()
        self._finished.append(estimate)
        self._pipeline.estimated(estimate)

    def _flush(self) -> None:
        self._samples += self._pipeline.flush()
        self._cells += 1
        if self._cells % _NOTE_CELLS == 0:
            self._doubts.note(self._samples, self._counter.counts())

    def _process(self, stamps: IntArray, values: FloatArray, marks: IntArray) -> None:
        onset, intensity = self._settle(int(stamps[-1]))
        usable = ~self._queue.unknown(stamps) & (marks == 0)
        if self._held_ns is not None:
            usable &= stamps <= self._held_ns
        prediction = self.estimator.update(stamps, values, usable)
        self._count_postponed(int(stamps[-1]))
        self._count_marks(stamps, marks, onset)
        self._counter.add(faults.SAMPLES_EXCLUDED, int(np.count_nonzero(~usable)))
        self._last_ns = int(stamps[-1])
        self._pipeline.add(ProcessedSamples(stamps, values, prediction, usable, onset, intensity))

    def _settle(self, stamp_ns: int) -> tuple[IntArray, FloatArray]:
        """Hand over the pulses that are known at a sample; return those since the last one."""
        cell_ns = self._pipeline.cell_ns
        onset, intensity = self._queue.settle(
            stamp_ns + self._pulse_look_ahead_ns,
            stamp_ns // cell_ns * cell_ns + self._pulse_look_ahead_ns,
        )
        self.estimator.add_pulses(onset, intensity)
        before, self._foreseen = self._foreseen, (onset[:0], intensity[:0])
        return np.concatenate((before[0], onset)), np.concatenate((before[1], intensity))

    def _predicted(self, stamp_ns: IntArray) -> FloatArray | None:
        """Return what the estimator foretells of samples (samples,) that it has not seen."""
        if self._foretelling is None:
            return None
        self._foreseen = self._settle(int(stamp_ns[0]))
        return self._foretelling.foretell(stamp_ns)

    def _count_marks(self, stamps: IntArray, marks: IntArray, onset_ns: IntArray) -> None:
        """Count what the monitors found; spikes after a pulse are artifacts."""
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
    """Return which stamps (samples,) come soon after one of the onsets (pulses,), ascending."""
    place = np.searchsorted(onset_ns, stamp_ns, side='right')
    since: BoolArray = stamp_ns - onset_ns[np.maximum(place - 1, 0)] <= _ARTIFACT_NS
    return since & (place > 0)
