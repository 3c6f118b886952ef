# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver of bench/soak.py: with console, stop button and recorder, in real time.

A driver refuses simulated time, so it lives for as long as the soak takes.  An operator arms and
holds the enable, again and again; now and then somebody presses the stop button, or the driver is
restarted.
"""

import math
import os
import pty
import random
import time
from collections import Counter
from pathlib import Path

from rclpy.node import Node
from soak_laboratory import Counting

from rpms_msgs.msg import DriverStatus
from rpms_ros.nodes import operator_console
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.operator import Keyboard
from rpms_ros.nodes.operator_console import OperatorConsole
from rpms_ros.nodes.plant_simulator import PlantSimulator
from rpms_ros.nodes.recorder import Recorder
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.nodes.stop_button import StopButton
from rpms_ros.recording import read_facts

SCHEDULE = (
    'name: soak\nsegments: [{kind: constant, rate_hz: 20.0, duration_s: 2.0, intensity: 0.5}]\n'
)
NAMESPACE = 'clinic'
RATE = 100.0
# A process that also simulates an hour may stall for longer than the defaults allow.
_PATIENT = {'stop_button_timeout': 5.0, 'heartbeat_timeout': 5.0, 'lateness_limit': 0.1}
_STOP_SHARE, _RESTART_SHARE = 0.2, 0.2
_KEY_PERIOD_S, _ASK_PERIOD_S = 0.1, 5.0


class Clinic:
    """Nodes of one patient on the executor of `graph`; `poll` is called often."""

    def __init__(self, graph, folder: Path, seed):
        self.graph = graph
        self.generator = random.Random(seed)
        self.path = folder / 'clinic'
        self.counts = Counter()
        self._terminals = [pty.openpty() for _ in range(2)]
        keyboards = [Keyboard(read) for _, read in self._terminals]
        self._console_keys, self._button_keys = (typed for typed, _ in self._terminals)
        schedule = folder / 'schedule.yaml'
        schedule.write_text(SCHEDULE)
        self.driver = None
        self._start_driver()
        self._add(StopButton, keyboards[1])
        self._add(PlantSimulator, rate=RATE)
        self.recorder = self._add(Recorder, path=str(self.path))
        operator_console.KEY_DELAY_S = 2.0
        self.console = self._add(
            OperatorConsole,
            keyboards[0],
            operator='ada',
            schedule_file=str(schedule),
            key_repeat=2.0,
        )
        watcher = self._add(lambda **options: Node('watcher', **options))
        self.statuses: list[DriverStatus] = []
        watcher.create_subscription(
            DriverStatus, topics.DRIVER_STATUS, self._on_status, qos.STATUS
        )
        self._ran = False
        self._next_key = self._next_ask = 0.0
        self._stop_at = math.inf

    def _add(self, kind, *arguments, **parameters):
        return self.graph.add(
            lambda **options: kind(*arguments, namespace=NAMESPACE, **options), **parameters
        )

    def _start_driver(self):
        if self.driver is not None:
            self._count_driver()
            self.graph.remove(self.driver)
            self.counts['restarts'] += 1
        self.driver = self._add(StimulatorDriver, **_PATIENT)
        self.driver._reports._accepted = Counting(self.driver._reports._accepted)

    def _count_driver(self):
        self.counts['delivered'] += self.driver.controller.delivered
        self.counts['runs'] += self.driver._reports._accepted.count

    def _on_status(self, status):
        self.statuses = [status]

    @property
    def _state(self):
        return self.statuses[-1].state if self.statuses else None

    def poll(self):
        """Do the next action of the operator."""
        now = time.monotonic()
        if now < self._next_key or self._state is None:
            return
        self._next_key = now + _KEY_PERIOD_S
        if self._state == DriverStatus.RUNNING:
            self._while_running(now)
        elif self._ran:
            self._after_run()
        elif self._state == DriverStatus.STOPPED:
            self._type(self._button_keys, b'r')
            self._type(self._console_keys, b'r')
        elif not self.console.client.token or self._state == DriverStatus.UNCONFIGURED:
            # Each request gives another token: the answer to this one is waited for.
            if now > self._next_ask:
                self._next_ask = now + _ASK_PERIOD_S
                self._type(self._console_keys, b'a')
        else:
            self._type(self._console_keys, b'e')

    def _while_running(self, now):
        if not self._ran:
            self._ran = True
            stopped = self.generator.random() < _STOP_SHARE
            self._stop_at = now + 1.0 if stopped else math.inf
        self._type(self._console_keys, b'e')
        if now > self._stop_at:
            self._stop_at = math.inf
            self._type(self._button_keys, b' ')
            self.counts['stops'] += 1

    def _after_run(self):
        self._ran = False
        self._next_ask = 0.0
        if self.generator.random() < _RESTART_SHARE:
            self._start_driver()

    def _type(self, terminal, key):
        os.write(terminal, key)

    def end(self):
        """Stop, and compare what was delivered with what was recorded."""
        self._type(self._button_keys, b' ')
        # a status that is not RUNNING may be older than a run that just began
        self.graph.wait_for(lambda: self._state == DriverStatus.STOPPED)
        self._count_driver()
        counts = self.recorder.counts
        self.graph.wait_for(lambda: counts[topics.PULSES] >= self.counts['delivered'])
        self.graph.wait_for(lambda: counts[topics.ACCEPTED_SCHEDULE] >= self.counts['runs'])
        self.graph.remove(self.recorder)
        recorded = {topic.name: topic.count for topic in read_facts(self.path).topics}
        self.counts['pulses recorded'] = recorded.get(f'/{NAMESPACE}/{topics.PULSES}', 0)
        name = f'/{NAMESPACE}/{topics.ACCEPTED_SCHEDULE}'
        self.counts['schedules recorded'] = recorded.get(name, 0)
        for pair in self._terminals:
            for descriptor in pair:
                try:
                    os.close(descriptor)
                except OSError:
                    continue
