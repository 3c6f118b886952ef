# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pages, files and layouts hold what the code says; what a page tells to type works."""

import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState

from rpms_msgs.msg import Schedule, ScheduleSegment
from rpms_ros.nodes.common.parameters import descriptions
from rpms_ros.nodes.driver.parameters import DriverParameters
from rpms_ros.schedule_messages import schedule_of
from rpms_ros.stimulation import schedule_from_text
from rpms_ros.stimulation.driver.states import TRANSITIONS, Command, State
from rpms_ros.stimulation.limits.patient import patient_from_mapping
from rpms_ros.stimulation.schedule.description import from_text

DRIVER = '/stimulator_driver'
ROOT = Path(__file__).resolve().parents[2]
NODES_PAGE = (ROOT / 'docs' / 'nodes.md').read_text()
DRIVER_PAGE = (ROOT / 'docs' / 'driver.md').read_text()
CONFIG = (ROOT / 'config' / 'stimulator_driver.yaml').read_text()
PULSE_PAGE = (ROOT / 'docs' / 'how-to' / 'first-pulse.md').read_text()
REHEARSAL = PULSE_PAGE[PULSE_PAGE.index('A third one.') : PULSE_PAGE.index('Now stop one.')]
HAZARDS = (ROOT / 'docs' / 'hazards.md').read_text()
NAMED = sorted(set(re.findall(r'`(test_\w+\.py)::(\w+)`', HAZARDS)))


def test_files_of_parameters_and_schema_are_what_tools_document_writes():
    tool = [sys.executable, str(ROOT / 'tools' / 'document'), '--check']
    done = subprocess.run(tool, capture_output=True, text=True, timeout=250, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')


@pytest.mark.parametrize('state', State)
def test_the_page_holds_every_transition(state):
    def cell(command):
        target = TRANSITIONS.get((state, command))
        if target is None:
            return '–'
        return 'stays' if target is state else f'`{target.name}`'

    assert f'| `{state.name}` | {" | ".join(map(cell, Command))} |' in DRIVER_PAGE


def test_schedule_patient_and_goal_on_the_page_can_be_read():
    schedule, patient = re.findall(r'```yaml\n(.*?)```', DRIVER_PAGE, re.DOTALL)
    assert schedule_from_text(schedule).plan.duration_s == pytest.approx(41.0, abs=1e-9)
    assert from_text(patient, patient_from_mapping).identifier == 'P01'
    (code,) = (
        text
        for text in re.findall(r'```python\n(.*?)```', DRIVER_PAGE, re.DOTALL)
        if 'Goal(' in text
    )
    found = {}
    exec(code, found)
    schedule = schedule_of(found['goal'].typed_schedule)
    # each: 2 s of pulses at 20 Hz, then 5 s without
    assert (schedule.pulse_count, schedule.plan.duration_s) == (120, 21.0)


def test_the_file_of_parameters_is_complete_and_names_defaults():
    given = yaml.safe_load(CONFIG)['/**']['ros__parameters']
    assert list(given) == list(descriptions(DriverParameters))
    defaults = {**vars(DriverParameters()), 'stop_buttons': []}
    changed = {name for name, value in given.items() if defaults[name] != value}
    # said so beside it: only a simulated device may do without
    assert changed == {'require_operator', 'require_stop_button'}


def test_the_rehearsal_gives_one_pulse_and_ends_as_the_page_says(driver_bench):
    bench = driver_bench()
    lines = [shlex.split(line)[1:] for line in REHEARSAL.splitlines() if line.startswith('ros2 ')]
    results = []
    for line in lines:
        match [word for word in line if not word.startswith('--')]:
            case ['lifecycle', 'set', _, label]:
                asked = ChangeState.Request(transition=Transition(label=label))
                assert bench.call(bench.changes, asked).success, line
            case ['action', 'send_goal', _, 'rpms_msgs/action/RunSchedule', fields]:
                segments = yaml.safe_load(fields)['typed_schedule']['segments']
                typed = Schedule(segments=[ScheduleSegment(**segment) for segment in segments])
                results.append(bench.result(bench.send(typed)).result)
                bench.graph.wait_for(lambda: not bench.driver._active)
    assert [(one.completed, one.pulses_delivered) for one in results] == [(True, 1)]


def test_files_of_the_page_are_read():
    air, phantom, nobody, driver = re.findall(r'```yaml\n(.*?)```', PULSE_PAGE, re.DOTALL)
    assert schedule_from_text(air).pulse_count == 1
    assert schedule_from_text(phantom).pulse_count == 30
    assert from_text(nobody, patient_from_mapping).largest_comfortable == 0.3
    given = yaml.safe_load(driver)[DRIVER]['ros__parameters']
    settings = DriverParameters(**{**given, 'stop_buttons': tuple(given['stop_buttons'])})
    assert not settings.simulated


@pytest.mark.parametrize(('file', 'test'), NAMED)
def test_a_test_that_is_named_exists(file, test):
    (path,) = (ROOT / 'test').rglob(file)
    assert re.search(rf'^def {test}\(', path.read_text(), re.MULTILINE)


def test_every_hazard_has_a_test_and_no_conformity_is_claimed():
    rows = [line for line in HAZARDS.splitlines() if line.startswith('| ') and '---' not in line]
    measures = [row for row in rows if not row.startswith('| hazard |')]
    assert len(measures) > 30
    assert all('`test_' in row for row in measures)
    assert 'claims no conformity' in HAZARDS


@pytest.mark.long
@pytest.mark.parametrize('sent', [signal.SIGINT, signal.SIGTERM])
def test_the_code_on_the_page_runs_until_a_signal(python, sent):
    code = NODES_PAGE.split('```python\n')[1].split('```')[0]
    told = code.replace('while not', 'print("running", flush=True)\nwhile not')
    assert told != code
    process = python('-c', told)
    # the first run on a machine compiles for up to a minute before
    assert process.stdout.readline() == 'running\n'
    time.sleep(2.0)
    assert process.poll() is None
    process.send_signal(sent)
    _, err = process.communicate(timeout=120)
    assert 'Traceback' not in err
    assert process.returncode == 0
