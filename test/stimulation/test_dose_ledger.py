# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The dose ledger: what was reserved counts, whatever happens to process, clock, file and disk."""

import dataclasses
import itertools
import os
import resource
from contextlib import closing, contextmanager

import pytest

from rpms_ros.stimulation.limits.limiter import BookedPulse, DoseExceeded, DoseLimits, LedgerError
from rpms_ros.stimulation.records.clocks import EARLIEST_WALL_NS, Clocks
from rpms_ros.stimulation.records.dose_ledger import DoseLedger, MemoryLedger

SECOND = 1_000_000_000
HOUR = 3600 * SECOND
LIMITS = DoseLimits(pulses=100, energy_j=5000.0, window_h=1.0)


class Machine:
    """A machine whose clocks only the test moves."""

    def __init__(self):
        self.monotonic = 100 * SECOND
        self.boot = 200 * SECOND
        self.wall = EARLIEST_WALL_NS + 1000 * HOUR
        self.boot_id = 'first'

    @property
    def clocks(self):
        return Clocks(
            lambda: self.monotonic, lambda: self.boot, lambda: self.wall, lambda: self.boot_id
        )

    def wait(self, seconds):
        self.monotonic += round(seconds * SECOND)
        self.boot += round(seconds * SECOND)
        self.wall += round(seconds * SECOND)

    def restart(self, off_s):
        self.wall += round(off_s * SECOND)
        self.monotonic = self.boot = 10 * SECOND
        self.boot_id = 'second'


@pytest.fixture
def machine():
    return Machine()


@pytest.fixture
def opened(tmp_path, machine):
    """Open a ledger; whatever is open at the end is closed."""
    ledgers = []

    def open_ledger(device='coil-1', patient='P01', dose=LIMITS):
        ledgers.append(DoseLedger(tmp_path, device, patient, dose, machine.clocks))
        return ledgers[-1]

    yield open_ledger
    for ledger in ledgers:
        ledger.close()


@pytest.fixture(params=['memory', 'file'])
def ledger(request, machine, opened):
    """A ledger of either kind."""
    if request.param == 'file':
        return opened()
    return MemoryLedger(LIMITS, lambda: machine.monotonic)


@pytest.fixture
def left(machine, opened):
    """Reserve so many pulses, each lot by itself, in a process that is killed then."""

    def leave(*counts, **parties):
        ledger = opened(**parties)
        for count in counts:
            ledger.reserve(planned(machine, count))
        killed(ledger)

    return leave


def ledgers_of(folder):
    return folder / 'device-coil-1.ledger', folder / 'patient-p01.ledger'


def planned(machine, count, energy=10.0):
    return [BookedPulse(machine.monotonic + i * SECOND // 20, 0.5, energy) for i in range(count)]


def killed(ledger):
    """Let go of the files as the end of a process does, nothing given back."""
    for file in ledger._files:
        file.close()


def test_a_pulse_is_reserved_taken_once_or_given_back(ledger, machine):
    numbers = ledger.reserve(planned(machine, 5))
    assert len(numbers) == 5
    assert ledger.totals() == (5, 50.0)
    ledger.take(numbers[0])
    with pytest.raises(LedgerError, match='expected a reserved pulse, got number 0'):
        ledger.take(numbers[0])
    with pytest.raises(LedgerError, match=r'expected reserved pulses to give back, got .*\[0\]'):
        ledger.settle([numbers[0]])
    ledger.settle([numbers[4]])
    assert ledger.totals() == (4, 40.0)
    with pytest.raises(LedgerError, match='expected a reserved pulse, got number 4'):
        ledger.take(numbers[4])
    ledger.settle()
    assert ledger.totals() == (1, 10.0)
    more = ledger.reserve(planned(machine, 1))
    assert set(more).isdisjoint(numbers)
    assert not ledger.reserve([])


def test_more_than_the_dose_is_refused_until_the_window_has_passed(ledger, machine):
    for number in ledger.reserve(planned(machine, 99, energy=1.0)):
        ledger.take(number)
    with pytest.raises(DoseExceeded, match='dose_pulses: expected at most 100 pulses in 1 h, got'):
        ledger.reserve(planned(machine, 2))
    most = 'dose_energy_j: expected at most 5000 J in 1 h'
    with pytest.raises(DoseExceeded, match=most) as found:
        ledger.reserve(planned(machine, 1, energy=4902.0))
    assert found.value.limit == 'dose_energy_j'
    assert ledger.totals() == (99, 99.0)
    machine.wait(3605.1)
    assert ledger.totals() == (0, 0.0)
    late = ledger.reserve(planned(machine, 1))
    machine.wait(3600.1)
    # what has left the window is not given back a second time
    assert len(ledger.reserve(planned(machine, 100))) == 100
    ledger.settle(late)
    assert ledger.totals() == (100, 1000.0)


def test_what_was_reserved_counts_after_a_kill_and_what_was_given_back_does_not(machine, opened):
    first = opened()
    numbers = first.reserve(planned(machine, 10))
    for number in numbers[:6]:
        first.take(number)
    first.settle([numbers[9]])
    killed(first)
    machine.wait(7.0)
    second = opened()
    assert second.totals() == (9, 90.0)
    history = second.history(machine.monotonic)
    assert [pulse.time_ns for pulse in history] == [
        machine.monotonic - 7 * SECOND + i * SECOND // 20 for i in range(9)
    ]
    assert all(pulse[1:] == (0.5, 10.0, True, True) for pulse in history)
    second.close()
    # closed in good order: what was fired counts, no more
    third = opened()
    for number in third.reserve(planned(machine, 5))[:2]:
        third.take(number)
    third.close()
    assert opened().totals() == (11, 110.0)


def test_device_and_patient_are_counted_apart(machine, opened, left):
    left(4)
    other = opened('coil-1', 'P02')
    assert other.totals() == (0, 0.0)
    assert [pulse[3:] for pulse in other.history(0)] == [(True, False)] * 4
    other.reserve(planned(machine, 3))
    killed(other)
    moved = opened('coil-2', 'P01')
    assert moved.totals() == (4, 40.0)
    assert [pulse[3:] for pulse in moved.history(0)] == [(False, True)] * 4
    killed(moved)
    again = opened('coil-1', 'P01')
    assert len(again.history(0)) == 7
    assert again.totals() == (4, 40.0)


def test_one_process_at_a_time_for_a_device_and_for_a_patient(opened):
    opened('coil-1', 'P01')
    with pytest.raises(LedgerError, match=r'device-coil-1\.ledger .*in use by another process'):
        opened('coil-1', 'P02')
    with pytest.raises(LedgerError, match=r'patient-p01\.ledger .*in use by another process'):
        opened('coil-2', 'P01')
    opened('coil-2', 'P02')


def test_names_are_bounded_cannot_leave_the_folder_and_case_makes_no_second_patient(
    opened, tmp_path
):
    opened(device='../../coil', patient='P01').close()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        'device-..%2F..%2Fcoil.ledger', 'patient-p01.ledger',
    ]  # fmt: skip
    with pytest.raises(
        LedgerError, match=r"expected the ledger of patient 'p01', got that of .*P01"
    ):
        opened(patient='p01')
    for name in ('', 'x' * 65, '\ud800', 'a\nb'):
        with pytest.raises(LedgerError, match='expected a name of 1 to 64 printable characters'):
            opened(patient=name)


def test_wall_clock_does_not_matter_within_a_boot(machine, opened, left):
    left(5)
    machine.wait(10.0)
    machine.wall += 100 * HOUR
    second = opened()
    assert second.totals() == (5, 50.0)
    killed(second)
    machine.wall -= 300 * HOUR
    assert opened().totals() == (5, 50.0)


@pytest.mark.parametrize(
    ('off_s', 'counted', 'why'),
    [
        (600.0, 5, 'off for ten minutes'),
        (7200.0, 0, 'off for longer than the window'),
        (-50 * 3600.0, 5, 'set back while off'),
        (-1000 * 3600.0 - 1.0, 5, 'not set at all'),
    ],
)
def test_across_boots_the_wall_clock_may_only_add_to_what_is_certain(
    machine, opened, left, off_s, counted, why
):
    left(5)
    machine.restart(off_s)
    second = opened()
    assert second.totals().pulses == counted, why
    killed(second)
    # an hour of this boot is certain, whatever the wall clock says
    machine.boot = machine.monotonic = 3601 * SECOND
    assert opened().totals().pulses == 0


def test_another_machine_s_uptime_makes_no_pulse_older(machine, opened, left):
    """Two stations, one folder: what one gave ten minutes ago was a day old on the other."""
    machine.boot_id = 'station-1/first'
    left(5)
    machine.restart(600.0)
    machine.boot_id, machine.boot = 'station-2/first', 24 * HOUR
    second = opened(device='coil-2')
    assert second.totals().pulses == 5
    killed(second)
    machine.boot_id = 'station-1/second'
    assert opened(device='coil-3').totals().pulses == 0


def test_a_wall_clock_that_was_set_later_tells_when_pulses_were(machine, opened):
    """A day behind until the network was there: after a restart the pulses were a day old."""
    ledger = opened()
    for number in ledger.reserve(planned(machine, 5)):
        ledger.take(number)
    machine.wait(10.0)
    machine.wall += 24 * HOUR
    ledger.close()
    machine.restart(600.0)
    assert opened().totals().pulses == 5


def test_reading_the_ledgers_makes_no_pulse_older(machine, left, tmp_path):
    left(1)
    fired = machine.boot
    readings = itertools.count(fired, SECOND)
    clocks = dataclasses.replace(machine.clocks, boot_ns=lambda: next(readings))
    with closing(DoseLedger(tmp_path, 'coil-1', 'P01', LIMITS, clocks)) as ledger:
        (pulse,) = ledger.history(0)
        assert 0 < -pulse.time_ns <= next(readings) - fired


def test_a_record_cut_off_counts_as_far_as_it_can_be_read(opened, left, tmp_path):
    left(2)
    left(5)
    device, patient = ledgers_of(tmp_path)
    data = device.read_bytes()
    # in the middle of the fourth pulse; the patient's ledger was not written yet
    end = [i for i in range(len(data)) if data.startswith(b',10.0]', i)][5] - 3
    device.write_bytes(data[:end])
    lines = patient.read_bytes().splitlines(keepends=True)
    patient.write_bytes(b''.join(lines[:-1]))
    third = opened()
    assert third.totals().pulses == 2 + 3
    killed(third)
    assert opened().totals().pulses == 2 + 3


def test_a_reservation_that_reached_one_ledger_only_is_put_into_the_other(opened, left, tmp_path):
    left(2, 3)
    patient = ledgers_of(tmp_path)[1]
    data = patient.read_bytes()
    lines = data.splitlines(keepends=True)
    for cut in (b''.join(lines[:-1]), data[:-100]):
        patient.write_bytes(cut)
        again = opened()
        assert again.totals().pulses == 5
        killed(again)
        moved = opened('coil-2', 'P01')
        assert moved.totals().pulses == 5
        killed(moved)
        killed(opened('coil-1', 'P02'))


def test_a_reservation_put_into_the_other_ledger_late_can_be_read(machine, opened, left, tmp_path):
    machine.boot = machine.monotonic = 60 * HOUR
    left(2, 3)
    patient = ledgers_of(tmp_path)[1]
    patient.write_bytes(b''.join(patient.read_bytes().splitlines(keepends=True)[:-1]))
    # none of its pulses counts any more
    machine.wait(25 * 3600.0)
    for _ in range(2):
        killed(opened())


def test_a_reservation_of_an_earlier_boot_is_put_into_the_other_ledger(
    machine, opened, left, tmp_path
):
    machine.boot = machine.monotonic = 60 * HOUR
    left(2, 3)
    patient = ledgers_of(tmp_path)[1]
    patient.write_bytes(b''.join(patient.read_bytes().splitlines(keepends=True)[:-1]))
    machine.restart(600.0)
    left(4, device='coil-2')
    for more in (0, 7, 0):
        ledger = opened()
        assert ledger.totals().pulses == 9
        ledger.settle(ledger.reserve(planned(machine, more)))
        killed(ledger)


@pytest.mark.parametrize('which', [0, 1])
def test_lost_records_and_lost_ledgers_are_refused(opened, left, tmp_path, which):
    left(2, 2, 2, 2)
    path = ledgers_of(tmp_path)[which]
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b''.join(lines[:-2]))
    with pytest.raises(LedgerError, match=r'the 4 reservations .* got 2: records are missing'):
        opened()
    path.unlink()
    with pytest.raises(LedgerError, match=r'the 4 reservations .* got 0: records are missing'):
        opened()


def replaced(path):
    data = path.read_bytes()
    path.unlink()
    path.write_bytes(data)


@pytest.mark.parametrize('which', [0, 1])
@pytest.mark.parametrize(
    ('change', 'fault'),
    [
        (lambda path: path.unlink(), 'No such file'),
        (replaced, 'another file of that name'),
        (lambda path: os.truncate(path, 400), r'\d+ bytes in place of \d+'),
        (lambda path: path.write_bytes(path.read_bytes() + b'\n'), r'\d+ bytes in place of \d+'),
    ],
)
def test_a_ledger_that_is_removed_or_changed_while_open_takes_nothing_more(
    machine, opened, tmp_path, which, change, fault
):
    ledger = opened()
    ledger.reserve(planned(machine, 2))
    change(ledgers_of(tmp_path)[which])
    with pytest.raises(LedgerError, match=f'expected a writable .*, got .*{fault}'):
        ledger.reserve(planned(machine, 1))
    with pytest.raises(LedgerError, match='expected a working ledger, got'):
        ledger.reserve(planned(machine, 1))


def test_a_ledger_of_anybody_that_names_what_is_missing_is_enough_to_refuse(
    machine, opened, left, tmp_path
):
    first = opened('coil-1', 'P02')
    for number in first.reserve(planned(machine, 3)):
        first.take(number)
    first.close()
    opened('coil-1', 'a "b\\').close()
    device = tmp_path / 'device-coil-1.ledger'
    whole = device.read_bytes()
    device.unlink()
    missing = r"device 'coil-1' the 1 reservations that patient-p02\.ledger has, got 0"
    with pytest.raises(LedgerError, match=missing):
        opened('coil-1', 'P01')
    device.write_bytes(whole)
    for _ in range(2):
        left(1, device='coil-2', patient='P02')
    (tmp_path / 'patient-p02.ledger').unlink()
    missing = r"patient 'P02' the 2 reservations that device-coil-2\.ledger has, got 0"
    with pytest.raises(LedgerError, match=missing):
        opened('coil-1', 'P02')


def test_a_flipped_bit_anywhere_is_refused_or_changes_nothing(tmp_path, opened, left):
    left(4, 4, 4)
    paths = ledgers_of(tmp_path)
    whole = [path.read_bytes() for path in paths]
    refused = 0
    # a prime step goes through all bits of a byte and all fields of a record
    for position in range(0, len(whole[0]) * 8, 37):
        for path, data in zip(paths, whole, strict=True):
            path.write_bytes(data)
        flipped = bytearray(whole[0])
        flipped[position // 8] ^= 1 << position % 8
        paths[0].write_bytes(flipped)
        try:
            ledger = opened()
        except LedgerError:
            refused += 1
            continue
        # the end of the last line: the record looks cut off, and counts as far as it can be read
        assert position // 8 == len(whole[0]) - 1
        assert ledger.totals().pulses >= 12
        killed(ledger)
    assert refused > 300


@contextmanager
def small_disk(folder, left):
    """Let files grow by so many bytes only."""
    size = max(path.stat().st_size for path in folder.iterdir())
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size + left, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_is_an_error_and_what_was_reserved_before_counts(machine, opened, tmp_path):
    ledger, lots = opened(dose=None), []

    def reserve_more():
        while True:
            lots.append(ledger.reserve(planned(machine, 7)))

    with small_disk(tmp_path, 3000):
        with pytest.raises(LedgerError, match='expected a writable'):
            reserve_more()
        with pytest.raises(LedgerError, match='expected a working ledger, got'):
            ledger.reserve(planned(machine, 1))
    killed(ledger)
    assert lots
    # the last one, which was refused, counts as far as it can be read
    assert 7 * len(lots) <= len(opened().history(0)) <= 7 * len(lots) + 7


def test_the_dose_holds_across_kills(tmp_path, beside):
    # 100 kills: bench/ledger.py
    found = beside('ledger_kills').kill_repeatedly(tmp_path, kills=8, pulses=600)
    assert found.kills >= 1
    assert found.fired > 0
    assert found.fired <= found.counted <= 600
    assert found.fired_j <= found.counted_j <= 3600.0
