# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Figure of a schedule on a device: intensity, power and coil temperature over time."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from rpms_ros.errors import ReportError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.stimulation.device_specification import DeviceSpecification
from rpms_ros.stimulation.forecast import Forecast
from rpms_ros.stimulation.schedule import Schedule


def window_power(onset_s: FloatArray, energy_j: FloatArray, window_s: float) -> FloatArray:
    """Return the mean power [W] over the window [s] that ends with each pulse, shape (pulses,)."""
    total = np.concatenate([[0.0], np.cumsum(energy_j)])
    first = np.searchsorted(onset_s, onset_s - window_s, side='right')
    power: FloatArray = (total[1:] - total[first]) / window_s
    return power


def save_schedule_figure(
    schedule: Schedule, specification: DeviceSpecification, ahead: Forecast, path: Path
) -> None:
    """Write the figure; the suffix of ``path`` chooses the format.

    Raises
    ------
    ReportError
        If the file cannot be written.
    """
    limits = specification.limits
    time = schedule.plan.onset_ns / NANOSECONDS_PER_SECOND
    figure = Figure(figsize=(8, 6), layout='constrained')
    intensity, power, temperature = figure.subplots(3, 1, sharex=True)
    intensity.plot(time, 100 * schedule.plan.intensity, '.', markersize=3)
    intensity.set_ylabel('intensity [%]')
    energy = limits.pulse_energy_j * schedule.plan.intensity**2
    power.plot(time, window_power(time, energy, limits.energy_window_s))
    power.axhline(limits.continuous_power_w, color='red', linestyle='--')
    power.set_ylabel(f'power over {limits.energy_window_s:g} s [W]')
    if specification.thermal is not None:
        temperature.plot(time, ahead.temperature)
        temperature.axhline(specification.thermal.cutout, color='red', linestyle='--')
    temperature.set_ylabel('coil [Celsius]')
    temperature.set_xlabel('time [s]')
    verdict = 'deliverable' if ahead.deliverable else 'not deliverable'
    figure.suptitle(f'{schedule.name} on {specification.name}: {verdict}')
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise ReportError(f'expected a figure file to write, got {path}: {error}') from error
