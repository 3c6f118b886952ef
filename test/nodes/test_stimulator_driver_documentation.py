# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""docs/driver.md and config/stimulator_driver.yaml hold what the code says."""

import re
from pathlib import Path

import pytest
import yaml

from rpms_ros.nodes.common.parameters import descriptions
from rpms_ros.nodes.driver.parameters import DriverParameters
from rpms_ros.schedule_messages import schedule_of
from rpms_ros.stimulation import schedule_from_text
from rpms_ros.stimulation.driver.states import TRANSITIONS, Command, State
from rpms_ros.stimulation.limits.patient import patient_from_mapping
from rpms_ros.stimulation.schedule.description import from_text

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / 'docs' / 'driver.md').read_text()
CONFIG = (ROOT / 'config' / 'stimulator_driver.yaml').read_text()
COLUMNS = (
    Command.CONFIGURE,
    Command.ARM,
    Command.START,
    Command.FINISH,
    Command.DISARM,
    Command.CLEANUP,
    Command.FAIL,
    Command.STOP,
)


def default_of(name):
    """As it is written in a file."""
    value = getattr(DriverParameters, name)
    return list(value) if isinstance(value, tuple) else value


@pytest.mark.parametrize('state', State)
def test_the_page_holds_every_transition(state):
    def cell(command):
        target = TRANSITIONS.get((state, command))
        if target is None:
            return '–'
        return 'stays' if target is state else f'`{target.name}`'

    assert f'| `{state.name}` | {" | ".join(cell(command) for command in COLUMNS)} |' in PAGE


def test_schedule_and_patient_on_the_page_can_be_read():
    schedule, patient = re.findall(r'```yaml\n(.*?)```', PAGE, re.DOTALL)
    assert schedule_from_text(schedule).totals.duration == pytest.approx(41.0, abs=1e-9)
    assert from_text(patient, patient_from_mapping).identifier == 'P01'


def test_the_goal_on_the_page_is_three_trains_and_their_pauses():
    (code,) = (
        text for text in re.findall(r'```python\n(.*?)```', PAGE, re.DOTALL) if 'Goal(' in text
    )
    found = {}
    exec(code, found)
    schedule = schedule_of(found['goal'].typed_schedule)
    # each: 2 s of pulses at 20 Hz, then 5 s without
    assert (schedule.totals.pulses, schedule.totals.duration) == (120, 21.0)


def test_the_file_of_parameters_is_complete_and_names_defaults():
    given = yaml.safe_load(CONFIG)['/**']['ros__parameters']
    assert list(given) == list(descriptions(DriverParameters))
    changed = {name for name, value in given.items() if default_of(name) != value}
    # said so beside it: only a simulated device may do without
    assert changed == {'require_operator', 'require_stop_button'}
