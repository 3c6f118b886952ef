# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a force sensor adds to the force: noise, slow drift, stimulation artifact, and its faults.

Each disturbance is reproducible: noise by its seed, drift and artifact by the time stamps alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rpms_ros.errors import MuscleError, check_number, check_seed
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, ForceTrace, IntArray


@dataclass(frozen=True)
class Disturbances:
    """Disturbances between the force of the muscle and the reading of the sensor.

    Attributes
    ----------
    noise : float
        Standard deviation of white noise [N].
    offset : float
        Constant baseline [N].
    drift : float
        Amplitude of a slow sinusoidal baseline [N].
    drift_period : float
        Its period [s].
    artifact : float
        Peak of the stimulation artifact at full intensity [N]; the artifact is proportional to
        the intensity and decays with `artifact_decay`.
    artifact_decay : float
        Time constant of the artifact [s].
    saturation : float
        Largest force that the sensor can show, in either direction [N].

    Raises
    ------
    MuscleError
        If a value is not possible.
    """

    noise: float = 0.0
    offset: float = 0.0
    drift: float = 0.0
    drift_period: float = 120.0
    artifact: float = 0.0
    artifact_decay: float = 0.5e-3
    saturation: float = float('inf')

    def __post_init__(self) -> None:
        check_number(MuscleError, 'noise', self.noise, 0, unit='N')
        for name in ('drift_period', 'artifact_decay', 'saturation'):
            if not getattr(self, name) > 0:
                raise MuscleError(f'expected a {name} above 0, got {getattr(self, name)}')
        for name in ('offset', 'drift', 'artifact'):
            check_number(MuscleError, name, getattr(self, name))


class Sensor:
    """A force sensor with disturbances, fed in blocks of any length.

    Parameters
    ----------
    disturbances : Disturbances
        What it adds to the force.
    seed : int
        Seed of the noise.

    Raises
    ------
    MuscleError
        If the seed is none.
    """

    def __init__(self, disturbances: Disturbances, seed: int = 0) -> None:
        self.disturbances = disturbances
        check_seed(seed, MuscleError)
        self._generator = np.random.default_rng(seed)
        self._origin_ns: int | None = None

    def measure(
        self, stamp_ns: IntArray, force: FloatArray, onset_ns: IntArray, intensity: FloatArray
    ) -> FloatArray:
        """Return what the sensor shows.

        Parameters
        ----------
        stamp_ns : ndarray of int64, shape (samples,)
            Times of the samples, ascending [ns].
        force : ndarray, shape (samples,)
            Force of the muscle [N].
        onset_ns : ndarray of int64, shape (pulses,)
            Onsets of the pulses that may leave an artifact in these samples, ascending [ns].
        intensity : ndarray, shape (pulses,)
            Their shares of the maximum.

        Returns
        -------
        ndarray, shape (samples,)
            Measured force [N].
        """
        settings = self.disturbances
        noise = self._generator.standard_normal(len(stamp_ns))
        measured = force + settings.offset + settings.noise * noise
        if settings.drift and len(stamp_ns):
            if self._origin_ns is None:
                self._origin_ns = int(stamp_ns[0])
            time = (stamp_ns - self._origin_ns) / NANOSECONDS_PER_SECOND
            measured += settings.drift * np.sin(2 * np.pi * time / settings.drift_period)
        if settings.artifact and len(onset_ns):
            # of the latest pulse at each sample
            latest = np.searchsorted(onset_ns, stamp_ns, side='right') - 1
            pulse = np.maximum(latest, 0)
            lag = np.maximum((stamp_ns - onset_ns[pulse]) / NANOSECONDS_PER_SECOND, 0.0)
            peak = settings.artifact * intensity[pulse]
            measured += np.where(latest >= 0, peak * np.exp(-lag / settings.artifact_decay), 0.0)
        return np.clip(measured, -settings.saturation, settings.saturation)


KINDS = ('frozen', 'clipped', 'scaled', 'offset', 'lost', 'doubled')
FROZEN, CLIPPED, SCALED, OFFSET, LOST, DOUBLED = KINDS


@dataclass(frozen=True)
class SensorFault:
    """A fault of a sensor, for a limited time.

    Attributes
    ----------
    fault : str
        ``frozen`` repeats the last value, ``clipped`` cuts at `value` [N], ``scaled`` multiplies
        by `value`, ``offset`` adds `value` [N], ``lost`` leaves samples out, ``doubled`` sends
        each sample twice.
    at : float
        Beginning, from the start of the session [s].
    duration : float
        Length [s].
    value : float
        See `fault`, not 0; not used by the other faults.

    Raises
    ------
    MuscleError
        If the fault is unknown or a number is not possible.
    """

    fault: str
    at: float
    duration: float
    value: float = 0.0

    def __post_init__(self) -> None:
        if self.fault not in KINDS:
            raise MuscleError(f'expected a fault of {", ".join(KINDS)}, got {self.fault!r}')
        check_number(MuscleError, 'at', self.at, 0, unit='s')
        check_number(MuscleError, 'duration', self.duration, 0, above=True, unit='s')
        check_number(MuscleError, 'value', self.value)
        if self.fault in (CLIPPED, SCALED, OFFSET) and self.value == 0.0:
            raise MuscleError(f'expected a value for a {self.fault} sensor, got 0')


class FaultySensor:
    """Applies sensor faults to samples, in blocks of any length.

    Parameters
    ----------
    faults : sequence of SensorFault
        Applied one after another.
    start_ns : int
        Start of the session [ns].
    """

    def __init__(self, faults: Sequence[SensorFault], start_ns: int) -> None:
        self._faults = tuple(faults)
        self._start_ns = start_ns
        # value that each frozen sensor repeats
        self._last: dict[SensorFault, float] = {}

    def __call__(self, stamp_ns: IntArray, force: FloatArray) -> ForceTrace:
        """Return the samples that leave the sensor; stamps ascend [ns], force in [N]."""
        time = (stamp_ns - self._start_ns) / NANOSECONDS_PER_SECOND
        shown = force.copy()
        copies = np.ones(len(stamp_ns), dtype=np.int64)
        for fault in self._faults:
            during = (time >= fault.at) & (time < fault.at + fault.duration)
            if fault.fault == LOST:
                copies[during] = 0
            elif fault.fault == DOUBLED:
                copies[during] *= 2
            elif fault.fault == SCALED:
                shown[during] *= fault.value
            elif fault.fault == OFFSET:
                shown[during] += fault.value
            elif fault.fault == CLIPPED:
                shown[during] = np.clip(shown[during], -abs(fault.value), abs(fault.value))
            elif len(shown):
                first = int(np.argmax(during)) if during.any() else 0
                shown[during] = shown[first - 1] if first else self._last.get(fault, shown[0])
                self._last[fault] = float(shown[-1])
        return ForceTrace(np.repeat(stamp_ns, copies), np.repeat(shown, copies))
