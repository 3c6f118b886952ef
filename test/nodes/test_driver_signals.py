# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The driver as a process: every signal that can be heard disarms and ends it."""

import os
import signal
import subprocess
import sys

import pytest
from rclpy.node import Node

from rpms_msgs.msg import DriverStatus, Pulse
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.runner import ENDING, name_of
from rpms_ros.stimulation import constant
from rpms_ros.stimulation.records.append_only import verify_log

# a machine under load may hold up the driver for seconds; what these limits do is tested elsewhere
START = """
import signal
import sys
# as nohup does: a driver whose terminal is gone ends all the same
signal.signal(signal.SIGHUP, signal.SIG_IGN)
from dataclasses import replace
from rpms_ros.nodes import stimulator_driver
settings_of = stimulator_driver.driver_settings_of
stimulator_driver.driver_settings_of = lambda given: replace(
    settings_of(given), executor_timeout_s=5.0, response_limit_s=5.0, stuck_limit_s=5.0,
    supervisor_timeout_s=5.0,
)
stimulator_driver.patience_s = lambda *_: 5.0
sys.exit(stimulator_driver.main())
"""
ARGUMENTS = (
    'autostart:=true',
    'require_operator:=false',
    'require_stop_button:=false',
    'lateness_limit:=0.1',
)


class DriverProcess:
    """A driver in a process of its own that runs a train, and a node that listens."""

    def __init__(self, graph, domain, folder, schedule):
        self.graph = graph
        self.pulses, self.statuses = [], []
        listener = graph.add(lambda **options: Node('listener', **options))
        listen = listener.create_subscription
        listen(Pulse, topics.PULSES, self.pulses.append, qos.PULSES)
        listen(DriverStatus, topics.DRIVER_STATUS, self.statuses.append, qos.STATUS)
        self.audit = folder / 'audit.jsonl'
        arguments = [*ARGUMENTS, f'audit_log:={self.audit}', f'schedule_file:={schedule}']
        self.process = subprocess.Popen(
            [sys.executable, '-c', START, '--ros-args']
            + [part for argument in arguments for part in ('-p', argument)],
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
            stderr=subprocess.PIPE,
            text=True,
        )

    def run(self):
        self.graph.wait_for(lambda: len(self.pulses) > 5, timeout=120.0)

    def ended(self):
        self.graph.wait_for(lambda: self.process.poll() is not None, timeout=120.0)
        return self.process.returncode


@pytest.fixture
def driver(graph, domain, tmp_path, schedule_file):
    train = schedule_file(constant(0.5, 90.0, 50.0))
    started = DriverProcess(graph, domain, tmp_path, train)
    yield started
    started.process.kill()
    started.process.communicate()


@pytest.mark.long
@pytest.mark.parametrize(
    'number',
    [
        signal.SIGHUP,
        signal.SIGQUIT,
        signal.SIGUSR1,
        signal.SIGTERM,
        signal.SIGINT,
        signal.SIGTSTP,
        # of a watchdog of systemd, and one without a name
        signal.SIGABRT,
        signal.SIGRTMIN + 3,
    ],
)
def test_a_signal_disarms_and_ends_the_driver(driver, number):
    driver.run()
    driver.process.send_signal(number)
    assert driver.ended() == 0
    stops = [record.content for record in verify_log(driver.audit).records]
    assert stops[-1]['kind'] == 'end'
    reasons = [content['reason'] for content in stops if content['kind'] == 'signal']
    assert reasons == [f'signal {name_of(number)}']
    assert 'disarm' in [content['kind'] for content in stops]


def test_every_signal_that_ends_a_process_and_can_be_caught_is():
    caught = {name_of(one) for one in ENDING}
    assert {'SIGINT', 'SIGTERM', 'SIGABRT', 'SIGSTKFLT', 'SIGPWR'} <= caught
    assert {'SIGRTMIN', 'SIGRTMIN+1', 'SIGRTMAX'} <= caught
    assert not {'SIGKILL', 'SIGSEGV', 'SIGCHLD', 'SIGTSTP'} & caught
