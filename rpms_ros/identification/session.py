"""Identification of a whole recording with the estimator that also runs on line."""

from collections.abc import Callable
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.estimate import Estimator
from rpms_ros.identification.output_error import OutputError
from rpms_ros.identification.output_error import output_error
from rpms_ros.identification.stream import IdentificationStream
from rpms_ros.identification.stream import StreamSettings
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain

BLOCK = 10_000


@dataclass(frozen=True)
class IdentifiedSession:
    """What an estimator made of a recording.

    Attributes
    ----------
    estimates : list of Estimate
        One an estimate period, and a last one after the last sample.
    stamp_ns, force, prediction : ndarray (samples,)
        What was processed, and its a-priori prediction [ns], [N], [N].
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
    def output_error(self) -> OutputError:
        """Error of the a-priori predictions over the whole session after settling."""
        return output_error(self.stamp_ns, self.force, self.prediction, self.usable)


def identify(
    estimator: Estimator,
    pulses: PulseTrain,
    forces: ForceTrace,
    settings: StreamSettings | None = None,
    progress: Callable[[int], object] | None = None,
) -> IdentifiedSession:
    """Run an estimator over a recording, as it would have run on line.

    Parameters
    ----------
    estimator : Estimator
        Fresh estimator.
    pulses, forces : PulseTrain, ForceTrace
        The recording, in the order in which it was recorded.
    settings : StreamSettings or None
        Waiting times and cadence; those of the node give its estimates bit for bit.
    progress : callable or None
        Called with the number of samples that were taken since the last call.

    Returns
    -------
    IdentifiedSession
        Estimates and traces.

    Raises
    ------
    IdentificationError
        If there is no usable force sample.
    """
    blocks: list[tuple[IntArray, FloatArray, FloatArray, BoolArray]] = []
    stream = IdentificationStream(estimator, settings, lambda *block: blocks.append(block))
    estimates: list[Estimate] = []
    for train, start, stop in _time_lines(pulses, forces, stream.settings.longest_gap):
        for first in range(start, stop, BLOCK):
            part = slice(first, min(first + BLOCK, stop))
            stream.add_forces(ForceTrace(forces.stamp_ns[part], forces.force[part]))
            if first == start:
                stream.add_pulses(train)
            estimates += stream.advance()
            if progress is not None:
                progress(part.stop - part.start)
    estimates += stream.finish()
    if not blocks:
        raise IdentificationError(
            f'expected at least one finite force sample, got none among {len(forces)}'
        )
    stamp, force, prediction, usable = (
        np.concatenate(column) for column in zip(*blocks, strict=True)
    )
    return IdentifiedSession(estimates, stamp, force, prediction, usable)


def _time_lines(
    pulses: PulseTrain, forces: ForceTrace, longest_gap: float
) -> Iterator[tuple[PulseTrain, int, int]]:
    """Yield the pulses and the range of samples of every time line of a clock that jumps back.

    Pulses and samples are recorded apart, so the n-th jump of the one is that of the other.
    Pulses that are left over go with the last samples.
    """
    gap_ns = round(longest_gap * NANOSECONDS_PER_SECOND)
    starts = _line_starts(forces.stamp_ns, gap_ns)
    onsets = _line_starts(pulses.onset_ns, gap_ns)
    ends = [*starts[1:], len(forces)]
    for place, (start, stop) in enumerate(zip(starts, ends, strict=True)):
        first = onsets[place] if place < len(onsets) else len(pulses)
        last = onsets[place + 1] if place + 1 < min(len(onsets), len(starts)) else len(pulses)
        yield pulses[first:last], start, stop


def _line_starts(stamp_ns: IntArray, gap_ns: int) -> list[int]:
    """Return where stamps (n,) go back by more than a gap and stay there, after a leading 0."""
    back = np.flatnonzero(np.diff(stamp_ns) < -gap_ns) + 1
    starts = [0]
    for place in back:
        # The stamps of a time line go on from its first one; one wrong stamp is no time line.
        before, here = int(stamp_ns[place - 1]), int(stamp_ns[place])
        after = int(stamp_ns[place + 1]) if place + 1 < len(stamp_ns) else here
        jumped_ahead = place > 1 and before - int(stamp_ns[place - 2]) > gap_ns >= (
            abs(here - int(stamp_ns[place - 2]))
        )
        if after < before - gap_ns and not jumped_ahead:
            starts.append(int(place))
    return starts
