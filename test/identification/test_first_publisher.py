# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Only the first publisher's messages are used, until it has been silent for long."""

import numpy as np
from hypothesis import given, strategies as st

from rpms_ros.identification.stream.first_publisher import FirstPublisher, counting

SECOND = 1_000_000_000


def test_the_first_one_counts_and_no_other() -> None:
    first = FirstPublisher(SECOND)
    for stamp_ns in range(0, 5 * SECOND, SECOND // 10):
        assert first.counts(b'one', stamp_ns)
        assert not first.counts(b'two', stamp_ns)


def test_another_one_counts_when_the_first_has_been_silent() -> None:
    first = FirstPublisher(SECOND)
    assert first.counts(b'one', 0)
    # Another computer, another clock: what counts is how long it has gone on itself.
    assert not first.counts(b'two', 90 * SECOND)
    assert not first.counts(b'two', 91 * SECOND)
    assert first.counts(b'two', 91 * SECOND + 1)
    assert not first.counts(b'one', 2 * SECOND)


def test_a_word_of_the_first_one_is_enough_to_stay() -> None:
    first = FirstPublisher(SECOND)
    for stamp_ns in range(0, 9 * SECOND, SECOND):
        assert first.counts(b'one', stamp_ns)
        assert not first.counts(b'two', stamp_ns + SECOND // 2)


def test_a_flood_of_publishers_is_not_remembered() -> None:
    first = FirstPublisher(SECOND)
    assert first.counts(b'one', 0)
    for number in range(1000):
        assert not first.counts(str(number).encode(), number)
    assert len(first._others) < 100


stamps = st.integers(0, 40).map(lambda tenths: tenths * SECOND // 10)
anywhere = st.integers(-(2**63), 2**63 - 1)


@given(st.lists(st.tuples(st.integers(0, 70), st.one_of(stamps, anywhere)), max_size=200))
def test_many_messages_at_once_count_like_one_after_the_other(
    messages: list[tuple[int, int]],
) -> None:
    first = FirstPublisher(SECOND)
    one_by_one = [first.counts(number.to_bytes(4, 'little'), stamp) for number, stamp in messages]
    numbers, stamp_ns = np.array(messages, dtype=np.int64).reshape(-1, 2).T
    assert counting(numbers, stamp_ns, SECOND).tolist() == one_by_one


def test_a_flood_of_publishers_is_told_apart_up_to_a_number() -> None:
    messages = [(0, 0), *((number, 0) for number in range(1, 100)), (64, 2 * SECOND), (0, SECOND)]
    messages += [*((number, 0) for number in range(1, 100)), (65, 2 * SECOND)]
    first = FirstPublisher(SECOND)
    one_by_one = [first.counts(number.to_bytes(4, 'little'), stamp) for number, stamp in messages]
    numbers, stamp_ns = np.array(messages, dtype=np.int64).T
    assert counting(numbers, stamp_ns, SECOND).tolist() == one_by_one
