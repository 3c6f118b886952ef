# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Any text whatever is a schedule or a StimulationError, in bounded time."""

import os

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import schedule_from_mapping, schedule_from_text, schedule_to_text
from rpms_ros.stimulation.limits.device_specification import load_device_specification
from rpms_ros.stimulation.limits.patient import load_patient
from rpms_ros.stimulation.schedule.schedule import LONGEST_NAME

# set by bench/hostile_texts.py for the full count
COUNT = int(os.environ.get('RPMS_HOSTILE_TEXTS', '150'))


def check(text):
    """Read a text; what comes of it has to be good or refused with a reason."""
    try:
        schedule = schedule_from_text(text)
        plan = schedule.plan if schedule.pulse_count < 5000 else None
    except StimulationError as fault:
        said = str(fault)
        assert 'expected' in said
        assert said.isprintable()
        assert len(said) < 1500
        return
    assert schedule.name.isprintable()
    assert 0 < len(schedule.name) <= LONGEST_NAME
    assert schedule_from_text(schedule_to_text(schedule)) == schedule
    if plan is not None:
        assert np.all(np.diff(plan.onset_ns) >= 0)
        assert np.all((plan.intensity >= 0.0) & (plan.intensity <= 1.0))


def test_the_texts_that_broke_something_once(hostile_texts):
    for text in hostile_texts.KNOWN:
        check(text)
    assert any(len(text) > 1_000_000 for text in hostile_texts.KNOWN)


@given(st.randoms(use_true_random=False))
@settings(max_examples=COUNT, deadline=None)
def test_texts_from_a_grammar_and_from_bytes(hostile_texts, random):
    check(hostile_texts.hostile_text(random))


@given(st.text(st.characters(), max_size=60))
@settings(max_examples=COUNT, deadline=None)
def test_any_name(name):
    content = {'name': name, 'segments': [{'kind': 'single'}]}
    if not name.isprintable() or not name.strip():
        # white space is taken for one blank each
        content['name'] = ' '.join(name.split())
        if not content['name'].isprintable() or not content['name']:
            with pytest.raises(
                StimulationError, match='name: expected a text of 1 to 64'
            ) as caught:
                schedule_from_mapping(content)
            assert str(caught.value).isprintable()
            return
    schedule = schedule_from_mapping(content)
    assert schedule_from_text(schedule_to_text(schedule)) == schedule


@pytest.mark.parametrize('key', ['\ud800', 'a\nb', '', 'x' * 10_000])
def test_any_key_of_a_mapping(key):
    with pytest.raises(StimulationError, match='expected one of') as caught:
        schedule_from_mapping({'segments': [{'kind': 'single'}], key: 10**5000})
    assert str(caught.value).isprintable()


def test_hostile_files_of_devices_and_patients(hostile_texts, tmp_path):
    path = tmp_path / 'hostile.yaml'
    for text in hostile_texts.hostile_texts(150, seed=3):
        path.write_bytes(text.encode('utf-8', 'surrogatepass'))
        for load in (load_patient, lambda path: load_device_specification(str(path))):
            with pytest.raises(StimulationError, match=r'hostile\.yaml: '):
                load(path)
