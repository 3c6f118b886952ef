# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A whole graph on this machine: nodes as separate processes, a recorder in this process.

The processes communicate over real DDS, on the local host and in a domain of their own.  They end
with the block that started them, and also if this process is killed.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import rclpy
import yaml
from rclpy.context import Context
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from rpms_msgs.msg import DriverStatus, MuscleEstimate, MuscleTruth
from rpms_ros import estimate_messages
from rpms_ros.errors import NodeError
from rpms_ros.identification import Estimate
from rpms_ros.muscle.simulation import Truth
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.runner import (
    PARENT_VARIABLE,
    StopRequest,
    free_domain,
    use_fast_discovery,
)
from rpms_ros.nodes.recorder import Recorder
from rpms_ros.stimulation import Schedule, schedule_to_text

PLANT, IDENTIFIER, DRIVER = 'plant_simulator', 'identifier', 'stimulator_driver'
LIVE_PAGE = 'live_page'
RECORDING, SCHEDULE = 'recording', 'schedule.yaml'

# Compilation for the first time takes most of it, minutes on a busy machine.
STARTUP_LIMIT = 300.0
_PATIENCE = 5.0
# After several estimate periods without an estimate none is expected.
_QUIET = 0.5


def _parameters(given: Mapping[str, dict[str, Any]], folder: Path) -> dict[str, dict[str, Any]]:
    """Return the parameters of every node with those that make the nodes wait for each other."""
    # Subscribers of the force are identifier and recorder, of the pulses the plant too; a live
    # page subscribes to both.
    page = LIVE_PAGE in given
    alone = {'autostart': True, 'require_operator': False, 'require_stop_button': False}
    heard = {'minimum_subscribers': 3 + page, 'schedule_file': str(folder / SCHEDULE)}
    first: dict[str, dict[str, Any]] = {
        PLANT: {'minimum_subscribers': 2 + page},
        IDENTIFIER: {},
        DRIVER: {**alone, **heard},
    }
    return {name: {**first.get(name, {}), **given.get(name, {})} for name in (*first, *given)}


class Monitor(Node):
    """Keeps every estimate, the newest truth of the plant and the newest status of the driver."""

    def __init__(self, **options: Any) -> None:
        super().__init__('monitor', **options)
        self.estimates: list[Estimate] = []
        self.truths: list[Truth] = []
        self.status = DriverStatus()
        self.has_run = False
        self.create_subscription(MuscleEstimate, topics.ESTIMATE, self._on_estimate, qos.ESTIMATE)
        self.create_subscription(MuscleTruth, topics.TRUTH, self._on_truth, qos.TRUTH)
        self.create_subscription(DriverStatus, topics.DRIVER_STATUS, self._on_status, qos.STATUS)

    @property
    def done(self) -> bool:
        """Whether the driver has finished its schedule."""
        return self.has_run and self.status.state != DriverStatus.RUNNING

    @property
    def broken_off(self) -> str:
        """Why the driver has stopped, empty if it has not."""
        stopped = self.status.state in (DriverStatus.STOPPED, DriverStatus.FAULT)
        return str(self.status.reason) if stopped else ''

    def _on_estimate(self, message: MuscleEstimate) -> None:
        self.estimates.append(estimate_messages.estimate_of(message))

    def _on_truth(self, message: MuscleTruth) -> None:
        self.truths = [estimate_messages.truth_of(message)]

    def _on_status(self, message: DriverStatus) -> None:
        # what it says when it is ended afterwards is not how the schedule ended
        if not self.done:
            self.status = message
            self.has_run |= message.state == DriverStatus.RUNNING


class SimulationLauncher:
    """Processes, a recorder and a monitor; use it in a ``with`` block.

    Parameters
    ----------
    folder : Path
        Folder for the recording, the parameters and the output of the processes; must not exist.
    parameters : mapping of str to dict
        Parameters of the nodes, by `PLANT`, `IDENTIFIER` and `DRIVER`; others keep their defaults.
        With those of `LIVE_PAGE` there is a live page.
    schedule : Schedule
        What the driver runs.

    Attributes
    ----------
    processes : dict of str to Popen
        By the name of the node.

    Raises
    ------
    NodeError
        If the folder exists, or a process does not start or ends too early.
    """

    def __init__(
        self, folder: Path, parameters: Mapping[str, dict[str, Any]], schedule: Schedule
    ) -> None:
        self.folder, self._schedule = folder, schedule
        self._parameters = _parameters(parameters, folder)
        self._cleanup = contextlib.ExitStack()
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> 'SimulationLauncher':
        try:
            self.folder.mkdir(parents=True)
        except OSError as error:
            raise NodeError(f'expected a new folder {self.folder}, got {error}') from error
        (self.folder / SCHEDULE).write_text(schedule_to_text(self._schedule))
        with contextlib.ExitStack() as stack:
            self._stop_request = StopRequest()
            stack.callback(self._stop_request.restore)
            domain = stack.enter_context(free_domain())
            stack.callback(lambda: self._end(*self.processes))
            for name in (name for name in self._parameters if name != DRIVER):
                self._start(name, domain)
            self._listen(domain, stack)
            self._domain = domain
            self._stop_request.raise_if_made()
            self._stop_request.heed_between_callbacks()
            self._cleanup = stack.pop_all()
        return self

    def __exit__(self, *exception: object) -> None:
        self._cleanup.close()

    def _start(self, name: str, domain: int) -> None:
        """Start a node as a process in its own session, which does not receive Ctrl-C."""
        file = self.folder / f'{name}.yaml'
        parameters = {name: {'ros__parameters': self._parameters[name]}}
        file.write_text(yaml.safe_dump(parameters, sort_keys=False))
        environment = {
            **os.environ,
            'ROS_DOMAIN_ID': str(domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'ROS_LOG_DIR': str(self.folder / 'log'),
            PARENT_VARIABLE: str(os.getpid()),
        }
        code = f'import sys; from rpms_ros.nodes.{name} import main; sys.exit(main())'
        with (self.folder / f'{name}.txt').open('wb') as said:
            self.processes[name] = subprocess.Popen(
                [sys.executable, '-c', code, '--ros-args', '--params-file', str(file)],
                env=environment,
                stdout=said,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )

    def _listen(self, domain: int, stack: contextlib.ExitStack) -> None:
        """Have recorder and monitor in a private context of this process, until the stack ends."""
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
        use_fast_discovery()
        context = Context()
        without = SignalHandlerOptions.NO
        rclpy.init(args=[], context=context, domain_id=domain, signal_handler_options=without)
        stack.callback(context.try_shutdown)
        self._executor = EventsExecutor(context=context)
        stack.callback(self._executor.shutdown)
        options: dict[str, Any] = {'context': context, 'use_global_arguments': False}
        self.monitor = Monitor(**options)
        stack.callback(self.monitor.destroy_node)
        # the command prints where the recording is
        set_logger_level('recorder', LoggingSeverity.WARN)
        stack.callback(set_logger_level, 'recorder', LoggingSeverity.UNSET)
        path = Parameter('path', value=str(self.folder / RECORDING))
        self.recorder = Recorder(parameter_overrides=[path], **options)
        stack.callback(self.recorder.destroy_node)
        for node in (self.recorder, self.monitor):
            self._executor.add_node(node)

    def step(self, duration: float) -> None:
        """Process messages for `duration` seconds.

        Raises
        ------
        NodeError
            If a process has ended.
        KeyboardInterrupt
            If SIGINT or SIGTERM has come.
        """
        end = time.monotonic() + duration
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=min(left, 0.05))
            self._stop_request.raise_if_made()
            # on a busy machine the force would be found after the first pulses
            if DRIVER not in self.processes and self.recorder.counts['force']:
                self._start(DRIVER, self._domain)
            for name, process in self.processes.items():
                if process.poll() is not None:
                    said = (self.folder / f'{name}.txt').read_text().strip().splitlines()
                    ended = f'exit code {process.returncode}: {said[-1] if said else "nothing"}'
                    raise NodeError(f'expected {name} to run, got {ended}')

    def stop(self) -> None:
        """End driver and plant, wait for the last estimates, then close the recording."""
        self._end(DRIVER, PLANT)
        heard, quiet_since = -1, time.monotonic()
        limit = quiet_since + _PATIENCE
        while time.monotonic() < min(limit, quiet_since + _QUIET):
            self._executor.spin_once(timeout_sec=0.05)
            if len(self.monitor.estimates) != heard:
                heard, quiet_since = len(self.monitor.estimates), time.monotonic()
        self._end(IDENTIFIER)
        self.recorder.close()
        self._stop_request.raise_if_made()

    def _end(self, *names: str) -> None:
        """End processes: by a signal that they handle, then by SIGKILL."""
        processes = [self.processes.pop(name) for name in names if name in self.processes]
        for process in processes:
            process.send_signal(signal.SIGINT)
        end = time.monotonic() + _PATIENCE
        for process in processes:
            try:
                process.wait(max(0.0, end - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
