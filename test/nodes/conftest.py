# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A live page, and a simulated muscle that is stimulated, on the graph of a test."""

import os
import socket
import subprocess
import sys
from dataclasses import replace

import pytest

from rpms_ros.errors import RecordingError
from rpms_ros.nodes import stimulator_driver
from rpms_ros.nodes.driver.parameters import driver_settings_of
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.live_page import LivePage
from rpms_ros.nodes.plant_simulator import PlantSimulator
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.recording import read_recording
from rpms_ros.stimulation import Schedule, UniformRandom, schedule_to_text

RPMS = [sys.executable, '-c', 'import sys; from rpms_ros.cli import main; sys.exit(main())']
TOKEN = 'correct-horse-battery'
# a machine under load may stall for longer than the defaults allow
PATIENT = {'executor_timeout': 10.0, 'watch_timeout': 10.0, 'stop_button_timeout': 10.0}


@pytest.fixture(autouse=True)
def patient_supervision(any_lateness, monkeypatch):
    """Drivers of this process that a machine under load may hold up for seconds.

    That the limits themselves stop a device that hangs is tested in test/stimulation.
    """
    del any_lateness

    def patient(settings):
        return replace(
            driver_settings_of(settings),
            response_limit_s=0.5,
            stuck_limit_s=5.0,
            supervisor_timeout_s=5.0,
            lateness_limit_s=5.0,
        )

    monkeypatch.setattr(stimulator_driver, 'driver_settings_of', patient)


@pytest.fixture
def page(graph):
    """A page with a stop, on a free port."""
    return graph.add(lambda **options: LivePage(TOKEN, **options), port=0)


@pytest.fixture
def schedule_file(tmp_path):
    """Write a schedule; return its path."""

    def write(schedule):
        path = tmp_path / 'schedule.yaml'
        path.write_text(schedule_to_text(schedule))
        return str(path)

    return write


@pytest.fixture
def driven(graph, schedule_file):
    """A simulated muscle that is stimulated for a minute, and its identifier."""
    identifier = graph.add(Identifier, estimator='recursive')
    graph.add(PlantSimulator, minimum_subscribers=2, publication_delay=0.05, noise=0.02)
    driver = graph.add(
        StimulatorDriver,
        autostart=True,
        require_operator=False,
        require_stop_button=False,
        minimum_subscribers=3,
        schedule_file=schedule_file(Schedule((UniformRandom(20.0, 60.0, low=0.2),), seed=1)),
        **PATIENT,
    )
    return identifier, driver


@pytest.fixture
def written_so_far():
    """Read a recording that is still being written; None before its first pulse.

    On a busy machine thousands of samples are heard before that.
    """

    def read(path):
        try:
            return read_recording(path)
        except RecordingError as error:
            if 'expected topic pulses' not in str(error):
                raise
            return None

    return read


@pytest.fixture
def unused_port():
    """A port that nobody listens on, of those that the system hands out to nobody by itself."""
    lowest = 10_000 + os.getpid() % 10_000
    for port in range(lowest, lowest + 1000):
        try:
            socket.create_server(('127.0.0.1', port)).close()
        except OSError:
            continue
        return port
    return pytest.fail('no port is free')


@pytest.fixture
def page_process(domain):
    """Start `rpms live` as a process, ended with the test; return it and the address it prints."""
    started = []

    def start(*arguments):
        process = subprocess.Popen(
            [*RPMS, 'live', *arguments],
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        return process, process.stdout.readline().strip()

    yield start
    for process in started:
        process.kill()
        process.communicate()
