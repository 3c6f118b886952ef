# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is built from the parameters of the driver."""

import pytest

from rpms_ros.nodes.driver_parameters import DriverParameters
from rpms_ros.nodes.driver_parameters import build_device
from rpms_ros.nodes.driver_parameters import device_specification_of


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
    device = build_device(settings, device_specification_of(settings))
    assert device._line.limits.maximum_percent == percent
