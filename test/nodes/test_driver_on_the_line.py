# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The whole driver on a serial line: node, guard, and an instrument of the Rapid2 class."""

import contextlib
import os
import time
from dataclasses import replace
from pathlib import Path

import pytest
from lifecycle_msgs.msg import Transition

from rpms_msgs.msg import DriverStatus, Pulse
from rpms_ros.nodes.driver.parameters import driver_settings_of
from rpms_ros.stimulation import constant
from rpms_ros.stimulation.devices.serial_line import SerialDevice

LONG = constant(0.1, 20.0, 10.0)


@pytest.fixture
def more():
    """Parameters of the driver beside those below."""
    return {}


@pytest.fixture
def batch(monkeypatch):
    """A priority that needs no right, asked for in place of SCHED_FIFO."""

    def put_under(policy):
        for task in Path('/proc/self/task').iterdir():
            # one may have ended meanwhile
            with contextlib.suppress(ProcessLookupError):
                os.sched_setscheduler(int(task.name), policy, os.sched_param(0))
        return ''

    monkeypatch.setattr(
        'rpms_ros.nodes.stimulator_driver.ask_for_realtime',
        lambda _priority: put_under(os.SCHED_BATCH),
    )
    yield
    put_under(os.SCHED_OTHER)


@pytest.fixture
def theatre(
    driver_bench, instrument, patient_file, specification_file, tmp_path, monkeypatch, more
):
    """An instrument, its driver with everything that a real device needs, and an operator."""
    fake = instrument(watchdog_s=20.0)

    # a machine under load may hold up instrument, guard and driver for longer than the 0.1 s to
    # 0.2 s that they are given
    def build(options):
        return SerialDevice(
            options.port, options.maximum_intensity, timeout_s=5.0, beat_limit_s=20.0
        )

    def settings_of(given):
        return replace(
            driver_settings_of(given),
            executor_timeout_s=5.0,
            response_limit_s=5.0,
            stuck_limit_s=5.0,
            supervisor_timeout_s=5.0,
        )

    monkeypatch.setattr('rpms_ros.stimulation.devices.serial_line.build', build)
    monkeypatch.setattr('rpms_ros.nodes.stimulator_driver.driver_settings_of', settings_of)
    bench = driver_bench(
        button=True,
        operator='ada',
        require_stop_button=True,
        device='serial',
        port=fake.port,
        device_specification=str(specification_file),
        patient_file=str(patient_file),
        ledger_folder=str(tmp_path / 'ledger'),
        audit_log=str(tmp_path / 'audit.jsonl'),
        **more,
    )
    assert bench.change(Transition.TRANSITION_CONFIGURE)
    return fake, bench


def refused_arming(bench):
    """Ask for an arming until the reason why it is refused is neither heartbeat nor button."""
    bench.ada.enable = True
    assert bench.ask(bench.ada.request()).success
    bench.graph.wait_for(lambda: bool(bench.ada.token))
    reasons = []

    def said():
        answer = bench.ask(bench.ada.confirm())
        assert not answer.success
        reasons.append(answer.message)
        return 'patient' in reasons[-1]

    bench.graph.wait_for(said)
    assert bench.controller.state.name == 'DISARMED'
    return reasons[-1]


def test_a_patient_whose_figures_have_expired_meanwhile_is_not_stimulated(theatre, patient_file):
    fake, bench = theatre
    lines = patient_file.read_text().splitlines()
    past = {'set_on': '2020-01-01', 'expires': '2020-01-02'}
    dated = [next((f'{k}: {d}' for k, d in past.items() if k in line), line) for line in lines]
    patient_file.write_text('\n'.join(dated))
    reason = refused_arming(bench)
    assert reason.startswith('patient P01: expected a day from 2020-01-01 to 2020-01-02, got')
    assert not fake.armed


@pytest.mark.parametrize(
    ('before', 'after'),
    [
        ('largest_comfortable: 0.55', 'largest_comfortable: 0.45'),
        ('pulses: 4000', 'pulses: 3000'),
        ('identifier: P01', 'identifier: P02'),
    ],
)
def test_figures_of_the_patient_that_were_changed_need_a_new_start(
    theatre, patient_file, before, after
):
    fake, bench = theatre
    # what changes no limit changes nothing
    text = patient_file.read_text().replace('set_by: A. Physician', 'set_by: B. Physician')
    assert before in text
    patient_file.write_text(text.replace(before, after))
    reason = refused_arming(bench)
    assert reason == (
        f'expected the figures of {patient_file} and of the device specification as they were at '
        'the start, got others: start the driver again'
    )
    assert not fake.armed


def test_a_press_disarms_the_instrument_and_what_came_is_told(theatre):
    fake, bench = theatre
    graph, pulses, statuses = bench.graph, bench.pulses, bench.statuses
    bench.arm()
    assert fake.armed
    bench.ada.start(LONG)
    graph.wait_for(lambda: len(pulses) > 3)
    bench.button.set(True)
    bench.wait_for_state(DriverStatus.STOPPED)
    graph.wait_for(lambda: not fake.armed)
    given = len(fake.triggers)
    graph.wait_for(lambda: len(pulses) >= given and statuses[-1].dose_pulses >= given)
    # and no more for a while
    end = time.monotonic() + 0.5
    graph.wait_for(lambda: time.monotonic() > end)
    assert len(fake.triggers) == len(pulses) == given
    # one that was in the books already when the stop came was not given
    assert statuses[-1].dose_pulses in (given, given + 1)
    # the published protocol has no word on whether a pulse came
    assert all(pulse.unverified & Pulse.UNVERIFIED_DELIVERY for pulse in pulses)
    assert {pulse.intensity for pulse in pulses} == {0.1}
    assert statuses[-1].device == f'serial {fake.port}'
    assert bench.controller.device.real


@pytest.mark.usefixtures('batch')
@pytest.mark.parametrize('more', [{'realtime_priority': 5}])
def test_the_guard_has_the_priority_of_the_driver(theatre):
    _, bench = theatre
    assert os.sched_getscheduler(bench.controller.device.guard_pid) == os.SCHED_BATCH
