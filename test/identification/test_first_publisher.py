# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whose messages count: the first publisher's, until it has been silent for long."""

from rpms_ros.identification.first_publisher import FirstPublisher

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
