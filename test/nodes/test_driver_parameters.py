# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is built from the parameters of the driver."""

import time

import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.nodes.driver.parameters import (
    DriverParameters,
    build_device,
    driver_settings_of,
    ledger_of,
    patience_s,
    session_of,
)
from rpms_ros.stimulation.limits.limits import BookedPulse


@pytest.mark.parametrize(('parameter', 'percent'), [(1.0, 55), (0.305, 30)])
def test_the_guard_holds_the_tightest_bound_of_device_patient_and_parameter(
    parameter, percent, patient_file, tmp_path
):
    settings = DriverParameters(
        device='serial',
        port='/dev/null',
        device_specification='rapid2-240v',
        maximum_intensity=parameter,
        patient_file=str(patient_file),
        ledger_folder=str(tmp_path),
        audit_log=str(tmp_path / 'audit.jsonl'),
    )
    device = build_device(settings, session_of(settings).specification)
    assert device._line.limits.maximum_percent == percent


def test_the_ledger_of_a_device_is_known_by_its_serial_number_whatever_its_port_is_called(
    patient_file, specification_file, tmp_path
):
    def opened(port, specification=str(specification_file)):
        settings = DriverParameters(
            device='serial',
            port=port,
            device_specification=specification,
            patient_file=str(patient_file),
            ledger_folder=str(tmp_path / 'ledgers'),
            audit_log=str(tmp_path / 'audit.jsonl'),
        )
        return ledger_of(settings, session_of(settings))

    with opened('/dev/ttyUSB0') as ledger:
        ledger.take(ledger.reserve([BookedPulse(time.monotonic_ns(), 0.1, 2.0)])[0])
    with opened('/dev/serial/by-id/usb-stimulator') as ledger:
        assert ledger.device == '0815'
        assert len(ledger.history(time.monotonic_ns())) == 1
    with pytest.raises(StimulationError, match=r"serial_number in .*, got none in 'rapid2-240v'"):
        opened('/dev/ttyUSB0', 'rapid2-240v')


def test_only_a_simulated_device_bears_a_busy_computer(patient_file, tmp_path):
    simulated = driver_settings_of(DriverParameters())
    assert (simulated.executor_timeout_s, simulated.supervisor_timeout_s) == (2.0, 2.0)
    assert (simulated.stuck_limit_s, simulated.response_limit_s) == (2.0, 2.0)
    real = DriverParameters(
        device='serial',
        patient_file=str(patient_file),
        ledger_folder=str(tmp_path),
        audit_log=str(tmp_path / 'audit.jsonl'),
    )
    settings = driver_settings_of(real)
    assert (settings.executor_timeout_s, settings.supervisor_timeout_s) == (0.5, 0.5)
    assert (settings.stuck_limit_s, settings.response_limit_s) == (0.2, 0.1)
    assert patience_s(real, 0.1) == 0.1
