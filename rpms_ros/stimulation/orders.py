# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Orders to the owner of a device: put in by any thread, done by one, answered in time or not."""

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any
from typing import TypeVar

from rpms_ros.errors import StimulationError

Result = TypeVar('Result')


class NoAnswer(StimulationError):
    """The owner of the device did not answer in time.

    Attributes
    ----------
    begun : bool
        Whether it had begun with the order, and hangs in it.
    """

    def __init__(self, limit_s: float, begun: bool) -> None:
        super().__init__(f'expected the driver to answer within {limit_s:g} s, got no answer')
        self.begun = begun


class Orders:
    """A queue of orders.

    Parameters
    ----------
    wake : threading.Event
        Set when there is something to do.

    Attributes
    ----------
    owner : threading.Thread or None
        Who does them; without a living one, whoever asks does.
    """

    def __init__(self, wake: threading.Event) -> None:
        self.owner: threading.Thread | None = None
        self._wake = wake
        self._queue: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = queue.SimpleQueue()

    def ask(self, do: Callable[[], Result], limit_s: float, keep: bool = False) -> Result:
        """Have something done by the owner, and return or raise what it returns or raises.

        Parameters
        ----------
        do : callable
            What is to be done.
        limit_s : float
            How long to wait for the answer [s].
        keep : bool
            Whether it is to be done even after that.

        Raises
        ------
        NoAnswer
            If there was none in time.
        """
        owner = self.owner
        if owner is None or owner is threading.current_thread() or not owner.is_alive():
            return do()
        answer: Future[Result] = Future()
        self._queue.put((do, answer))
        self._wake.set()
        try:
            return answer.result(limit_s)
        except TimeoutError:
            begun = answer.running() if keep else not answer.cancel()
            if answer.done() and not answer.cancelled():
                return answer.result()
            raise NoAnswer(limit_s, begun) from None

    def serve(self) -> None:
        """Do what was ordered; called by the owner."""
        while not self._queue.empty():
            do, answer = self._queue.get_nowait()
            if not answer.set_running_or_notify_cancel():
                continue
            try:
                answer.set_result(do())
            except Exception as error:  # noqa: BLE001 - it is raised where it was asked for
                answer.set_exception(error)
