"""The two threads of a driver: one keeps the time of pulses, one watches over everything else."""

import threading
import time
from collections.abc import Callable

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.stimulation.controller import Fired
from rpms_ros.stimulation.controller import StimulationController

# How often a thread looks around when nothing is due.
_LOOK_S = 0.05
_YIELD_S = 1e-3
_JOIN_S = 2.0


class _MonitoredThread(threading.Thread):
    """A thread whose end, for whatever reason but `close`, makes pulses impossible."""

    def __init__(self, controller: StimulationController, name: str) -> None:
        super().__init__(name=name, daemon=True)
        self.controller = controller
        self._wake = threading.Event()
        self._closing = False

    def run(self) -> None:
        """Step until closed."""
        try:
            while not self._closing:
                self.step()
        finally:
            if not self._closing:
                self.controller.fail(
                    self.name, f'{self.name}: expected to run on, got an exception'
                )

    def step(self) -> None:
        """Do what is due; never wait longer than a look around."""
        self._wake.wait(_LOOK_S)

    def wake(self) -> None:
        """Make it look at once."""
        self._wake.set()

    def close(self) -> None:
        """End it and wait for its end, but not for a device that hangs."""
        self._closing = True
        self.wake()
        if self.is_alive() and threading.current_thread() is not self:
            self.join(_JOIN_S)


class PulseThread(_MonitoredThread):
    """Fires pulses at their absolute times.

    Parameters
    ----------
    controller : StimulationController
        What decides.
    publish : callable
        Told of every pulse that was sent to the device, afterwards.
    """

    def __init__(
        self, controller: StimulationController, publish: Callable[[Fired], None]
    ) -> None:
        super().__init__(controller, 'pulse_thread')
        self._publish = publish

    def step(self) -> None:
        """Wait for the next pulse, or fire it."""
        due = self.controller.due_ns()
        ahead_s = _LOOK_S
        if due is not None:
            ahead_s = (due - time.monotonic_ns()) / NANOSECONDS_PER_SECOND
        if ahead_s > 0:
            self._wake.wait(min(ahead_s, _LOOK_S))
            self._wake.clear()
            return
        fired = self.controller.fire_next()
        if fired is not None:
            self._publish(fired)
        else:
            # nothing could be fired: never spin, others need the lock to change that
            self._wake.wait(_YIELD_S)


class SupervisorThread(_MonitoredThread):
    """Watches over executor, pulse thread, device and idleness."""

    def __init__(self, controller: StimulationController) -> None:
        super().__init__(controller, 'supervisor_thread')

    def step(self) -> None:
        """Look once."""
        self.controller.supervise()
        self._wake.wait(_LOOK_S)
