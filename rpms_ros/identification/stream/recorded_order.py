# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Feeds a recording to a stream in the order in which its messages arrived."""

from collections.abc import Iterator

import numpy as np

from rpms_ros.identification.stream.stream import IdentificationStream
from rpms_ros.pulses import ForceTrace, IntArray, PulseTrain, nanoseconds

BLOCK = 10_000
# Pulses more than 10 s ahead of the force count as far: shorter blocks do not cause that.
_BLOCK_NS = nanoseconds(5.0)


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
        gap_ns = nanoseconds(stream.settings.longest_gap)
        samples_before_pulse = in_time(pulses, forces, gap_ns)
    order = np.argsort(samples_before_pulse, kind='stable')
    pulses, before = pulses[order], np.asarray(samples_before_pulse, dtype=np.int64)[order]
    start = 0
    while start < len(forces):
        stop = _block_end(forces.stamp_ns, start)
        # Pulses after the last sample belong to the last block.
        end = stop if stop < len(forces) else stop + 1
        first, last = np.searchsorted(before, (start, end)).tolist()
        block = ForceTrace(forces.stamp_ns[start:stop], forces.force[start:stop])
        add_in_order(stream, pulses[first:last], block, before[first:last] - start)
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
    for place, first in enumerate(onsets[: len(starts)]):
        last = onsets[place + 1] if place + 1 < min(len(onsets), len(starts)) else len(pulses)
        start = starts[place]
        stop = starts[place + 1] if place + 1 < len(starts) else len(forces)
        stamps = np.maximum.accumulate(_settled(forces.stamp_ns[start:stop], gap_ns))
        # The second sample of a time line confirms that the clock has jumped.
        least = start + 2 if place else 0
        found = start + np.searchsorted(stamps, pulses.onset_ns[first:last])
        before[first:last] = np.minimum(np.maximum(found, least), len(forces))
    return before


def _block_end(stamp_ns: IntArray, start: int) -> int:
    """Return the end of the block that begins with sample `start`."""
    stamps = stamp_ns[start : start + BLOCK]
    far = np.flatnonzero(np.abs(stamps - stamps[0]) > _BLOCK_NS)
    return start + (int(far[0]) if len(far) else len(stamps))


def add_in_order(
    stream: IdentificationStream,
    pulses: PulseTrain,
    forces: ForceTrace,
    before: IntArray,
) -> None:
    """Add samples to a stream, and pulses in the order in which they came between them.

    Parameters
    ----------
    stream : IdentificationStream
        The stream.
    pulses, forces : PulseTrain, ForceTrace
        In the order of arrival.
    before : ndarray of int64 (pulses,)
        How many of the samples had arrived before each pulse, ascending.
    """
    stamps, values = forces.stamp_ns, forces.force
    if not len(pulses) or (len(stamps) and stream.takes_early(pulses, forces, before)):
        # None of them is late, so their place among the samples makes no difference.
        stream.add_pulses(pulses)
        stream.add_forces(forces)
        return
    begin = 0
    for end in np.unique(before).tolist():
        stream.add_forces(ForceTrace(stamps[begin:end], values[begin:end]))
        begin = end
        first, last = np.searchsorted(before, (end, end + 1)).tolist()
        for index in range(first, last):
            stream.add_pulses(pulses[index : index + 1])
    stream.add_forces(ForceTrace(stamps[begin:], values[begin:]))


def _settled(stamp_ns: IntArray, gap_ns: int) -> IntArray:
    """Return the stamps (samples,); single ones far ahead are replaced by those before them.

    Otherwise one wrong stamp would make all later samples look late.
    """
    settled = stamp_ns.copy()
    ahead = np.flatnonzero(np.diff(stamp_ns) > gap_ns) + 1
    for place in ahead.tolist():
        if place + 1 < len(stamp_ns) and stamp_ns[place + 1] - stamp_ns[place - 1] <= gap_ns:
            settled[place] = settled[place - 1]
    return settled


def _line_starts(stamp_ns: IntArray, gap_ns: int) -> list[int]:
    """Return 0 and the places where stamps (n,) jump back by more than a gap for good."""
    back = np.flatnonzero(np.diff(stamp_ns) < -gap_ns) + 1
    starts = [0]
    for place in back:
        # A single wrong stamp is no new time line: the stamps after it have to follow it.
        before, here = int(stamp_ns[place - 1]), int(stamp_ns[place])
        after = int(stamp_ns[place + 1]) if place + 1 < len(stamp_ns) else here
        jumped_ahead = place > 1 and before - int(stamp_ns[place - 2]) > gap_ns >= (
            abs(here - int(stamp_ns[place - 2]))
        )
        if after < before - gap_ns and not jumped_ahead:
            starts.append(int(place))
    return starts
