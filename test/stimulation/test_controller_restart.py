# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Books that outlive a run, a driver and a kill: reservations, rest, warmth of the coil."""

import os
from contextlib import closing

import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import Ramp, Schedule, constant
from rpms_ros.stimulation.driver.safety_monitor import Refused
from rpms_ros.stimulation.driver.states import State
from rpms_ros.stimulation.limits.limiter import BookedPulse, DoseLimits, LedgerError, Limits, Rest
from rpms_ros.stimulation.records.append_only import AUDIT_LOG, ChainedFile
from rpms_ros.stimulation.records.clocks import Clocks
from rpms_ros.stimulation.records.dose_ledger import DoseLedger, MemoryLedger

TRAIN = constant(0.5, 5.0, 20.0)
SECOND = 1_000_000_000


class FailingLedger(MemoryLedger):
    """Fails when it is told to."""

    broken = False

    def __init__(self, dose=None, past=()):
        # in the time of the test: the machine may run for longer than the window of a dose
        super().__init__(dose, lambda: SECOND)
        self.reserved, self.past = [], past

    def history(self, now_monotonic_ns):
        return tuple(
            pulse._replace(time_ns=now_monotonic_ns + pulse.time_ns) for pulse in self.past
        )

    def reserve(self, pulses):
        if self.broken:
            raise LedgerError('expected a disk, got none')
        self.reserved.extend(pulses)
        return super().reserve(pulses)


def test_pulses_are_reserved_ahead_and_given_back_after_the_end(virtual):
    ledger = FailingLedger()
    driver = virtual(ledger=ledger).started()
    # a second ahead
    assert len(ledger.reserved) == 21
    for _ in range(30):
        driver.advance(0.1)
        assert len(ledger.reserved) - len(driver.device.commands) >= 10
    driver.controller.cancel()
    driver.advance(0.1)
    given = len(driver.device.commands)
    assert ledger.totals().pulses == given
    assert [pulse.time_ns for pulse in ledger.reserved[:given]] == [
        driver.run.onset_ns(index) for index in range(given)
    ]


def test_a_run_that_ends_while_the_ledger_writes_is_given_back_too(virtual):
    ledger = FailingLedger()
    driver = virtual(ledger=ledger).started(seconds=0.3)
    reserve, ends = ledger.reserve, [driver.controller.cancel]

    def ends_meanwhile(pulses):
        numbers = reserve(pulses)
        while ends:
            ends.pop()()
        return numbers

    ledger.reserve = ends_meanwhile
    driver.advance(1.0)
    assert not ends
    given = len(driver.device.commands)
    assert 0 < given < len(ledger.reserved)
    assert ledger.totals().pulses == given


def test_dose_that_somebody_else_uses_up_ends_the_run(virtual):
    ledger = MemoryLedger(DoseLimits(pulses=120, energy_j=1e6, window_h=24.0), lambda: SECOND)
    driver = virtual(ledger=ledger).started(seconds=0.2)
    ledger.count([BookedPulse(0, 1.0, 0.0)] * 60)
    driver.advance(5.0)
    assert (driver.run.cause, driver.controller.state) == ('limit', State.DISARMED)
    assert 'dose_pulses: expected at most 120 pulses' in driver.run.ended
    given = len(driver.device.commands)
    assert given <= 60
    assert ledger.totals().pulses == given + 60


def test_rest_power_and_session_survive_a_restart(virtual):
    limits = Limits(
        pulse_energy_j=100.0, continuous_power_w=100.0, energy_window_s=10.0, session_pulses=110
    )
    ledger = FailingLedger()
    # 30 pulses of 25 J in 1.5 s, until half a second ago
    ledger.past = [BookedPulse(-(i + 10) * SECOND // 20, 0.5, 25.0) for i in reversed(range(30))]
    driver = virtual(limits, ledger=ledger).armed()
    assert driver.controller.limiter.session_pulses == 30
    with pytest.raises(Refused, match=r'wait: expected a wait of 6 s after a train of 30 pulses'):
        driver.controller.start(constant(0.1, 1.0, 20.0))
    with pytest.raises(Refused, match='expected at most 80 more pulses in this session, got 100'):
        driver.controller.start(TRAIN)
    driver.advance(5.6)
    driver.controller.start(constant(0.1, 1.0, 20.0))


def test_pulses_of_another_device_hide_no_wait_of_this_one(virtual):
    limits = Limits(pulse_energy_j=100.0, continuous_power_w=100.0, energy_window_s=10.0)
    # 30 pulses of 25 J in 1.5 s, and a second later the patient had a weak one elsewhere
    past = [BookedPulse(-(i + 40) * SECOND // 20, 0.5, 25.0) for i in reversed(range(30))]
    past.append(BookedPulse(-SECOND, 0.1, 1.0, on_device=False))
    driver = virtual(limits, ledger=FailingLedger(past=past)).armed()
    with pytest.raises(Refused, match=r'wait: expected a wait of 6 s after a train of 30 pulses'):
        driver.controller.start(constant(0.1, 1.0, 20.0))


def test_a_rest_is_that_of_the_patient(virtual):
    limits = Limits(rest=Rest(20, 60.0))
    past = [BookedPulse(-(i + 40) * SECOND // 20, 0.5, 25.0) for i in reversed(range(30))]
    others = [pulse._replace(on_patient=False) for pulse in past]
    virtual(limits, ledger=FailingLedger(past=others)).started(constant(0.1, 0.5, 20.0))
    elsewhere = [pulse._replace(on_device=False) for pulse in past]
    driver = virtual(limits, ledger=FailingLedger(past=elsewhere)).armed()
    with pytest.raises(Refused, match='rest: expected a pause of 60 s after at most 20 pulses'):
        driver.controller.start(constant(0.1, 0.5, 20.0))


def test_the_dose_that_a_run_leaves_over_is_there_for_the_next_at_once(virtual):
    ledger = MemoryLedger(DoseLimits(pulses=30, energy_j=1e6, window_h=24.0), lambda: SECOND)
    driver = virtual(ledger=ledger).started(constant(0.3, 1.0, 20.0), 0.17)
    driver.controller.cancel()
    driver.controller.arm()
    driver.controller.start(constant(0.3, 1.0, 20.0))
    driver.advance(1.5)
    assert driver.run.cause == 'completed'


def test_a_start_knows_the_limit_of_temperature_of_the_driver(virtual):
    driver = virtual(specification='rapid2-240v', temperature_limit=22.5).armed()
    strong = Schedule((Ramp(20.0, 5.0, start=0.0, end=0.4), constant(0.4, 20.0, 20.0).segments[0]))
    with pytest.raises(Refused, match=r'coil_cutout: expected a coil of at most 22\.5 Celsius'):
        driver.controller.start(strong)


def test_a_limit_of_temperature_that_the_room_reaches_is_refused(virtual):
    with pytest.raises(
        StimulationError, match='temperature_limit: expected more than ambient, 22'
    ):
        virtual(specification='rapid2-240v', temperature_limit=20.0)


def test_a_restart_knows_how_warm_the_coil_is_and_waits_until_it_has_cooled(virtual):
    def restarted(past):
        return virtual(specification='rapid2-240v', ledger=FailingLedger(past=past))

    # a fifth of a time constant ago, 70 kJ within a second: 10 K of which 8.19 K are left
    past = [BookedPulse(-121 * SECOND + n * SECOND // 20, 1.0, 3500.0) for n in range(20)]
    warm = restarted(past).controller.coil_temperature
    assert warm == pytest.approx(22.0 + 8.19, abs=0.02)
    elsewhere = [pulse._replace(on_device=False) for pulse in past]
    assert restarted(elsewhere).controller.coil_temperature == 22.0
    driver = restarted([BookedPulse(-SECOND, 1.0, 140e3)])
    driver.controller.configure()
    driver.advance(60.0)
    with pytest.raises(Refused, match='temperature: expected at most 40 Celsius, got 40'):
        driver.controller.arm()
    driver.advance(10.0)
    driver.controller.arm()


def test_what_has_to_be_on_the_disk_is_synced_before_the_call_returns(tmp_path, monkeypatch):
    calls = []

    def noted(name, do):
        def call(file, *data):
            calls.append((name, file))
            return do(file, *data)

        monkeypatch.setattr(os, name, call)

    noted('write', os.write)
    noted('fsync', os.fsync)
    with closing(DoseLedger(tmp_path, 'device', 'P01')) as ledger:
        calls.clear()
        ledger.reserve([BookedPulse(SECOND, 0.5, 1.0)])
        device, patient = dict.fromkeys(file for _, file in calls)
        assert calls == [
            ('write', device), ('fsync', device), ('write', patient), ('fsync', patient),
        ]  # fmt: skip
    with closing(ChainedFile(tmp_path / 'audit.jsonl', AUDIT_LOG)) as log:
        calls.clear()
        log.append('arm', {})
        assert [name for name, _ in calls] == ['write', 'fsync']


def test_ledger_that_cannot_be_written_is_a_fault_and_not_asked_again_for_the_same_run(virtual):
    ledger = FailingLedger()
    driver = virtual(ledger=ledger).armed()
    ledger.broken = True
    with pytest.raises(LedgerError, match='expected a disk, got none'):
        driver.controller.start(TRAIN)
    assert driver.controller.state is State.ARMED
    assert driver.device.commands == []
    ledger.broken = False
    driver.controller.start(TRAIN)
    driver.advance(0.2)
    ledger.broken = True
    ledger.settle = ledger.reserve
    driver.advance(3.0)
    assert driver.controller.state is State.FAULT
    assert driver.controller.reason == 'expected a disk, got none'
    assert driver.controller.fault_counts() == {'ledger': 1}
    assert not driver.device.armed
    # what was reserved before
    assert len(driver.device.commands) <= 21


def test_without_a_ledger_nothing_is_armed(virtual, tmp_path):
    clocks = Clocks(lambda: SECOND, lambda: SECOND)
    with closing(DoseLedger(tmp_path, 'device', 'patient', clocks=clocks)) as ledger:
        driver = virtual(ledger=ledger)
        driver.controller.configure()
        (tmp_path / 'patient-patient.ledger').rename(tmp_path / 'away')
        with pytest.raises(LedgerError, match='expected a writable'):
            driver.controller.arm()
        (tmp_path / 'away').rename(tmp_path / 'patient-patient.ledger')
        with pytest.raises(LedgerError, match=r'a working ledger, got .*: start the driver anew'):
            driver.controller.arm()
        assert driver.controller.state is not State.ARMED


def test_a_ledger_that_is_removed_in_a_train_is_a_fault_and_ends_it(virtual, tmp_path):
    clocks = Clocks(lambda: SECOND, lambda: SECOND)
    with closing(DoseLedger(tmp_path, 'device', 'patient', clocks=clocks)) as ledger:
        driver = virtual(ledger=ledger).started(seconds=1.0)
        for path in tmp_path.glob('*.ledger'):
            path.unlink()
        driver.advance(1.0)
        assert driver.controller.state is State.FAULT
        assert 'device.ledger, got' in driver.controller.reason
        # a second was reserved ahead, half of it at a time
        assert len(driver.device.commands) <= 31
