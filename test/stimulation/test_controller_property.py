# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Random schedules, faults and interleavings: no pulse ever breaks a limit or follows a stop.

The threads' code runs step by step in virtual time.  Whenever it looks at the clock or waits for
the device, another thread may have its turn: the supervisor, the ledger's, somebody who stops,
cancels, disarms, cleans up; or the machine stands still.  What was fired is held against the
limits by a reckoning of its own, pulse against pulse, that shares nothing with the limiter.

RPMS_RANDOM_SCHEDULES sets how many examples there are (bench/random_schedules.py).
"""

import math
import os
from bisect import bisect_left
from itertools import accumulate, pairwise

import numpy as np
import pytest
from faulty_device import SimulatedFaults

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import Constant, Doublet, Pause, Ramp, Schedule, UniformRandom
from rpms_ros.stimulation.devices.registry import DeviceError
from rpms_ros.stimulation.driver.safety_monitor import EXECUTOR, HEARTBEAT, Refused
from rpms_ros.stimulation.driver.states import POSSIBLE, State
from rpms_ros.stimulation.limits.limiter import DoseLimits, Limits, Rest
from rpms_ros.stimulation.records.dose_ledger import MemoryLedger

SECOND = 1_000_000_000
PER_BATCH = 100
COUNT = int(os.environ.get('RPMS_RANDOM_SCHEDULES', '300'))
HEARTBEAT_NS = 300_000_000
RESPONSE_NS = 100_000_000
KNOWN = {
    'maximum_intensity', 'maximum_intensity_step', 'maximum_intensity_rise', 'minimum_width_s',
    'maximum_width_s', 'maximum_rate_hz', 'rate_limits_hz', 'maximum_train_pulses', 'wait',
    'continuous_power_w', 'session_pulses', 'session_energy_j', 'idle_disarm_s', 'rest', 'stop',
    'executor', 'supervisor', 'heartbeat', 'force_limit', 'state', 'temperature', 'emergency_stop',
    'device', 'test', 'dose_pulses', 'dose_energy_j', 'maximum_intensity: e',
}  # fmt: skip


def random_limits(random):
    """Limits of which about every second schedule breaks some."""
    edges = np.sort(random.uniform(0.1, 0.9, 2)).round(2)
    # each once
    edges[1] += 0.01
    rates = np.sort(random.uniform(20.0, 80.0, 3))[::-1]
    return Limits(
        maximum_intensity=float(random.uniform(0.7, 1.0)),
        maximum_intensity_step=float(random.uniform(0.6, 1.0)),
        maximum_intensity_rise=0.8 + 0.2 * float(edges[0]),
        rise_window_s=0.2 + 5.0 * float(edges[1]),
        maximum_rate_hz=float(random.uniform(20.0, 80.0)),
        rate_intensities=(*edges.tolist(), 1.0),
        rate_limits_hz=tuple(rates.tolist()),
        maximum_train_pulses=int(random.integers(8, 80)),
        minimum_pause_s=float(random.uniform(0.1, 0.3)),
        pulse_energy_j=float(random.uniform(0.0, 200.0)),
        continuous_power_w=float(np.exp(random.uniform(4.0, 9.5))),
        energy_window_s=float(random.uniform(0.2, 2.0)),
        session_pulses=int(random.integers(20, 300)),
        session_energy_j=float(np.exp(random.uniform(6.0, 10.0))),
        interval_tolerance_s=float(random.uniform(0.0, 3e-3)),
        idle_disarm_s=float(random.uniform(0.3, 5.0)),
        rest=Rest(int(random.integers(8, 120)), float(random.uniform(0.3, 1.5))),
    )


def random_schedule(random):
    def segment():
        rate, length = float(random.uniform(2.0, 40.0)), float(random.uniform(0.05, 1.2))
        low, high = np.sort(random.uniform(0.0, 0.8, 2)).tolist()
        return (
            lambda: Constant(rate, length, intensity=high),
            lambda: UniformRandom(rate, length, low=low, high=high),
            lambda: Ramp(rate, length, start=low, end=high),
            lambda: Doublet(high, interval_s=1.0 / rate, duration_s=1.0 / rate + length),
            lambda: Pause(length),
        )[random.integers(5)]()

    segments = tuple(segment() for _ in range(random.integers(1, 4)))
    width = 100e-6 if random.random() < 0.95 else 5e-3
    return Schedule(segments, seed=int(random.integers(1000)), width_s=width)


FAULTS = (
    SimulatedFaults(silent_loss=0.5),
    SimulatedFaults(extra_intensity=0.1),
    SimulatedFaults(foreign_intensity=0.95),
    SimulatedFaults(slow_s=0.03),
    SimulatedFaults(slow_s=0.15),
    SimulatedFaults(stuck_s=0.3),
    SimulatedFaults(heating_per_pulse=5.0),
    SimulatedFaults(vanish_after=3),
    SimulatedFaults(coil_absent=True),
    SimulatedFaults(error=True),
    SimulatedFaults(not_ready=True),
    SimulatedFaults(disarms=True),
)


class Others:
    """What other threads and people do, at any moment at which the owner does not hold the lock.

    Attributes
    ----------
    halts : int
        How often somebody has made pulses impossible so far.
    alive_ns : int
        When executor and heart were alive last, as they see it.
    """

    def __init__(self, driver, random, rate):
        self.driver, self.random, self.rate = driver, random, rate
        self.halts = 0
        self.alive_ns = driver.clock.now
        self._busy = False
        self._turn_ns = 0
        driver.clock.between = driver.look = self
        driver.clock.meanwhile = [self]

    def __call__(self):
        controller = self.driver.controller
        if self._busy or controller._lock._is_owned():
            return
        self._busy = True
        now = self.driver.clock.now
        if now >= self._turn_ns:
            # their next turn comes soon, or late on a busy machine
            self._turn_ns = now + (100_000_000 if self.random.random() < 0.1 else 10_000_000)
            controller.supervise()
            controller.reserve()
            if self.driver.alive:
                self.alive_ns = now
                controller.seen(EXECUTOR)
                controller.seen(HEARTBEAT)
        if self.random.random() < self.rate:
            self.disturb()
        self._busy = False

    def disturb(self):
        """Do one thing that people, devices and machines do at the wrong moment."""
        driver, random, controller = self.driver, self.random, self.driver.controller
        halting = (
            controller.cancel,
            controller.disarm,
            controller.cleanup,
            driver.press_stop,
            lambda: controller.stop('test', 'a test'),
            lambda: controller.measured('force_limit', 200.0, 100.0, 'N'),
            lambda: controller.temperature(60.0),
            lambda: controller.fail('test', 'a test'),
        )
        if random.random() < 0.4:
            kind = random.integers(len(halting))
            # there is nothing to cancel while nothing runs
            if kind > 0 or controller.state is State.RUNNING:
                halting[kind]()
                self.halts += 1
                assert controller.state not in POSSIBLE
                assert driver.due_ns() is None
            return
        (
            lambda: driver.clock.stall(random.integers(1, 800) * 1e-3),
            lambda: setattr(driver.device, 'faults', FAULTS[random.integers(len(FAULTS))]),
            lambda: setattr(driver, 'alive', not driver.alive),
            driver.release_stop,
            lambda: attempt(lambda: controller.tighten(float(random.uniform(0.2, 1.0))), []),
            lambda: controller.measured('force_limit', 10.0, 100.0, 'N'),
        )[random.integers(6)]()


class Witness:
    """Sees every pulse that the device gives, and holds it against what was allowed then."""

    def __init__(self, driver, others):
        self.driver, self.others = driver, others
        self.given = []
        self.asked_ns = {}
        # so many halts there were when the run began that is allowed to fire
        self.allowed = None
        fire = type(driver.device).fire

        def watched(*arguments):
            began = driver.clock.now
            given = fire(driver.device, *arguments)
            if given is not None:
                self.see(given, began)
            return given

        driver.device.instead['fire'] = watched

    def see(self, given, began):
        """Note a pulse; the heart beat within its time when the device was asked for it."""
        assert self.others.halts == self.allowed
        assert began - self.others.alive_ns <= HEARTBEAT_NS
        self.given.append(given)
        self.asked_ns[given.time_ns] = began

    def end(self, limits, dose, ledger):
        """Hold everything together against limits, dose and what was told."""
        driver = self.driver
        assert [pulse.delivery for pulse in self.answered] == self.given
        for pulse in self.answered:
            # a slow device takes its time after it was asked
            assert self.asked_ns[pulse.delivery.time_ns] - pulse.due_ns <= 10_000_000
        assert self.broken(limits) == set()
        joules = energy(self.commands, limits)
        assert len(self.given) <= dose.pulses
        assert joules <= dose.energy_j * (1 + 1e-6)
        assert ledger.totals().pulses >= len(self.given)
        everything = broken(self.commands, limits) & {'session', 'maximum_intensity'}
        assert everything == set()
        if driver.controller.state is not State.RUNNING:
            driver.controller.step()
            assert driver.device.intensity == 0.0
            assert driver.device.armed <= (driver.controller.state is State.ARMED)

    @property
    def answered(self):
        """The pulses that the device says it gave; of one without an answer nothing is sure."""
        given = [pulse for pulse in self.driver.fired if pulse.delivery is not None]
        return [pulse for pulse in given if not pulse.delivery.unverified]

    @property
    def commands(self):
        """Time and what was asked for of each pulse; a device may do something else."""
        return [(pulse.delivery.time_ns, pulse.intensity) for pulse in self.answered]

    def broken(self, limits):
        """Return the limits that are broken; a pulse that the device held up counts anew."""
        wrong, piece = set(), []
        for time, intensity in self.commands:
            asked_ns = self.asked_ns[time]
            if time - asked_ns > RESPONSE_NS:
                wrong |= broken([*piece, (asked_ns, intensity)], limits)
                piece = []
            piece.append((time, intensity))
        return wrong | broken(piece, limits)


def live(driver, others, witness, random):
    """Run schedules with disturbances; return what was refused, by name of the limit."""
    refused = []
    controller = driver.controller
    for _ in range(random.integers(1, 4)):
        if random.random() < 0.9:
            # the causes of the last stop have gone
            driver.release_stop()
            controller.temperature(25.0)
            controller.measured('force_limit', 10.0, 100.0, 'N')
        for command in (controller.reset, controller.configure, controller.arm):
            attempt(command, refused)
        schedule = random_schedule(random)
        before = others.halts
        witness.allowed = None
        if attempt(lambda chosen=schedule: controller.start(chosen), refused):
            assert controller.state is not State.RUNNING or before == others.halts
            witness.allowed = before
        for _ in range(random.integers(1, 5)):
            late = int(random.choice([0, 0, 1_000_000, 4_000_000, 9_000_000]))
            driver.advance(float(random.uniform(0.05, 0.5)), late_ns=late)
            if random.random() < 0.3:
                others.disturb()
        driver.device.faults, driver.alive = SimulatedFaults(), True
        if controller.state is State.FAULT:
            controller.cleanup()
    return refused


def attempt(command, refused):
    """Return whether a command was obeyed; note by which name it was refused."""
    try:
        command()
    except Refused as error:
        refused.append(error.limit)
    except DeviceError:
        refused.append('device')
    except StimulationError as error:
        # not legal in this state: the state is named instead of a limit
        refused.append('state' if 'expected state' in str(error) else str(error)[:20])
    else:
        return True
    return False


def broken(commands, limits):
    """Return the names of the limits that the commands (time, intensity) break."""
    trains = split(commands, round(limits.minimum_pause_s * SECOND))
    between_rests = split(commands, round(limits.rest.pause_s * SECOND))
    energies = [0.0, *accumulate(energy([command], limits) for command in commands)]
    window = round(limits.energy_window_s * SECOND)
    rise = round(limits.rise_window_s * SECOND)
    times = [time for time, _ in commands]
    wrong = {
        'maximum_intensity': any(not 0 <= u <= limits.maximum_intensity for _, u in commands),
        'maximum_train_pulses': any(len(t) > limits.maximum_train_pulses for t in trains),
        'rest': any(len(t) > limits.rest.train_pulses for t in between_rests),
        'maximum_intensity_step': any(
            # the difference of two shares is rounded
            abs(after - before) > limits.maximum_intensity_step + 1e-12
            for train in trains
            for (_, before), (_, after) in pairwise([(0, 0.0), *train])
        ),
        'maximum_intensity_rise': any(
            u - max((v for time, v in commands[:index] if time >= now - rise), default=0.0)
            > limits.maximum_intensity_rise + 1e-12
            for index, (now, u) in enumerate(commands)
        ),
        'continuous_power_w': any(
            energies[index + 1] - energies[bisect_left(times, time - window + 1)]
            # sums of joules, relative rounding
            > limits.continuous_power_w * limits.energy_window_s * (1 + 1e-6)
            for index, time in enumerate(times)
        ),
        'session': len(commands) > limits.session_pulses
        or energies[-1] > limits.session_energy_j * (1 + 1e-6),
        'rate': any(too_fast(train, limits) for train in trains),
        'wait': any(too_soon(*two, limits) for two in pairwise(trains)),
    }
    return {name for name, is_wrong in wrong.items() if is_wrong}


def split(commands, pause):
    """Return the trains: a gap of `pause` [ns] ends one."""
    trains = []
    for command in commands:
        if not trains or command[0] - trains[-1][-1][0] >= pause:
            trains.append([])
        trains[-1].append(command)
    return trains


def energy(commands, limits):
    return math.fsum(limits.pulse_energy_j * intensity**2 for _, intensity in commands)


def too_fast(train, limits):
    """Hold any run of a train against the sum of the intervals that its pulses ask for."""
    early = 0.0
    for (before, weak), (after, strong) in pairwise(train):
        strongest = max(weak, strong)
        rates = zip(limits.rate_intensities, limits.rate_limits_hz, strict=True)
        allowed = next(rate for edge, rate in rates if strongest <= edge)
        needed = SECOND / min(allowed, limits.maximum_rate_hz)
        # added up since the last pulse that was not early; onsets are whole nanoseconds
        early = max(0.0, early + needed - (after - before))
        if early > limits.interval_tolerance_s * SECOND + 2 + len(train):
            return True
    return False


def too_soon(train, following, limits):
    """Hold the silence after a train against max(t_min, E/P - n/f)."""
    count = len(train)
    span = (train[-1][0] - train[0][0]) / SECOND
    lasted = span * count / (count - 1) if count > 1 else 0.0
    wait = energy(train, limits) / limits.continuous_power_w - lasted
    gap = (following[0][0] - train[-1][0]) / SECOND
    return gap < max(limits.minimum_pause_s, wait) - 1e-6


def example(virtual, number):
    """Live through one example; return its pulses and what was refused."""
    random = np.random.default_rng([7, number])
    limits = random_limits(random)
    dose = DoseLimits(int(random.integers(3, 150)), float(np.exp(random.uniform(7, 11))), 1.0)
    # the ledger's clock is not looked at by the owner
    moment = []
    ledger = MemoryLedger(dose, lambda: moment[0].now if moment else SECOND)
    steps = int(random.choice([0, 100]))
    driver = virtual(limits, ledger=ledger, steps=steps, heartbeat_s=0.3)
    moment.append(driver.clock)
    others = Others(driver, random, float(random.choice([0.0, 0.001, 0.02])))
    witness = Witness(driver, others)
    refused = live(driver, others, witness, random)
    witness.end(limits, dose, ledger)
    assert all(
        steps == 0 or value == round(value * steps) / steps for _, value in witness.commands
    )
    return len(witness.given), set(refused)


@pytest.mark.parametrize('batch', range(max(1, COUNT // PER_BATCH)))
def test_no_pulse_ever_breaks_a_limit_and_every_refusal_names_one(virtual, batch):
    fired, refused = 0, set()
    for number in range(batch * PER_BATCH, (batch + 1) * PER_BATCH):
        try:
            pulses, names = example(virtual, number)
        except Exception as error:
            raise AssertionError(f'example {number}: {error!r}') from error
        fired += pulses
        refused |= names
    assert refused <= KNOWN
    # the examples are worth something: pulses, and refusals of some kinds
    assert fired > PER_BATCH // 2
    assert len(refused) > 4


def test_the_reckoning_finds_what_is_wrong():
    limits = Limits(
        maximum_intensity=0.8,
        maximum_intensity_step=0.6,
        maximum_rate_hz=20.0,
        maximum_train_pulses=3,
        pulse_energy_j=100.0,
        continuous_power_w=20.0,
        energy_window_s=1.0,
        session_pulses=5,
        rest=Rest(4, 1.0),
    )

    def names(*pulses):
        return broken([(round(time * SECOND), value) for time, value in pulses], limits)

    assert names((0.0, 0.1), (0.05, 0.1), (0.1, 0.1)) == set()
    assert names((0.0, 0.1), (0.04, 0.1)) == {'rate'}
    assert names((0.0, 0.1), (0.05, 0.9)) >= {'maximum_intensity', 'maximum_intensity_step'}
    assert names(*((index / 20, 0.1) for index in range(4))) == {'maximum_train_pulses'}
    assert names(*((index / 1.9, 0.1) for index in range(5))) == {'rest'}
    assert names(*((index / 0.9, 0.1) for index in range(6))) == {'session'}
    assert names((0.0, 0.5)) == {'continuous_power_w'}
    assert names((0.0, 0.4), (0.55, 0.1)) == {'wait'}
