# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a driver is started with, and the whole of it on a serial line: node, guard, instrument."""

import time
from contextlib import closing

import pytest
from lifecycle_msgs.msg import Transition

from rpms_msgs.msg import DriverStatus, Pulse
from rpms_msgs.srv import RequestArming
from rpms_ros.errors import NodeError, RpmsError, StimulationError
from rpms_ros.nodes.common import topics
from rpms_ros.nodes.driver.parameters import (
    DriverParameters,
    build_device,
    driver_settings_of,
    ledger_of,
    patience_s,
    session_of,
)
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.stimulation import constant
from rpms_ros.stimulation.devices.rapid2 import SerialDevice
from rpms_ros.stimulation.limits.limiter import BookedPulse

TRAIN = constant(0.1, 20.0, 10.0)


@pytest.fixture
def real(patient_file, specification_file, tmp_path):
    """What a real device needs, as parameters of its driver."""
    return {
        'device': 'serial',
        'device_specification': str(specification_file),
        'patient_file': str(patient_file),
        'ledger_folder': str(tmp_path / 'ledgers'),
        'audit_log': str(tmp_path / 'audit.jsonl'),
    }


@pytest.fixture
def theatre(driver_bench, instrument, real, monkeypatch):
    """An instrument, its driver with everything that a real device needs, and an operator."""
    fake = instrument(watchdog_s=20.0)

    # a machine under load may hold up instrument, guard and driver for longer than the 0.1 s to
    # 0.2 s that they are given
    def build(options):
        return SerialDevice(
            options.port, options.maximum_intensity, timeout_s=5.0, beat_limit_s=20.0
        )

    monkeypatch.setattr('rpms_ros.stimulation.devices.rapid2.build', build)
    bench = driver_bench(
        button=True,
        operator='ada',
        require_stop_button=True,
        configured=True,
        port=fake.port,
        **real,
    )
    return fake, bench


# of a real device
REAL = {
    'device': 'serial',
    'patient_file': '/nowhere.yaml',
    'ledger_folder': '/ledgers',
    'audit_log': 'audit',
}


@pytest.mark.parametrize(
    ('parameters', 'reason'),
    [
        ({'autostart': True}, 'expected schedule_file with autostart, got none'),
        ({'device': 'oracle'}, 'device: expected one of'),
        ({**REAL, 'require_operator': False}, 'expected require_operator with a real device, got'),
        (
            {**REAL, 'require_stop_button': False},
            'expected require_stop_button with a real device',
        ),
        ({**REAL, 'autostart': True}, 'expected no autostart with a real device'),
        ({**REAL, 'audit_log': ''}, 'expected audit_log with a real device, got none'),
        ({**REAL, 'ledger_folder': ''}, 'expected ledger_folder with a real device, got none'),
        ({**REAL, 'ledger_folder': 'b'}, 'expected ledger_folder with an absolute path, got b'),
        ({**REAL, 'patient_file': ''}, 'expected patient_file with a real device, got none'),
        (REAL, 'expected a readable patient file, got /nowhere.yaml'),
        ({'use_sim_time': True}, 'expected use_sim_time false: a driver stamps what it does'),
        ({'audit_log': '/proc/nowhere/a'}, 'expected /proc/nowhere/a to write and lock'),
        ({'device_specification': 'rapid2-240v'}, "a patient file for the real device 'rapid2-2"),
        ({'device_specification': 'oracle'}, 'expected a device of rapid2-240v, simulated'),
        ({'maximum_intensity': 1.5}, 'maximum_intensity: expected 0.0 to 1.0, got 1.5'),
        ({'maximum_rate': 10}, 'maximum_rate: expected double, got integer 10'),
        ({'stop_buttons': ['']}, "expected stop_buttons with a node's full name or its"),
        ({'stop_buttons': ['left/foot']}, "expected stop_buttons with a node's full name or its"),
        ({'stop_buttons': ['left/']}, "expected stop_buttons with a node's full name or its"),
        (
            {'autostart': True, 'schedule_file': '/nowhere.yaml'},
            'expected a readable schedule file, got /nowhere.yaml',
        ),
    ],
)
def test_bad_parameters_are_refused(graph, parameters, reason):
    with pytest.raises(RpmsError, match=reason):
        graph.add(StimulatorDriver, **parameters)


def test_an_impossible_transition_does_not_end_the_node_and_none_is_possible_after_a_shutdown(
    driver_bench,
):
    lab = driver_bench()
    assert not lab.change(Transition.TRANSITION_ACTIVATE)
    assert not lab.change(99)
    lab.wait_for_reason('expected a transition of configure')
    assert lab.change(Transition.TRANSITION_CONFIGURE)
    assert lab.change(Transition.TRANSITION_INACTIVE_SHUTDOWN)
    assert not lab.change(Transition.TRANSITION_CONFIGURE)
    said = 'expected a node that is not shut down, got configure: no transition is possible'
    lab.wait_for_reason(said)
    with pytest.raises(NodeError, match=said):
        lab.driver.change('configure')
    request = lab.other.create_client(RequestArming, topics.REQUEST_ARMING)
    lab.graph.wait_for(request.service_is_ready)
    answer = lab.call(request, RequestArming.Request(operator_id='ada'))
    assert not answer.success
    assert not answer.token
    assert answer.message.startswith('expected a node that is not shut down, got a request to arm')


def test_device_that_is_not_there_is_refused(driver_bench, graph, real):
    both = {'require_operator': True, 'require_stop_button': True}
    lab = driver_bench(port='/dev/ttyUSB99', **both, **real)
    assert not lab.change(Transition.TRANSITION_CONFIGURE)
    graph.wait_for(lambda: 'expected a serial port, got' in lab.reason)
    assert lab.statuses[-1].state == DriverStatus.UNCONFIGURED


@pytest.mark.parametrize(('parameter', 'percent'), [(1.0, 55), (0.305, 30)])
def test_the_guard_holds_the_tightest_bound_of_device_patient_and_parameter(
    parameter, percent, real
):
    settings = DriverParameters(**real, port='/dev/null', maximum_intensity=parameter)
    device = build_device(settings, session_of(settings).specification)
    assert device._line.limits.maximum_percent == percent


def test_the_ledger_of_a_device_is_known_by_its_serial_number_whatever_its_port_is_called(real):
    def opened(port, **others):
        settings = DriverParameters(**{**real, 'port': port, **others})
        return ledger_of(settings, session_of(settings))

    with closing(opened('/dev/ttyUSB0')) as ledger:
        ledger.take(ledger.reserve([BookedPulse(time.monotonic_ns(), 0.1, 2.0)])[0])
    with closing(opened('/dev/serial/by-id/usb-stimulator')) as ledger:
        assert ledger.device == '0815'
        assert len(ledger.history(time.monotonic_ns())) == 1
    with pytest.raises(StimulationError, match=r"serial_number in .*, got none in 'rapid2-240v'"):
        opened('/dev/ttyUSB0', device_specification='rapid2-240v')


def test_only_a_simulated_device_bears_a_busy_computer(real):
    simulated = driver_settings_of(DriverParameters())
    assert (simulated.executor_timeout_s, simulated.supervisor_timeout_s) == (2.0, 2.0)
    assert (simulated.stuck_limit_s, simulated.response_limit_s) == (2.0, 2.0)
    given = DriverParameters(**real)
    settings = driver_settings_of(given)
    assert (settings.executor_timeout_s, settings.supervisor_timeout_s) == (0.5, 0.5)
    assert (settings.stuck_limit_s, settings.response_limit_s) == (0.2, 0.1)
    assert patience_s(given, 0.1) == 0.1


def test_a_patient_whose_figures_have_expired_meanwhile_is_not_stimulated(theatre, patient_file):
    fake, bench = theatre
    lines = patient_file.read_text().splitlines()
    past = {'set_on': '2020-01-01', 'expires': '2020-01-02'}
    dated = [next((f'{k}: {d}' for k, d in past.items() if k in line), line) for line in lines]
    patient_file.write_text('\n'.join(dated))
    reason = bench.refused_arming('patient')
    assert reason.startswith('patient P01: expected a day from 2020-01-01 to 2020-01-02, got')
    assert not fake.armed


@pytest.mark.parametrize(
    ('before', 'after'),
    [
        ('largest_comfortable: 0.55', 'largest_comfortable: 0.45'),
        ('pulses: 4000', 'pulses: 3000'),
        ('identifier: P01', 'identifier: P02'),
        ('set_by: A. Physician', 'set_by: B. Physician'),
    ],
)
def test_figures_of_the_patient_that_were_changed_need_a_new_start(
    theatre, patient_file, before, after
):
    fake, bench = theatre
    text = patient_file.read_text()
    assert before in text
    patient_file.write_text(text.replace(before, after))
    reason = bench.refused_arming('patient')
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
    bench.ada.start(TRAIN)
    graph.wait_for(lambda: len(pulses) > 3)
    bench.button.set(True)
    bench.wait_for_state(DriverStatus.STOPPED)
    graph.wait_for(lambda: not fake.armed)
    given = len(fake.triggers)
    graph.wait_for(lambda: len(pulses) >= given and statuses[-1].dose_pulses >= given)
    # and no more for a while
    end = time.monotonic() + 0.5
    graph.wait_for(lambda: time.monotonic() > end)
    assert len(fake.triggers) == given
    # one that was in the books already when the stop came was not given
    graph.wait_for(lambda: statuses[-1].dose_pulses in (given, given + 1))
    # the guard may have refused that one for the silence: told, as it may have been given
    assert given <= len(pulses) <= statuses[-1].dose_pulses
    # the published protocol has no word on whether a pulse came
    assert all(pulse.unverified & Pulse.UNVERIFIED_DELIVERY for pulse in pulses)
    assert {pulse.intensity for pulse in pulses} == {0.1}
    assert statuses[-1].device == f'serial {fake.port}'
    assert bench.controller.device.real
