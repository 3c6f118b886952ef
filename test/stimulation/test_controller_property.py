"""Ten thousand random schedules, faults and stops: no pulse ever breaks a limit.

What was fired is held against the limits by a reckoning of its own, pulse against pulse, that
shares nothing with the limiter.
"""

import math
from bisect import bisect_left
from itertools import accumulate
from itertools import pairwise

import numpy as np
import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import Constant
from rpms_ros.stimulation import Doublet
from rpms_ros.stimulation import Pause
from rpms_ros.stimulation import Ramp
from rpms_ros.stimulation import Schedule
from rpms_ros.stimulation import UniformRandom
from rpms_ros.stimulation.devices import SimulatedFaults
from rpms_ros.stimulation.interlocks import Refused
from rpms_ros.stimulation.limits import Limits
from rpms_ros.stimulation.states import State

SECOND = 1_000_000_000
BATCHES, PER_BATCH = 10, 30
KNOWN = {
    'maximum_intensity', 'maximum_intensity_step', 'maximum_intensity_rise', 'minimum_width_s',
    'maximum_width_s', 'maximum_rate_hz', 'rate_limits_hz', 'maximum_train_pulses', 'wait',
    'continuous_power_w', 'session_pulses', 'session_energy_j', 'idle_disarm_s', 'stop',
    'executor', 'supervisor', 'heartbeat', 'force_limit', 'state', 'temperature', 'emergency_stop',
}  # fmt: skip


def random_limits(random):
    """Limits of which about every second schedule breaks some."""
    edges = np.sort(random.uniform(0.1, 0.9, 2)).round(2)
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
        continuous_power_w=float(np.exp(random.uniform(3.0, 8.5))),
        energy_window_s=float(random.uniform(0.2, 2.0)),
        session_pulses=int(random.integers(10, 60)),
        session_energy_j=float(np.exp(random.uniform(5.0, 9.0))),
        interval_tolerance_s=float(random.uniform(0.0, 3e-3)),
        idle_disarm_s=float(random.uniform(0.3, 5.0)),
    )


def random_schedule(random):
    def segment():
        rate, length = float(random.uniform(2.0, 40.0)), float(random.uniform(0.05, 0.5))
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
    SimulatedFaults(slow_s=0.03),
    SimulatedFaults(slow_s=0.15),
    SimulatedFaults(stuck_s=0.3),
    SimulatedFaults(heating_per_pulse=5.0),
    SimulatedFaults(vanish_after=3),
)


def disturb(driver, random):
    """Do one thing that people, devices and machines do at the wrong moment."""
    controller = driver.controller

    def stall():
        driver.clock.now += int(random.integers(1, 800)) * 1_000_000

    def fault():
        driver.faults = FAULTS[random.integers(len(FAULTS))]

    def deaf():
        driver.alive = not driver.alive

    (
        stall,
        fault,
        deaf,
        controller.cancel,
        controller.disarm,
        controller.cleanup,
        lambda: controller.emergency(bool(random.integers(2))),
        lambda: controller.stop('test', 'a test'),
        lambda: controller.measured('force_limit', random.uniform(0.0, 200.0), 100.0, 'N'),
        lambda: controller.temperature(float(random.uniform(20.0, 60.0))),
        lambda: controller.fail('test', 'a test'),
    )[random.integers(11)]()


def live(driver, random):
    """Run schedules with disturbances; return what was refused, by name of the limit."""
    refused = []
    for _ in range(random.integers(1, 4)):
        for command in (
            driver.controller.reset,
            driver.controller.configure,
            driver.controller.arm,
        ):
            attempt(command, refused)
        schedule = random_schedule(random)
        attempt(lambda chosen=schedule: driver.controller.start(chosen), refused)
        for _ in range(random.integers(1, 4)):
            late = int(random.choice([0, 0, 1_000_000, 4_000_000, 9_000_000]))
            driver.advance(float(random.uniform(0.05, 0.5)), late_ns=late)
            if random.random() < 0.3:
                disturb(driver, random)
                silent_if_stopped(driver)
        driver.faults = SimulatedFaults()
        if driver.controller.state is State.FAULT:
            driver.controller.cleanup()
    return refused


def attempt(command, refused):
    try:
        command()
    except Refused as error:
        refused.append(error.limit)
    except StimulationError as error:
        # not legal in this state: the state is named instead of a limit
        refused.append('state' if 'expected state' in str(error) else str(error))


def silent_if_stopped(driver):
    """Right after whatever stops a driver nothing can be fired."""
    if driver.controller.state is State.RUNNING:
        return
    before = len(driver.device.commands)
    driver.controller.step()
    assert driver.controller.due_ns() is None
    assert len(driver.device.commands) == before


def broken(commands, limits):
    """Return the names of the limits that the commands (time, intensity) break."""
    trains = split(commands, round(limits.minimum_pause_s * SECOND))
    energies = [0.0, *accumulate(energy([command], limits) for command in commands)]
    window = round(limits.energy_window_s * SECOND)
    rise = round(limits.rise_window_s * SECOND)
    times = [time for time, _ in commands]
    wrong = {
        'maximum_intensity': any(not 0 <= u <= limits.maximum_intensity for _, u in commands),
        'maximum_train_pulses': any(len(t) > limits.maximum_train_pulses for t in trains),
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


@pytest.mark.parametrize('batch', range(BATCHES))
def test_no_pulse_ever_breaks_a_limit_and_every_refusal_names_one(virtual, batch):
    fired = 0
    refused = set()
    for example in range(PER_BATCH):
        random = np.random.default_rng([batch, example])
        limits = random_limits(random)
        driver = virtual(limits, heartbeat_timeout_s=0.3)
        refused |= set(live(driver, random))
        assert broken(driver.device.commands, limits) == set(), f'example {batch}, {example}'
        fired += len(driver.device.commands)
    assert refused <= KNOWN
    # the examples are worth something: many pulses, and refusals of many kinds
    assert fired > PER_BATCH
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
    )

    def names(*pulses):
        return broken([(round(time * SECOND), value) for time, value in pulses], limits)

    assert names((0.0, 0.1), (0.05, 0.1), (0.1, 0.1)) == set()
    assert names((0.0, 0.1), (0.04, 0.1)) == {'rate'}
    assert names((0.0, 0.1), (0.05, 0.9)) >= {'maximum_intensity', 'maximum_intensity_step'}
    assert names(*((index / 20, 0.1) for index in range(4))) == {'maximum_train_pulses'}
    assert names(*((index / 1.9, 0.1) for index in range(6))) == {'session'}
    assert names((0.0, 0.5)) == {'continuous_power_w'}
    assert names((0.0, 0.4), (0.55, 0.1)) == {'wait'}
