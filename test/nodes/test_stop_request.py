# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A request to stop is heard whatever runs when the signal comes."""

import os
import signal
from collections.abc import Iterator

import pytest

from rpms_ros.nodes.common.runner import StopRequest


@pytest.fixture
def stop() -> Iterator[StopRequest]:
    request = StopRequest()
    yield request
    request.restore()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_request_whose_exception_is_swallowed_is_still_known(
    stop: StopRequest, number: signal.Signals
) -> None:
    with pytest.raises(KeyboardInterrupt, match=r'^$'):
        os.kill(os.getpid(), number)
    assert stop.made
    with pytest.raises(KeyboardInterrupt, match=r'^$'):
        stop.raise_if_made()


def test_a_spinning_process_only_notes_the_first_one(stop: StopRequest) -> None:
    stop.heed_between_callbacks()
    stop.raise_if_made()
    os.kill(os.getpid(), signal.SIGINT)
    assert stop.made
    with pytest.raises(KeyboardInterrupt, match=r'^$'):
        os.kill(os.getpid(), signal.SIGINT)


def test_the_handlers_from_before_come_back() -> None:
    before = signal.getsignal(signal.SIGTERM)
    request = StopRequest()
    assert signal.getsignal(signal.SIGTERM) != before
    request.restore()
    assert signal.getsignal(signal.SIGTERM) == before
