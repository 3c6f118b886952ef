# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The guard: what it relays and refuses, a busy line, processes that die, hang or are stopped."""

import os
import random
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import astuple
from pathlib import Path
from types import SimpleNamespace

import pytest

import rpms_ros.guard
from rpms_ros.guard import packets, rapid2_protocol as rapid2
from rpms_ros.guard.packets import Packet
from rpms_ros.guard.relay import (
    Guard,
    GuardLimits,
    Line,
    LineBusy,
    LineError,
    write,
    write_silence,
)
from rpms_ros.stimulation.devices.rapid2 import Descriptor, GuardedLine, open_port

COMMANDS = (b'Q@', b'EA', b'EB', b'EB', b'EH', b'EH', b'EH', b'F@')
FILLER = b'\x55' * 20_000
TRAIN = Path(__file__).parents[1] / 'guarded_train.py'
RATE_HZ = 20.0


class Driver:
    """The driver's end of a guard that runs as a process; it beats only when it is told to."""

    def __init__(self, port, **limits):
        self.line = open_port(port)
        self.socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.socket.settimeout(60.0)
        descriptors = self.line, theirs.fileno()
        with theirs:
            self.guard = subprocess.Popen(
                [
                    *[sys.executable, '-I', '-S', str(Path(rpms_ros.guard.__file__).parent)],
                    *map(str, (*descriptors, *astuple(GuardLimits(**limits)))),
                ],
                pass_fds=descriptors,
                stderr=subprocess.PIPE,
            )
        assert self.received().kind == packets.HELLO

    def send(self, kind, sequence=0, time_ns=packets.FOREVER_NS, payload=b''):
        self.socket.send(packets.packed(Packet(kind, sequence, time_ns, payload)))

    def received(self):
        return packets.unpacked(self.socket.recv(1000), packets.FROM_GUARD)

    def listen(self):
        self.send(packets.LISTEN, 7)
        assert self.received() == Packet(packets.LISTEN, 7)
        return self

    def exchange(self, command, length=3, sequence=1, time_ns=packets.FOREVER_NS):
        frame = rapid2.framed(command)
        self.send(packets.EXCHANGE, sequence, time_ns, bytes([length]) + frame)
        return self.received()

    def armed(self):
        self.listen()
        for command in (b'Q@', b'@040', b'EB'):
            assert self.exchange(command).kind == packets.ANSWER
        return self

    def ended(self):
        self.guard.wait(60)
        return self.guard.stderr.read().decode()

    def close(self):
        self.socket.close()
        self.ended()
        self.guard.stderr.close()
        os.close(self.line)


def exchange(payload):
    return packets.packed(Packet(packets.EXCHANGE, 1, packets.FOREVER_NS, payload))


@pytest.fixture
def fake(instrument):
    # charged at once; its watchdog does not come before the guard
    return instrument(watchdog_s=20.0, charge_s=0.0)


@pytest.fixture
def driver(fake):
    driving = Driver(fake.port, beat_limit_s=20.0, answer_limit_s=5.0, keep_alive_s=20.0)
    yield driving
    driving.close()


def random_packet(chance):
    """Return a packet of a driver gone wrong: known and unknown frames, silences, noise."""
    kind = chance.choices(
        [packets.EXCHANGE, packets.BEAT, packets.LISTEN, packets.SILENCE, b'noise'],
        [200, 20, 10, 4, 1],
    )[0]
    if kind == b'noise':
        return chance.randbytes(chance.randrange(1, 60))
    percents = chance.choices([0, 20, 40, 41, 100], [10, 10, 10, 1, 1])
    frame = rapid2.framed(chance.choice([*COMMANDS, rapid2.power(percents[0])]))
    if chance.random() < 0.005:
        frame = chance.randbytes(chance.randrange(6))
    latest = packets.FOREVER_NS if chance.random() < 0.9 else 0
    payload = bytes([3]) + frame if kind == packets.EXCHANGE else b''
    return packets.packed(Packet(kind, chance.randrange(2**32), latest, payload))


def attacked_at_random(fake, chance):
    """Send what comes to mind to a guard, until it ends or a pulse was given."""
    driver = Driver(fake.port, beat_limit_s=20.0, answer_limit_s=5.0, maximum_percent=40)
    assert driver.listen().exchange(b'Q@').kind == packets.ANSWER
    # begin anew whenever it was refused: most of what follows then passes
    bodies = (b'@020', b'EB', b'EH')
    anew = [packets.packed(Packet(packets.LISTEN))]
    anew += [exchange(b'\x03' + rapid2.framed(body)) for body in bodies]
    coming = []
    for turn in range(2000):
        # on a busy machine an answer may come too late for a trigger to follow
        if turn >= 200 and fake.fired():
            break
        try:
            driver.socket.settimeout(0.5 if coming else 0.01)
            driver.socket.send(coming.pop(0) if coming else random_packet(chance))
            if driver.received().kind in (packets.REFUSED, packets.DISARMED):
                coming = [*anew]
        except TimeoutError:
            continue
        except (OSError, ValueError):
            # it has ended
            break
    driver.close()


class BusyPort:
    """A port on which somebody else writes more than it takes: the kernel holds others off."""

    def __init__(self, wait_for):
        self.master, slave = os.openpty()
        self.heard = bytearray()
        self.line = os.open(os.ttyname(slave), os.O_RDWR | os.O_NONBLOCK | os.O_NOCTTY)
        os.set_blocking(slave, True)
        self._slave = slave
        self._writing = threading.Thread(target=self._write)
        self._writing.start()
        wait_for(self.is_busy)

    def _write(self):
        left = FILLER
        while left:
            left = left[os.write(self._slave, left) :]

    def is_busy(self):
        try:
            write(self.line, b'?')
        except LineBusy:
            return True
        return False

    def drain(self):
        """Read until the other has written everything, and a silence has come."""
        while self._writing.is_alive() or rapid2.SILENCE not in self.heard:
            self.heard += self._read()
        self._writing.join()

    def _read(self):
        # what the other wrote last may have been read already, while it is about to end
        ready = select.select([self.master], [], [], 0.05)[0]
        return os.read(self.master, 4096) if ready else b''

    def close(self):
        while self._writing.is_alive():
            self._read()
        for descriptor in (self.line, self._slave, self.master):
            os.close(descriptor)


@pytest.fixture
def port(wait_for):
    busy = BusyPort(wait_for)
    yield busy
    busy.close()


@pytest.fixture
def drained(port, monkeypatch):
    """Drain the port from the first pause of a write on; the pauses, however many it takes."""
    monkeypatch.setattr('rpms_ros.guard.relay._PATIENCE_S', 20.0)
    reading = threading.Thread(target=port.drain)
    pauses = []

    def pause(seconds):
        if not pauses:
            reading.start()
        pauses.append(seconds)
        time.sleep(seconds)

    clock = SimpleNamespace(monotonic=time.monotonic, monotonic_ns=time.monotonic_ns, sleep=pause)
    monkeypatch.setattr('rpms_ros.guard.relay.time', clock)
    yield pauses
    reading.join()
    assert pauses
    assert FILLER[-100:] + rapid2.SILENCE in port.heard


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
    assert fake.triggers[-1][0] <= fake.disarmed[-1][0]
    assert fake.percent == 0 or why == 'watchdog'


def test_exchange_is_relayed_once_the_driver_listens_with_the_moment_of_its_writing(fake, driver):
    assert driver.exchange(b'Q@').kind == packets.REFUSED
    assert fake.frames == []
    before = time.monotonic_ns()
    answer = driver.listen().exchange(b'Q@', sequence=9)
    assert (answer.kind, answer.sequence) == (packets.ANSWER, 9)
    assert before < answer.time_ns < time.monotonic_ns()
    assert rapid2.parsed(b'Q@', answer.payload, 3).status & rapid2.COIL_PRESENT
    driver.send(packets.BEAT, 11)
    assert driver.received() == Packet(packets.PONG, 11)


def test_a_mistake_in_the_guard_disarms(fake, wait_for, monkeypatch):
    line = open_port(fake.port)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    theirs.setblocking(False)
    reading, writing = os.pipe()
    guard = Guard(line, theirs.fileno(), GuardLimits(), reading)
    monkeypatch.setattr(guard, '_step', lambda _: 1 / 0)
    os.write(line, b''.join(map(rapid2.framed, (b'Q@', b'@040', b'EB'))))
    wait_for(lambda: fake.armed)
    with pytest.raises(ZeroDivisionError):
        guard.run()
    wait_for(lambda: not fake.armed and fake.percent == 0)
    for descriptor in (line, reading, writing):
        os.close(descriptor)
    ours.close()
    theirs.close()


UNKNOWN_FRAMES = (
    b'',
    b'\x03',
    b'\x03EH\x00',
    b'\x03' + rapid2.framed(b'b@'),
    b'\x03' + rapid2.framed(b'[010'),
    b'\x03' + rapid2.framed(b'@101'),
    b'\x21' + rapid2.framed(b'EH'),
    b'\x03' + rapid2.framed(b'EH') * 2,
)
NO_PACKETS = (b'E', b'\xff' * 13, bytes(300), b'Z' + bytes(12))


@pytest.mark.parametrize('sent', [*map(exchange, UNKNOWN_FRAMES), *NO_PACKETS])
def test_frame_that_is_not_known_or_no_packet_ends_it_disarmed(fake, driver, sent, wait_for):
    driver.armed().socket.send(sent)
    expected = 'a packet of' if sent in NO_PACKETS else 'a known command'
    assert f'expected {expected}' in driver.ended()
    assert (fake.armed, fake.percent, fake.fired()) == (False, 0, [])
    wait_for(lambda: fake.frames[-1] == b'R@')


def test_more_than_one_exchange_at_a_time_ends_it_disarmed(fake, driver):
    driver.armed()
    fake.hang = True
    for sequence in range(4):
        driver.send(packets.EXCHANGE, sequence, payload=b'\x03' + rapid2.framed(b'Q@'))
    assert 'expected one exchange at a time' in driver.ended()
    fake.hang = False


def test_trigger_needs_an_intensity_that_the_instrument_has_taken_since_a_silence(fake, driver):
    def refused():
        disarmed = driver.exchange(b'EH')
        assert disarmed.kind == packets.DISARMED
        assert disarmed.payload == b'expected an intensity before a trigger, got none'
        assert driver.received().kind == packets.REFUSED
        assert fake.fired() == []

    driver.armed()
    fake.refuse = {b'@': b'S'}
    driver.exchange(b'@040')
    fake.refuse = {}
    refused()
    driver.armed().send(packets.SILENCE)
    driver.listen()
    for command in (b'Q@', b'EB'):
        assert driver.exchange(command).kind == packets.ANSWER
    refused()


def test_intensity_above_the_bound(fake):
    driver = Driver(fake.port, beat_limit_s=20.0, answer_limit_s=5.0, maximum_percent=40)
    driver.armed()
    assert driver.exchange(b'EH').kind == packets.ANSWER
    driver.send(packets.EXCHANGE, 2, payload=b'\x03' + rapid2.framed(b'@041'))
    refusal = driver.received()
    assert refusal.payload == b'expected at most 40 percent, got 41'
    driver.close()
    assert fake.fired() == [40]
    assert b'@041' not in fake.frames


def test_trigger_that_waited_too_long_is_not_written(fake, driver):
    late = driver.armed().exchange(b'EH', sequence=5, time_ns=time.monotonic_ns())
    assert late == Packet(packets.LATE, 5)
    assert fake.fired() == []
    assert driver.exchange(b'EH').kind == packets.ANSWER


def test_a_guard_that_was_stopped_relays_nothing_old_and_obeys_the_silence_first(fake, driver):
    driver.armed()
    driver.guard.send_signal(signal.SIGSTOP)
    # without a latest time at all: the silence alone keeps it from being relayed
    driver.send(packets.EXCHANGE, 1, payload=b'\x03' + rapid2.framed(b'EH'))
    driver.send(packets.SILENCE)
    driver.guard.send_signal(signal.SIGCONT)
    assert driver.received().kind == packets.REFUSED
    driver.listen()
    assert not fake.armed
    assert fake.fired() == []


def test_keep_alives_come_only_while_the_driver_beats(fake, wait_for):
    # longer than a busy machine stands still
    driver = Driver(fake.port, beat_limit_s=2.0, keep_alive_s=0.05, answer_limit_s=5.0).armed()
    asked = fake.frames.count(b'Q@')

    def kept_alive():
        driver.send(packets.BEAT)
        return fake.frames.count(b'Q@') > asked + 3

    wait_for(kept_alive)
    assert fake.armed
    # now it is silent
    wait_for(lambda: not fake.armed)
    kept = fake.frames.count(b'Q@')
    wait_for(lambda: fake.frames[-1] == b'EA')
    assert fake.frames.count(b'Q@') == kept
    driver.close()


def test_keep_alive_that_shows_an_error_disarms(fake):
    driver = Driver(fake.port, beat_limit_s=20.0, keep_alive_s=0.05, answer_limit_s=5.0).armed()
    fake.error = True
    packet = driver.received()
    assert packet.kind == packets.DISARMED
    assert b'expected an instrument without error' in packet.payload
    driver.close()
    assert not fake.armed


def test_disarming_is_tried_again_before_an_instrument_is_left_to_its_own_watchdog(
    instrument, wait_for
):
    # every frame is a sign of life to it: the guard has to fall silent
    fake = instrument(watchdog_s=2.0, charge_s=0.0)
    driver = Driver(fake.port, beat_limit_s=20.0, answer_limit_s=5.0).armed()
    fake.obey_disarm = False
    driver.send(packets.SILENCE)
    wait_for(lambda: not fake.armed)
    assert fake.disarmed[-1][1] == 'watchdog'
    # two in each of five attempts
    assert fake.frames.count(b'EA') == 10
    driver.close()


def test_line_that_never_becomes_quiet(fake, driver):
    driver.send(packets.LISTEN, 3)
    last = time.monotonic()
    end, longest = last + 60.0, 0.0
    driver.socket.settimeout(0.005)
    while last < end:
        fake.noise(b'\x55' * 8)
        last, before = time.monotonic(), last
        longest = max(longest, last - before)
        try:
            packet = driver.received()
        except TimeoutError:
            continue
        if packet.kind == packets.LISTEN and max(longest, time.monotonic() - last) > 0.02:
            # the machine stood still, and the line was quiet meanwhile
            driver.send(packets.LISTEN, 3)
            longest = 0.0
            continue
        assert packet.kind == packets.REFUSED
        assert b'expected a quiet line, got' in packet.payload
        break
    else:
        pytest.fail('still listening')


@pytest.mark.parametrize('number', ['SIGHUP', 'SIGTERM', 'SIGXCPU'])
def test_a_signal_to_the_guard_disarms_first(fake, driver, number, wait_for):
    driver.armed().guard.send_signal(signal.Signals[number])
    assert 'the guard was told to end' in driver.ended()
    assert driver.guard.returncode == 0
    assert not fake.armed
    wait_for(lambda: fake.frames[-1] == b'R@')
    assert driver.received().kind == packets.DISARMED


def test_guard_knows_neither_numpy_nor_ros_nor_an_environment(tmp_path):
    text = (
        'import sys; sys.path[0] = sys.argv[1]; import rpms_ros.guard.process; '
        'names = {name.split(".")[0] for name in sys.modules}; '
        'print(sorted(names - set(sys.stdlib_module_names)))'
    )
    root = str(Path(rpms_ros.guard.__file__).parents[2])
    # what an environment could slip in
    (tmp_path / 'socket.py').write_text('raise SystemExit(3)')
    found = subprocess.run(
        [sys.executable, '-I', '-S', '-c', 'import sys; sys.path.insert(0, ""); ' + text, root],
        capture_output=True,
        text=True,
        env={'PYTHONPATH': str(tmp_path), 'PATH': ''},
        check=True,
    )
    assert found.stdout.strip() == "['__main__', 'rpms_ros']"


@pytest.mark.parametrize('seed', range(6))
def test_whatever_a_driver_sends_no_trigger_passes_the_bound_and_it_ends_disarmed(
    fake, seed, wait_for
):
    chance = random.Random(seed)
    # one that ends before its first pulse shows little
    end = time.monotonic() + 60.0
    while not fake.fired() and time.monotonic() < end:
        attacked_at_random(fake, chance)
        assert not fake.armed
        assert fake.percent == 0
        wait_for(lambda: fake.frames[-1] == b'R@')
    assert fake.fired()
    assert all(percent <= 40 for percent in fake.fired())
    assert not {b'@041', b'@100'} & set(fake.frames)


@pytest.mark.usefixtures('drained')
def test_a_silence_of_the_driver_waits_while_its_guard_writes(port):
    line = GuardedLine('unused', GuardLimits())
    line._line = Descriptor(os.dup(port.line))
    assert line.silence()


@pytest.mark.usefixtures('drained')
def test_a_guard_whose_driver_writes_relays_no_trigger_and_disarms(port):
    driver, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with driver, theirs:
        guard = Guard(port.line, theirs.fileno(), GuardLimits(), wakeup=-1)
        guard._live, guard._percent = True, 40
        payload = bytes([rapid2.STATUS_LENGTH]) + rapid2.framed(rapid2.TRIGGER)
        guard._take(Packet(packets.EXCHANGE, 5, packets.FOREVER_NS, payload))
        kinds = {packets.unpacked(driver.recv(1000), packets.FROM_GUARD).kind for _ in range(2)}
        assert kinds == {packets.REFUSED, packets.DISARMED}
        assert not guard.ended
        assert rapid2.framed(rapid2.TRIGGER) not in port.heard


def test_a_command_does_not_wait_and_a_line_that_takes_nothing_is_given_up(port):
    line = Line(port.line)
    with pytest.raises(LineBusy, match='expected a line to write to, got'):
        line.ask(rapid2.TRIGGER, rapid2.STATUS_LENGTH)
    assert line.outstanding is None
    began = time.monotonic()
    with pytest.raises(LineError, match='expected a line to write to, got'):
        write_silence(port.line, rapid2.SILENCE)
    # not before the patience is over
    assert time.monotonic() - began >= 0.05


def test_a_guard_whose_line_takes_nothing_disarms_when_it_does(port, wait_for):
    driver, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    reading, writing = os.pipe()
    with theirs:
        theirs.setblocking(False)
        guard = Guard(port.line, theirs.fileno(), GuardLimits(), reading)
        driver.close()
        reasons = []
        guarding = threading.Thread(target=lambda: reasons.append(guard.run()))
        guarding.start()
        # longer than all its attempts on a line that takes them
        end = time.monotonic() + 1.0
        wait_for(lambda: reasons or time.monotonic() > end)
        assert not reasons
        port.drain()
        guarding.join()
    assert reasons[0].startswith('the driver is gone')
    for descriptor in (reading, writing):
        os.close(descriptor)


def test_what_a_line_takes_in_part_is_tried_again(monkeypatch):
    parts = iter([3, 5, 8])
    monkeypatch.setattr('rpms_ros.guard.relay.os.write', lambda _, __: next(parts))
    write_silence(-1, rapid2.SILENCE)
    assert len(rapid2.SILENCE) == 8
    assert not list(parts)


@pytest.mark.parametrize('number', ['SIGKILL', 'SIGTERM', 'SIGSEGV'])
def test_driver_is_killed(train, wait_for, number):
    fake, run = train()
    # a signal to the group of the driver leaves the guard
    assert os.getsid(run.guard) == run.guard
    run.process.send_signal(signal.Signals[number])
    assert_silent(fake, wait_for, 'was told to')
    wait_for(lambda: gone(run.guard))
    wait_for(lambda: fake.frames[-1] == b'R@')


@pytest.mark.parametrize('who', ['driver', 'guard'])
def test_driver_or_guard_is_stopped_and_goes_on(train, wait_for, who):
    fake, run = train(beat_limit_s=3.0, answer_limit_s=3.0)
    stopped = run.process.pid if who == 'driver' else run.guard
    os.kill(stopped, signal.SIGSTOP)
    assert_silent(fake, wait_for, 'was told to')
    fired = len(fake.triggers)
    os.kill(stopped, signal.SIGCONT)
    said = run.process.stdout.readline()
    assert 'fault' in said
    assert who == 'guard' or 'sign of life of the driver' in said
    assert run.process.wait(60) == 0
    wait_for(lambda: gone(run.guard))
    assert len(fake.triggers) == fired


def test_guard_is_killed(train, wait_for):
    fake, run = train()
    os.kill(run.guard, signal.SIGKILL)
    # past the guard
    assert_silent(fake, wait_for, 'was told to')
    assert 'fault' in run.process.stdout.readline()
    assert run.process.wait(60) == 0


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
