# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A guard and its driver as processes that are killed, stopped or hang."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

TRAIN = Path(__file__).parents[1] / 'guarded_train.py'
RATE_HZ = 20.0


# ---- processes


class Train:
    """A driver as a process, firing through its guard; a loaded machine may hold up each of them.

    A test in which somebody is stopped or hangs waits for one of the limits.
    """

    def __init__(self, port, beat_limit_s=5.0, answer_limit_s=5.0):
        limits = str(beat_limit_s), str(answer_limit_s)
        self.process = subprocess.Popen(
            [sys.executable, str(TRAIN), port, str(RATE_HZ), *limits],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        said = self.process.stdout.readline()
        assert said.startswith('guard'), self.process.stderr.read()
        self.guard = int(said.split()[1])

    def close(self):
        for pid in (self.process.pid, self.guard):
            try:
                os.kill(pid, signal.SIGCONT)
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        self.process.communicate()


@pytest.fixture
def train(instrument, wait_for):
    """Start an instrument and a train on it; its own watchdog comes last."""
    running = []

    def start(watchdog_s=20.0, **options):
        fake = instrument(watchdog_s=watchdog_s)
        running.append(Train(fake.port, **options))
        wait_for(lambda: len(fake.triggers) > 2)
        return fake, running[-1]

    yield start
    for each in running:
        each.close()


def gone(pid):
    try:
        return Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()[0] == 'Z'
    except OSError:
        return True


def assert_silent(fake, wait_for, why):
    wait_for(lambda: not fake.armed)
    assert fake.disarmed[-1][1] == why
    fired = len(fake.triggers)
    heard = len(fake.commands)
    # the guard asks until the instrument has said that it is disarmed
    wait_for(lambda: len(fake.commands) >= heard)
    assert len(fake.triggers) == fired
    assert fake.percent == 0 or why == 'watchdog'


def test_driver_is_killed(train, wait_for):
    fake, run = train()
    run.process.kill()
    assert_silent(fake, wait_for, 'was told to')
    wait_for(lambda: gone(run.guard))
    wait_for(lambda: fake.frames[-1] == b'R@')


def test_driver_is_stopped_and_goes_on(train, wait_for):
    fake, run = train(beat_limit_s=3.0, answer_limit_s=3.0)
    run.process.send_signal(signal.SIGSTOP)
    assert_silent(fake, wait_for, 'was told to')
    fired = len(fake.triggers)
    run.process.send_signal(signal.SIGCONT)
    said = run.process.stdout.readline()
    assert 'fault' in said
    assert 'sign of life of the driver' in said
    assert run.process.wait(60) == 0
    assert len(fake.triggers) == fired


def test_guard_is_killed(train, wait_for):
    fake, run = train()
    os.kill(run.guard, signal.SIGKILL)
    # past the guard
    assert_silent(fake, wait_for, 'was told to')
    assert 'fault' in run.process.stdout.readline()
    assert run.process.wait(60) == 0


def test_guard_is_stopped_and_goes_on(train, wait_for):
    fake, run = train(beat_limit_s=3.0, answer_limit_s=3.0)
    os.kill(run.guard, signal.SIGSTOP)
    assert_silent(fake, wait_for, 'was told to')
    fired = len(fake.triggers)
    os.kill(run.guard, signal.SIGCONT)
    assert 'fault' in run.process.stdout.readline()
    assert run.process.wait(60) == 0
    wait_for(lambda: gone(run.guard))
    assert len(fake.triggers) == fired


def test_both_are_killed(train, wait_for):
    fake, run = train(watchdog_s=3.0)
    os.kill(run.guard, signal.SIGSTOP)
    run.process.kill()
    os.kill(run.guard, signal.SIGKILL)
    assert_silent(fake, wait_for, 'watchdog')


def test_instrument_hangs(train, wait_for):
    fake, run = train(answer_limit_s=3.0)
    fake.hang = True
    assert 'fault' in run.process.stdout.readline()
    fired = len(fake.triggers)
    fake.hang = False
    assert_silent(fake, wait_for, 'was told to')
    # what it had in its ears it may still do
    assert len(fake.triggers) <= fired + 1
    assert run.process.wait(60) == 0


@pytest.mark.parametrize('number', ['SIGTERM', 'SIGSEGV'])
def test_a_signal_to_the_group_of_the_driver_leaves_the_guard(train, wait_for, number):
    fake, run = train()
    run.process.send_signal(signal.Signals[number])
    assert_silent(fake, wait_for, 'was told to')
    wait_for(lambda: gone(run.guard))
    assert os.getsid(0) != run.guard
