# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Voluntary and other forces beside a simulated muscle, and the sensor with its faults."""

from rpms_ros.muscle.disturbance import Sensor
from rpms_ros.muscle.effort import total_effort
from rpms_ros.muscle.scenario import Scenario
from rpms_ros.muscle.sensor_faults import FaultySensor
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain


class Surroundings:
    """Turns the force of a muscle into the samples of the sensor, in blocks of any length.

    Parameters
    ----------
    scenario : Scenario
        Efforts, disturbances and sensor faults.
    seed : int
        Seed of the noise.
    """

    def __init__(self, scenario: Scenario, seed: int = 0) -> None:
        self.scenario = scenario
        self._seed = seed
        self.begin(0)

    def begin(self, start_ns: int) -> None:
        """Begin the session at `start_ns` [ns]: the times of events count from there."""
        self._start_ns = start_ns
        self._sensor = Sensor(self.scenario.disturbances, self._seed)
        self._faulty = FaultySensor(self.scenario.sensor_faults, start_ns)

    def effort(self, stamp_ns: IntArray) -> FloatArray:
        """Return the force that the stimulation does not cause [N] (samples,)."""
        time = (stamp_ns - self._start_ns) / NANOSECONDS_PER_SECOND
        return total_effort(self.scenario.efforts, time)

    def measured(self, stamp_ns: IntArray, force: FloatArray, recent: PulseTrain) -> ForceTrace:
        """Return the samples of the sensor.

        Parameters
        ----------
        stamp_ns : ndarray of int64, shape (samples,)
            Ascending [ns].
        force : ndarray, shape (samples,)
            Force of the stimulated muscle [N].
        recent : PulseTrain
            Pulses that may leave an artifact in these samples, ascending.
        """
        shown = self._sensor.measure(
            stamp_ns, force + self.effort(stamp_ns), recent.onset_ns, recent.intensity
        )
        return self._faulty(stamp_ns, shown)
