# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses and force samples as arrays."""

from functools import partial
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, strategies as st

from rpms_ros.pulses import MAGNETIC_PULSE_WIDTH, ForceTrace, Pulse, PulseTrain

EPOCH_NS = 1_700_000_000_123_456_789


def fields(train: PulseTrain) -> list[list[float]]:
    return [
        list(train.onset_ns),
        list(train.intensity),
        list(train.sequence),
        list(train.width),
    ]


def test_a_train_of_pulses_keeps_order_and_bits() -> None:
    pulses = [Pulse(EPOCH_NS + 5, 0.25, 7, 2e-4), Pulse(EPOCH_NS, 1.0, 3)]
    train = PulseTrain.of(pulses)
    assert [Pulse(*values) for values in zip(*fields(train), strict=True)] == pulses
    assert train.onset_ns.dtype == np.int64
    assert train.sequence.dtype == np.int64


def test_no_pulses_are_a_train_too() -> None:
    train = PulseTrain.of([])
    assert len(train) == 0
    assert train.onset_ns.dtype == np.int64
    assert train.intensity.dtype == np.float64


@given(st.floats(0.5, 1000.0), st.integers(0, 500), st.integers(0, EPOCH_NS))
def test_a_regular_train_never_drifts(rate_hz: float, index: int, start_ns: int) -> None:
    train = PulseTrain.regular(np.full(index + 1, 0.5), rate_hz, start_ns)
    # Half a nanosecond by rounding to whole ones, and 500 s resolve to 1e-4 ns.
    assert abs(int(train.onset_ns[-1]) - start_ns - index * 1e9 / rate_hz) <= 0.501


def test_a_regular_train_counts_its_pulses() -> None:
    train = PulseTrain.regular([0.1, 0.2, 0.3], 20.0, EPOCH_NS, width=2e-4)
    assert fields(train) == [
        [EPOCH_NS, EPOCH_NS + 50_000_000, EPOCH_NS + 100_000_000],
        [0.1, 0.2, 0.3],
        [0, 1, 2],
        [2e-4] * 3,
    ]
    assert PulseTrain.regular([0.1], 20.0).width[0] == MAGNETIC_PULSE_WIDTH


def test_a_part_of_a_train() -> None:
    train = PulseTrain.regular([0.1, 0.2, 0.3], 20.0)
    assert fields(train[1:]) == [values[1:] for values in fields(train)]
    chosen = train[train.intensity > 0.15]
    assert fields(chosen) == fields(train[1:])
    assert fields(train[np.array([2, 0])]) == [[v[2], v[0]] for v in fields(train)]


@given(st.integers(0, 6))
def test_parts_joined_are_the_whole(cut: int) -> None:
    train = PulseTrain.regular(np.linspace(0.0, 1.0, 6), 20.0)
    assert fields(PulseTrain.joined([train[:cut], train[cut:]])) == fields(train)


KINDS = [
    list,
    tuple,
    pd.Series,
    lambda values: pd.Series(values, index=range(5, 5 + len(values))),
    np.asfortranarray,
]


@pytest.mark.parametrize('kind', KINDS)
def test_numbers_of_any_kind_become_arrays(kind: Any) -> None:
    stamps = [EPOCH_NS, EPOCH_NS + 1]
    train = PulseTrain(kind(stamps), kind([0, 1]), kind([0, 1]), kind([1e-4, 1e-4]))
    forces = ForceTrace(kind(stamps), kind([1, 2]))
    for array in (train.onset_ns, train.sequence, forces.stamp_ns):
        assert type(array) is np.ndarray
        assert array.dtype == np.int64
    for array in (train.intensity, train.width, forces.force):
        assert type(array) is np.ndarray
        assert array.dtype == np.float64
    assert train.onset_ns.tolist() == forces.stamp_ns.tolist() == stamps
    assert fields(train[train.intensity > 0.5]) == [[EPOCH_NS + 1], [1.0], [1], [1e-4]]


def test_times_of_pandas_are_nanoseconds() -> None:
    stamps = pd.to_datetime(pd.Series([EPOCH_NS, EPOCH_NS + 7]))
    assert ForceTrace(stamps, [0.0, 0.0]).stamp_ns.tolist() == [EPOCH_NS, EPOCH_NS + 7]
    assert ForceTrace(np.arange(3, dtype=np.int32), np.zeros(3)).stamp_ns.dtype == np.int64


def test_arrays_that_are_kept_are_not_copied() -> None:
    stamps, force = np.arange(3, dtype=np.int64), np.zeros(3)
    trace = ForceTrace(stamps, force)
    assert trace.stamp_ns is stamps
    assert trace.force is force


@pytest.mark.parametrize(
    ('make', 'match'),
    [
        (lambda: ForceTrace([0.0, 0.05], [1.0, 1.0]), 'whole numbers in stamp_ns, got float64'),
        (lambda: PulseTrain.of([Pulse(0.05, 1.0)]), 'whole numbers in onset_ns, got float64'),
        (lambda: ForceTrace(['a'], [1.0]), 'expected whole numbers in stamp_ns, got <U1'),
        (lambda: ForceTrace([0], [[1.0]]), r'expected force of shape \(n,\), got \(1, 1\)'),
        (lambda: ForceTrace(0, 1.0), r'expected stamp_ns of shape \(n,\), got \(\)'),
        (lambda: ForceTrace([0], [{}]), r'expected numbers in force, got \[\{\}\]'),
        (lambda: ForceTrace([0, 1], [0.5]), 'expected as many stamps as forces, got 2 and 1'),
        (
            lambda: PulseTrain([0, 1], [1.0], [0, 1], [1e-4, 1e-4]),
            r'expected arrays of one length, got lengths \[1, 2\]',
        ),
        *(
            (partial(PulseTrain.regular, [0.1, 0.2], rate), 'a repetition rate above 0 Hz, got')
            for rate in (0.0, -20.0, float('nan'), float('inf'))
        ),
    ],
)
def test_what_cannot_be_such_arrays_is_refused(make: Any, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        make()
