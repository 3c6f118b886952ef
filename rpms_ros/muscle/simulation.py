# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulation of a muscle with its surroundings: samples of the sensor, and the true state.

A whole session at once (`simulate_session`), or pulses in and force samples on an exact grid out
(`SampledPlant`).
"""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from rpms_ros.muscle.contraction import Contraction, MuscleState
from rpms_ros.muscle.scenario import Scenario
from rpms_ros.muscle.sensor import Disturbances, FaultySensor, Sensor
from rpms_ros.muscle.subject import REFERENCE_RATE, Subject
from rpms_ros.pulses import (
    NANOSECONDS_PER_SECOND,
    FloatArray,
    ForceTrace,
    IntArray,
    Pulse,
    PulseTrain,
    nanoseconds,
)


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
        return sum((one.force(time) for one in self.scenario.efforts), np.zeros(len(time)))

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
        force = force + self.effort(stamp_ns)
        shown = self._sensor.measure(stamp_ns, force, recent.onset_ns, recent.intensity)
        return self._faulty(stamp_ns, shown)


@dataclass(frozen=True)
class Truth:
    """The muscle and its surroundings at one time.

    Attributes
    ----------
    stamp_ns : int
        When [ns].
    state : MuscleState
        Gain, dynamics, thresholds.
    repetition_rate : float
        Repetition rate for which the curve is stated [Hz].
    curve_intensity, curve_force : ndarray, shape (points,)
        Recruitment curve: steady mean force [N] over intensity (share).
    effort : float
        Force that the stimulation does not cause [N].
    """

    stamp_ns: int
    state: MuscleState
    repetition_rate: float
    curve_intensity: FloatArray
    curve_force: FloatArray
    effort: float


def truth_at(muscle: Contraction, surroundings: Surroundings, stamp_ns: int) -> Truth:
    """Return the true state at a time [ns] up to which the force has been computed."""
    intensity = np.linspace(0.0, 1.0, 41)
    return Truth(
        stamp_ns=stamp_ns,
        state=muscle.state(stamp_ns),
        repetition_rate=REFERENCE_RATE,
        curve_intensity=intensity,
        curve_force=muscle.steady_force(stamp_ns, intensity, REFERENCE_RATE),
        effort=float(surroundings.effort(np.array([stamp_ns]))[0]),
    )


# Samples: enough that the overhead of a block is small, few enough for a smooth progress bar.
_BLOCK = 20_000


def simulate_session(
    muscle: Contraction,
    surroundings: Surroundings,
    pulses: PulseTrain,
    stamp_ns: IntArray,
    truth_rate: float = 0.0,
    advance: Callable[[int], None] = lambda _: None,
) -> tuple[ForceTrace, list[Truth]]:
    """Return the samples of the force sensor in a session, and the true states meanwhile.

    Parameters
    ----------
    muscle : Contraction
        The muscle, before any pulse.
    surroundings : Surroundings
        Efforts and sensor.
    pulses : PulseTrain
        Ascending in onset.
    stamp_ns : ndarray of int64, shape (samples,)
        Ascending times of the samples [ns]; the session starts at the first.
    truth_rate : float
        How often the true state is recorded [Hz]; 0 for never.
    advance : callable
        Called with the number of samples simulated since the last call.
    """
    if len(stamp_ns):
        muscle.begin(int(stamp_ns[0]))
        surroundings.begin(int(stamp_ns[0]))
    traces, done = [ForceTrace(stamp_ns[:0], np.empty(0))], 0
    truths: list[Truth] = []
    for part in _blocks(stamp_ns, truth_rate):
        due = int(np.searchsorted(pulses.onset_ns, part[-1], side='right'))
        muscle.add_pulses(pulses.onset_ns[done:due], pulses.intensity[done:due])
        # the artifact of the last pulse before this block may extend into it
        recent = pulses[max(0, done - 1) : due]
        traces.append(surroundings.measured(part, muscle.force(part), recent))
        if truth_rate > 0.0:
            truths.append(truth_at(muscle, surroundings, int(part[-1])))
        done = due
        advance(len(part))
    stamps = np.concatenate([trace.stamp_ns for trace in traces])
    return ForceTrace(stamps, np.concatenate([trace.force for trace in traces])), truths


def _blocks(stamp_ns: IntArray, truth_rate: float) -> list[IntArray]:
    """Return the stamps in blocks, each of which ends where the truth is noted."""
    if truth_rate <= 0.0 or not len(stamp_ns):
        edges = np.arange(0, len(stamp_ns), _BLOCK)
    else:
        number = np.floor((stamp_ns - stamp_ns[0]) / (NANOSECONDS_PER_SECOND / truth_rate))
        edges = np.flatnonzero(np.diff(number, prepend=-1.0))
    return [part for part in np.split(stamp_ns, edges[1:]) if len(part)]


def simulated_force(
    subject: Subject,
    pulses: PulseTrain,
    duration: float,
    noise: float = 0.01,
    artifact: float = 1.0,
    drift: float = 0.0,
    sample_rate_hz: float = 1000.0,
    seed: int = 0,
) -> ForceTrace:
    """Return the samples of a force sensor on a steady muscle from time 0 on.

    Parameters
    ----------
    subject : Subject
        The muscle.
    pulses : PulseTrain
        Ascending in onset.
    duration : float
        Length [s].
    noise, artifact, drift : float
        As in `Disturbances`, relative to the peak of a twitch at full intensity.
    sample_rate_hz : float
        Rate of the samples [Hz].
    seed : int
        Of the noise.
    """
    # at this rate twitches do not overlap
    peak = float(subject.pulse_weight(1.0, 0.1))
    added = Disturbances(noise=noise * peak, artifact=artifact * peak, drift=drift * peak)
    count = np.arange(round(duration * sample_rate_hz))
    stamps = np.rint(count * (NANOSECONDS_PER_SECOND / sample_rate_hz)).astype(np.int64)
    surroundings = Surroundings(Scenario(disturbances=added), seed)
    return simulate_session(Contraction(subject), surroundings, pulses, stamps)[0]


# After this time an artifact with a time constant of 5 ms has decayed to exp(-40).
_ARTIFACT_MEMORY_NS = NANOSECONDS_PER_SECOND // 5


class SampledPlant:
    """A muscle with a force sensor that is sampled at stamps ``start + k / rate``.

    Parameters
    ----------
    muscle : Contraction
        The muscle, before any pulse.
    surroundings : Surroundings
        Efforts and sensor.
    rate : float
        Force samples a second [Hz].
    """

    def __init__(self, muscle: Contraction, surroundings: Surroundings, rate: float) -> None:
        self._muscle = muscle
        self._surroundings = surroundings
        # A fraction keeps the sampling grid exact, however long the session is.
        self._period_ns = NANOSECONDS_PER_SECOND / Fraction(rate)
        self._first_ns = self._produced = 0
        self._recent: list[Pulse] = []
        self.faults: Counter[str] = Counter()

    def begin(self, start_ns: int) -> None:
        """Begin the grid at the first multiple of the sampling period from `start_ns` on."""
        self._first_ns = round(math.ceil(start_ns / self._period_ns) * self._period_ns)
        self._produced = 0
        self._muscle.begin(self._first_ns)
        self._surroundings.begin(self._first_ns)

    @property
    def newest_ns(self) -> int:
        """Stamp of the newest sample, or one period before the first [ns]."""
        return self._stamp(self._produced - 1)

    def add(self, pulse: Pulse) -> str | None:
        """Add a pulse; return the name of its fault, if it has one.

        An invalid pulse has no effect.  A late one, whose twitch should have begun before samples
        that were already produced, acts exactly on the samples still to come.
        """
        fault = None
        if not 0.0 <= pulse.intensity <= 1.0:
            fault = 'pulse_intensity_out_of_range'
        elif not 0.0 <= pulse.width < math.inf:
            fault = 'pulse_width_out_of_range'
        else:
            self._muscle.add_pulses(pulse.onset_ns, pulse.intensity)
            self._recent.append(pulse)
            latency_ns = nanoseconds(self._muscle.state(pulse.onset_ns).latency)
            if self._produced and pulse.onset_ns + latency_ns < self.newest_ns:
                fault = 'pulse_late'
        if fault is not None:
            self.faults[fault] += 1
        return fault

    def due(self, now_ns: int) -> int:
        """Return how many samples up to `now_ns` [ns] have not been produced yet."""
        return max(0, (now_ns - self._first_ns) // self._period_ns + 1 - self._produced)

    def sample(self, count: int) -> ForceTrace:
        """Return the next `count` samples; a sensor fault may leave some out or double them."""
        indices = range(self._produced, self._produced + count)
        stamps = np.array([self._stamp(index) for index in indices], dtype=np.int64)
        self._produced += count
        if count:
            # those that may leave an artifact in these samples
            limit = int(stamps[0]) - _ARTIFACT_MEMORY_NS
            self._recent = sorted(pulse for pulse in self._recent if pulse.onset_ns >= limit)
        force = self._muscle.force(stamps)
        return self._surroundings.measured(stamps, force, PulseTrain.of(self._recent))

    def truth(self) -> Truth:
        """Return the true state at the newest sample."""
        return truth_at(self._muscle, self._surroundings, self.newest_ns)

    def _stamp(self, index: int) -> int:
        return self._first_ns + round(index * self._period_ns)
