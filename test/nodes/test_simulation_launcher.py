# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The launcher end to end: as processes with a recording, with a page, and ended early."""

import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from rpms_ros.errors import NodeError
from rpms_ros.nodes.simulation_launcher import SimulationLauncher
from rpms_ros.recording import read_recording
from rpms_ros.report.recorded import true_muscle
from rpms_ros.stimulation import paper_random

pytestmark = pytest.mark.long

DEMO = ('-m', 'rpms_ros.cli', 'demo')


def processes_of(folder, file=''):
    """Processes that were started with a file, or any, in this folder and still run."""
    found = []
    for path in Path('/proc').glob('[0-9]*'):
        try:
            command = (path / 'cmdline').read_bytes()
        except OSError:
            continue  # it has ended meanwhile
        if f'{folder}/{file}'.encode() in command and int(path.name) != os.getpid():
            found.append(int(path.name))
    return found


def demo(folder, *options):
    """Return what a demo prints that has lost nothing.

    A machine that stands still for a tenth of a second makes pulses late, and a driver that is
    held up for longer stops itself; the demo says either with its exit code, and is tried again.
    """
    held_up = ("'pulse_late'", 'driver: ended before the schedule did', 'is this machine busy?')
    for _ in range(5):
        shutil.rmtree(folder, ignore_errors=True)
        done = subprocess.run(
            [sys.executable, *DEMO, *options, '--out', str(folder)],
            text=True,
            capture_output=True,
            check=False,
            timeout=250,
        )
        if done.returncode == 0 or not any(one in done.stdout + done.stderr for one in held_up):
            break
    assert (done.returncode, done.stderr) == (0, ''), done.stdout
    return done.stdout


def test_the_demo_loses_nothing_and_replays_bit_for_bit(tmp_path):
    folder = tmp_path / 'demo'
    said = demo(folder, '--duration', '2', '--noise', '0.01')
    assert 'estimates, bit for bit' in said
    assert 'lost 0; faults none' in said
    assert '  truth      ' in said
    recording = read_recording(folder / 'recording')
    assert len(recording.forces) > 1900
    # 20 Hz for 2 s; a busy machine may make the driver drop one or the other, and say so
    dropped = int(re.findall(r'\(dropped (\d+)\)', said)[-1])
    assert len(recording.pulses) + dropped == 40
    assert 'estimate' in {facts.name.strip('/') for facts in recording.facts.topics}
    assert processes_of(folder) == []


def test_a_demo_of_a_scenario_is_followed_and_held_against_its_truth(tmp_path):
    folder, scenario = tmp_path / 'demo', tmp_path / 'pushed.yaml'
    scenario.write_text(
        'name: pushed\n'
        'description: the patient pushes once\n'
        'fatigue: {force_loss: 0.05, slowing: 0.02, recovery: 127.0}\n'
        'efforts:\n'
        '  - {kind: voluntary, at: 2.0, duration: 0.5, peak: 1.0}\n'
    )
    said = demo(folder, '--scenario', str(scenario), '--duration', '4')
    assert 'estimates, bit for bit' in said
    assert 'scenario   pushed: the patient pushes once' in said
    assert '--estimator tracking' in said
    assert '  truth      ' in said
    muscle = true_muscle(read_recording(folder / 'recording'), 20.0)
    assert muscle is not None
    # ten messages a second, some before the first pulse
    assert len(muscle.stamp_ns) > 35
    assert muscle.state['effort'].max() > 0.5
    assert muscle.curve[-1, -1] < 0.98 * muscle.curve[0, -1]


@pytest.mark.parametrize('stop', [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_no_process_is_left_behind(python, tmp_path, wait_for, stop):
    folder = tmp_path / 'demo'
    process = python(*DEMO, '--out', str(folder))
    wait_for(lambda: len(processes_of(folder)) == 3, 120.0)
    # all of them listen by then, or are about to
    wait_for(lambda: (folder / 'recording').exists(), 120.0)
    process.send_signal(stop)
    # a process that is compiling hears the signal afterwards
    _, errors = process.communicate(timeout=250)
    wait_for(lambda: processes_of(folder) == [], 250.0)
    assert 'Traceback' not in errors
    if stop == signal.SIGINT:
        assert process.returncode == 130


def test_a_process_that_ends_too_early_is_named_with_its_last_words(tmp_path):
    parameters = {'plant_simulator': {'rate': 1000}}
    lines = r'expected plant_simulator to run, got exit code 2: error: parameter rate: expected'
    with (
        SimulationLauncher(tmp_path / 'session', parameters, paper_random()) as launcher,
        pytest.raises(NodeError, match=lines),
    ):
        launcher.step(30.0)
    assert processes_of(tmp_path) == []


def test_the_page_of_a_demo_answers_when_it_is_printed_and_only_shows(
    python, tmp_path, unused_port
):
    process = python(*DEMO, '--live', str(unused_port), '--out', str(tmp_path / 'demo'))
    said = [process.stdout.readline() for _ in range(2)]
    url = said[1].strip().rpartition(' ')[2]
    with urllib.request.urlopen(url, timeout=60) as answer:
        assert answer.status == 200
    stop = urllib.request.Request(f'{url}stop', method='POST')
    with pytest.raises(urllib.error.HTTPError, match='403'):
        urllib.request.urlopen(stop, timeout=60)
    process.send_signal(signal.SIGINT)
    # a machine under load may have to compile first
    _, errors = process.communicate(timeout=180)
    assert 'Traceback' not in errors
