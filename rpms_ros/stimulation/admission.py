# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Checks of a whole schedule before its first pulse."""

import dataclasses

import numpy as np

from rpms_ros.stimulation.books import Books
from rpms_ros.stimulation.devices.interface import Device
from rpms_ros.stimulation.dose import DoseExceeded
from rpms_ros.stimulation.dose_ledger import MemoryLedger
from rpms_ros.stimulation.forecast import Forecast
from rpms_ros.stimulation.interlocks import Refused
from rpms_ros.stimulation.limits import Limits
from rpms_ros.stimulation.schedule import Plan
from rpms_ros.stimulation.schedule import Schedule


def quantized_plan(schedule: Schedule, books: Books, device: Device) -> Plan:
    """Return the pulses of a schedule with intensities that the device can be set to.

    Raises
    ------
    Refused
        If they are more than are left in this session.
    """
    # before the plan is laid out: a schedule can ask for more pulses than there is memory
    left = books.limits.session_pulses - books.session_pulses
    if schedule.pulse_count > left:
        raise Refused(
            'session_pulses',
            f'session_pulses: expected at most {left} more pulses in this session, '
            f'got {schedule.pulse_count}',
        )
    plan = schedule.plan
    return dataclasses.replace(plan, intensity=device.quantized(plan.intensity))


def refuse_over_dose(plan: Plan, limits: Limits, ledger: MemoryLedger) -> None:
    """Raise Refused if a plan is more than the patient may get."""
    energy_j = limits.pulse_energy_j * float(np.sum(plan.intensity**2))
    try:
        ledger.account.check_total(len(plan), energy_j)
    except DoseExceeded as error:
        raise Refused(error.limit, str(error)) from error


def refuse_undeliverable(ahead: Forecast, limits: Limits) -> None:
    """Raise Refused if a plan breaks a limit of the device, with what could be delivered."""
    for violation in ahead.violations:
        raise Refused(
            violation.limit,
            f'{violation.limit}: {violation.reason}; at {violation.time_s:.4g} s of the '
            f'schedule, mean power {ahead.mean_power_w:.4g} W{_advice(ahead, limits)}',
        )


def _advice(ahead: Forecast, limits: Limits) -> str:
    """Return in words which intensity can be kept up for any time at the same rate."""
    if not ahead.max_rate_hz > 0.0:
        return ''
    highest = limits.highest_intensity(ahead.max_rate_hz)
    return f'; at {ahead.max_rate_hz:.4g} Hz intensities up to {highest:.3f} can be delivered'
