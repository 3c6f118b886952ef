# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The order of reception: that of the file, also where the clock of the recorder was set back."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import Recording, RecordingWriter, read_recording, write_recording
from rpms_ros.recording.rosbag.definitions import PULSE, WRENCH_STAMPED, known_types

SECOND = 1_000_000_000
Arrivals = list[tuple[bool, int]]
"""Whether each message is a pulse, and the time at which it was received [ns]."""


def written(path: Path, arrivals: Arrivals, make: Any) -> Recording:
    """Return a recording of messages that are numbered in the order in which they came."""
    with RecordingWriter(path) as writer:
        topics = writer.add_topic('/force', WRENCH_STAMPED), writer.add_topic('/pulses', PULSE)
        for number, (is_pulse, time_ns) in enumerate(arrivals):
            kind = PULSE if is_pulse else WRENCH_STAMPED
            message = (
                make.pulse(number, number) if is_pulse else make.wrench_stamped(number, number)
            )
            raw = bytes(known_types().serialize_cdr(message, kind))
            writer.append(topics[is_pulse], time_ns, raw)
            if number % 5 == 4:
                writer.flush()
    return read_recording(path)


def order_of(recording: Recording) -> list[int]:
    """Return the numbers of the messages as a replay would send them."""
    pulses, forces = recording.pulses.onset_ns.tolist(), recording.forces.stamp_ns.tolist()
    order: list[int] = []
    for pulse, before in zip(pulses, recording.samples_before_pulse.tolist(), strict=True):
        order += forces[len([n for n in order if n in forces]) : before]
        order.append(pulse)
    return order + [number for number in forces if number not in order]


arrivals = st.lists(st.tuples(st.booleans(), st.integers(0, 2**50)), max_size=30).map(
    lambda drawn: [(True, 5), (False, 4), *drawn, (False, 3)]
)


@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25, deadline=None
)
@given(drawn=arrivals)
def test_the_order_written_is_the_order_read_where_the_clock_steps_back(
    tmp_path_factory: pytest.TempPathFactory, make: Any, drawn: Arrivals
) -> None:
    path = tmp_path_factory.mktemp('order') / 'bag'
    recording = written(path, drawn, make)
    # The last force sample was received before the first: the clock of one topic stepped back.
    assert order_of(recording) == list(range(len(drawn)))
    received = {True: recording.pulse_received_ns, False: recording.force_received_ns}
    for is_pulse, times in received.items():
        assert times.tolist() == [time_ns for kind, time_ns in drawn if kind is is_pulse]


def test_arrays_with_a_clock_set_back_keep_their_order(tmp_path: Path) -> None:
    stamp_ns = 10 * SECOND + np.arange(4000, dtype=np.int64) * 1_000_000
    stamp_ns[2000:] -= 3 * SECOND // 2
    onset_ns = stamp_ns[::50].copy()
    pulses = PulseTrain(
        onset_ns, np.full(80, 0.5), np.arange(80, dtype=np.int64), np.full(80, 1e-4)
    )
    path = tmp_path / 'bag'
    write_recording(path, pulses, ForceTrace(stamp_ns, np.arange(4000.0)))
    recording = read_recording(path)
    assert recording.forces.stamp_ns.tolist() == stamp_ns.tolist()
    assert recording.pulses.onset_ns.tolist() == onset_ns.tolist()
    assert recording.samples_before_pulse.tolist() == list(range(0, 4000, 50))


def test_a_clock_set_back_in_one_topic_only(tmp_path: Path) -> None:
    stamp_ns = SECOND * np.array([1, 2, 3, 2, 3, 4], dtype=np.int64)
    pulses = PulseTrain.regular([0.5], 1.0, 2 * SECOND)
    write_recording(tmp_path / 'bag', pulses, ForceTrace(stamp_ns, np.arange(6.0)))
    recording = read_recording(tmp_path / 'bag')
    assert recording.forces.force.tolist() == [0, 1, 2, 3, 4, 5]
    assert recording.samples_before_pulse.tolist() == [1]
