# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The threads of a driver: the owner of the device, its supervisor, and the ledger's."""

import sys
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.stimulation.driver.controller import StimulationController
from rpms_ros.stimulation.driver.device_owner import LOOK_NS

_LOOK_S = LOOK_NS / NANOSECONDS_PER_SECOND
_RESERVE_S = 0.1
_JOIN_S = 2.0
# how long one thread of Python keeps the others waiting: the one that fires pulses is one of them
_SWITCH_S = 5e-4


class _MonitoredThread(threading.Thread, ABC):
    """A thread whose end, for whatever reason but `close`, makes pulses impossible."""

    def __init__(
        self, controller: StimulationController, name: str, wake: threading.Event
    ) -> None:
        super().__init__(name=name, daemon=True)
        self.controller = controller
        self._wake = wake
        self._closing = False

    def run(self) -> None:
        """Step until closed."""
        try:
            while not self._closing:
                self._pause(self.step())
        finally:
            if not self._closing:
                self.controller.fail(
                    self.name, f'{self.name}: expected to run on, got an exception'
                )

    @abstractmethod
    def step(self) -> float:
        """Do what is due; return how long nothing will be [s]."""

    def close(self) -> None:
        """End it and wait for its end, but not for a device that hangs."""
        self._closing = True
        self._wake.set()
        if self.is_alive() and threading.current_thread() is not self:
            self.join(_JOIN_S)

    def _pause(self, duration_s: float) -> None:
        if duration_s > 0 and self._wake.wait(duration_s):
            self._wake.clear()


class OwnerThread(_MonitoredThread):
    """Owns the device: does what is ordered, and fires pulses at their absolute times."""

    def __init__(self, controller: StimulationController) -> None:
        super().__init__(controller, 'owner_thread', controller.wake)

    def run(self) -> None:
        """Step until closed."""
        sys.setswitchinterval(min(sys.getswitchinterval(), _SWITCH_S))
        super().run()

    def step(self) -> float:
        """Do what is due."""
        due_ns = self.controller.step()
        return (due_ns - time.monotonic_ns()) / NANOSECONDS_PER_SECOND


class SupervisorThread(_MonitoredThread):
    """Watches over the owner, the signs of life and idleness."""

    def __init__(self, controller: StimulationController) -> None:
        super().__init__(controller, 'supervisor_thread', threading.Event())

    def step(self) -> float:
        """Look once."""
        self.controller.supervise()
        return _LOOK_S


class LedgerThread(_MonitoredThread):
    """Keeps the dose ledger ahead of the pulses."""

    def __init__(self, controller: StimulationController) -> None:
        super().__init__(controller, 'ledger_thread', threading.Event())

    def step(self) -> float:
        """Reserve what is due soon."""
        self.controller.reserve()
        return _RESERVE_S


class ControllerThreads:
    """The three threads of a controller.

    Parameters
    ----------
    controller : StimulationController
        Whose.
    """

    def __init__(self, controller: StimulationController) -> None:
        self._controller = controller
        self._threads: list[_MonitoredThread] = []

    def start(self) -> None:
        """Start those that do not run."""
        kinds: tuple[Callable[[StimulationController], _MonitoredThread], ...] = (
            OwnerThread,
            SupervisorThread,
            LedgerThread,
        )
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        running = {type(thread) for thread in self._threads}
        # the first look of the supervisor is a sign of life: not later than the first order
        self._controller.supervise()
        for kind in kinds:
            if kind not in running:
                thread = kind(self._controller)
                if isinstance(thread, OwnerThread):
                    self._controller.orders.owner = thread
                thread.start()
                self._threads.append(thread)

    def close(self) -> None:
        """End all of them."""
        for thread in self._threads:
            thread.close()

    def __iter__(self) -> Iterator[_MonitoredThread]:
        return iter(self._threads)
