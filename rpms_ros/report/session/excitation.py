"""Schedule and energy of a session, read off the pulses that were delivered."""

from dataclasses import dataclass

import numpy as np

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import PulseTrain
from rpms_ros.report.schedule_figure import window_power
from rpms_ros.stimulation.device_specification import DeviceSpecification
from rpms_ros.stimulation.thermal import CoilTemperature

TRAIN_GAP = 1.0
"""A pause longer than this [s] ends a train."""


@dataclass(frozen=True)
class Excitation:
    """What was done to the muscle.

    Attributes
    ----------
    pulses : int
        Pulses of valid intensity.
    onset_s : ndarray (pulses,)
        Onsets after the start of the session, ascending [s].
    intensity : ndarray (pulses,)
        Shares of the maximum.
    widths : tuple of float
        Widths that occur [s].
    trains : int
        Runs of pulses without a pause longer than `TRAIN_GAP`.
    stimulated_s : float
        Time within trains [s].
    rates_hz : tuple of float
        Lowest, median and highest rate within trains [Hz]; empty without two pulses in a train.
    full_intensity_pulses : float
        Sum of squared intensities: the energy in units of a pulse at full intensity.
    """

    pulses: int
    onset_s: FloatArray
    intensity: FloatArray
    widths: tuple[float, ...]
    trains: int
    stimulated_s: float
    rates_hz: tuple[float, ...]
    full_intensity_pulses: float


@dataclass(frozen=True)
class DeviceLoad:
    """What the pulses come to on a device, by the figures of its specification.

    Attributes
    ----------
    device : str
        Name of the device specification.
    energy_j : float
        Energy of all pulses [J].
    highest_power_w : float
        Largest mean power over the device specification's window [W].
    window_s : float
        That window [s].
    highest_temperature : float or None
        Of the coil, from a model that starts at room temperature [Celsius]; None without
        thermal figures.
    """

    device: str
    energy_j: float
    highest_power_w: float
    window_s: float
    highest_temperature: float | None


def excitation_of_pulses(pulses: PulseTrain, start_ns: int) -> Excitation:
    """Return schedule and energy of the pulses of a session.

    Parameters
    ----------
    pulses : PulseTrain
        As recorded; those whose intensity is not within 0..1 are left out.
    start_ns : int
        Start of the session [ns].
    """
    valid = (pulses.intensity >= 0.0) & (pulses.intensity <= 1.0)
    order = np.argsort(pulses.onset_ns[valid], kind='stable')
    onset = pulses.onset_ns[valid][order]
    intensity = pulses.intensity[valid][order]
    steps = np.diff(onset) / NANOSECONDS_PER_SECOND
    within = (steps <= TRAIN_GAP) & (steps > 0)
    rates = 1.0 / steps[within]
    return Excitation(
        pulses=len(onset),
        onset_s=(onset - start_ns) / NANOSECONDS_PER_SECOND,
        intensity=intensity,
        widths=tuple(np.unique(pulses.width[valid]).tolist()),
        trains=int(np.count_nonzero(steps > TRAIN_GAP)) + bool(len(onset)),
        stimulated_s=float(steps[within].sum()),
        rates_hz=(float(rates.min()), float(np.median(rates)), float(rates.max()))
        if len(rates)
        else (),
        full_intensity_pulses=float(np.sum(intensity**2)),
    )


def load_of(excitation: Excitation, specification: DeviceSpecification) -> DeviceLoad:
    """Return what the pulses come to on a device, E = E_max u^2 a pulse."""
    limits = specification.limits
    energy = limits.pulse_energy_j * excitation.intensity**2
    onset = excitation.onset_s
    power = window_power(onset, energy, limits.energy_window_s)
    return DeviceLoad(
        specification.name,
        float(energy.sum()),
        float(power.max()) if len(power) else 0.0,
        limits.energy_window_s,
        _highest_temperature(onset, energy, specification),
    )


def _highest_temperature(
    onset: FloatArray, energy: FloatArray, specification: DeviceSpecification
) -> float | None:
    if specification.thermal is None:
        return None
    coil = CoilTemperature(specification.thermal)
    celsius = [
        coil.heat(round(time * NANOSECONDS_PER_SECOND), heat)
        for time, heat in zip((onset - onset[:1]).tolist(), energy.tolist(), strict=True)
    ]
    return max(celsius, default=specification.thermal.ambient)
