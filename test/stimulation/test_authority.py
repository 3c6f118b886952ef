# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One operator, by a token, in two steps, with heartbeats and a held enable."""

import pytest

from rpms_ros.stimulation.driver.authority import Authority, Beat
from rpms_ros.stimulation.driver.safety_monitor import Refused

SECOND = 1_000_000_000
DAY = 86_400 * SECOND


class Operator:
    """Beats for an authority, with a clock of its own that is off by a day."""

    def __init__(self, authority: Authority, name: str = 'ada', source: bytes = b'a') -> None:
        self.authority, self.name, self.source = authority, name, source
        self.token, self.offset_ns = '', DAY

    def request(self, now_ns: int = 0) -> 'Operator':
        self.token = self.authority.request(self.name, now_ns)
        return self

    def beat(self, now_ns: int, enable: bool = True, sent_ns: int | None = None) -> str | None:
        stamp_ns = (now_ns if sent_ns is None else sent_ns) + self.offset_ns
        beat = Beat(self.token, stamp_ns, enable, self.source)
        return self.authority.beat(beat, now_ns)

    def confirm(self, now_ns: int) -> None:
        self.authority.confirm(self.name, self.token, now_ns)


@pytest.fixture
def authority() -> Authority:
    return Authority(0.5, valid_s=10.0)


def test_two_steps_arm(authority: Authority) -> None:
    ada = Operator(authority).request()
    assert authority.operator == 'ada'
    with pytest.raises(Refused, match='expected a heartbeat of ada, got none yet'):
        ada.confirm(0)
    assert ada.beat(1, enable=False) is None
    with pytest.raises(Refused, match='expected ada to hold the enable, got it released'):
        ada.confirm(1)
    with pytest.raises(Refused, match='expected ada to have armed, got no confirmation'):
        authority.require('ada', ada.token)
    assert ada.beat(2) is None
    ada.confirm(2)
    assert authority.confirmed
    assert authority.enabled
    authority.require('ada', ada.token)


def test_nobody_else_arms_or_starts(authority: Authority) -> None:
    ada = Operator(authority).request()
    eve = Operator(authority, 'eve', b'e')
    with pytest.raises(Refused, match='expected no other operator, got ada'):
        eve.request(SECOND)
    ada.beat(1)
    ada.confirm(1)
    with pytest.raises(Refused, match='expected no other operator, got ada'):
        ada.request(20 * SECOND)
    for name, token in (('eve', ada.token), ('ada', ''), ('ada', '\ud800'), ('ada', 'x')):
        with pytest.raises(Refused, match='expected operator and token: that of ada, got another'):
            authority.require(name, token)
    authority.release()
    with pytest.raises(Refused, match='token: one that was asked for, got another one'):
        authority.require('ada', ada.token)
    with pytest.raises(Refused, match='expected operator and token'):
        authority.require('', '')
    assert eve.request(21 * SECOND).token


def test_a_request_that_nobody_confirms_runs_out(authority: Authority) -> None:
    ada = Operator(authority).request()
    late = 10 * SECOND + 1
    ada.beat(late)
    with pytest.raises(Refused, match='expected the confirmation within 10 s of the request'):
        ada.confirm(late)
    assert Operator(authority, 'eve').request(late).token
    with pytest.raises(Refused, match='expected operator and token: that of eve'):
        ada.confirm(late)


@pytest.mark.parametrize('name', ['', '  ', 'x' * 65, 'a\nb', '\x00', 'ada\0', 'ada\n', '\x1fada'])
def test_a_name_is_a_name(authority: Authority, name: str) -> None:
    with pytest.raises(Refused, match='expected a name of 1 to 64 printable characters, got'):
        authority.request(name, 0)


def test_heartbeat_and_enable_keep_it_armed(authority: Authority) -> None:
    ada = Operator(authority).request()
    ada.beat(0)
    ada.confirm(0)
    assert authority.problem(SECOND // 2) is None
    assert authority.problem(SECOND // 2 + 1) == (
        'expected a heartbeat of ada within 0.5 s, got none for 0.5 s'
    )
    assert ada.beat(SECOND, enable=False) is None
    assert authority.problem(SECOND) == 'expected ada to hold the enable, got it released'
    # held again before anybody looked: it was released all the same
    assert ada.beat(SECOND + 1) is None
    assert authority.problem(SECOND + 1) == 'expected ada to hold the enable, got it released'
    authority.release()
    ada.request()
    ada.beat(SECOND + 2)
    ada.confirm(SECOND + 2)
    assert authority.problem(SECOND + 2) is None


def test_a_stranger_does_not_keep_it_armed(authority: Authority) -> None:
    ada = Operator(authority).request()
    ada.beat(0)
    ada.confirm(0)
    eve = Operator(authority, 'ada', b'e')
    eve.token = 'x'
    assert eve.beat(SECOND) == (
        'expected a heartbeat with the token of the operator, got another one'
    )
    assert authority.problem(SECOND) is not None


def test_two_processes_with_one_token_are_one_too_many(authority: Authority) -> None:
    ada = Operator(authority).request()
    ada.beat(0)
    ada.confirm(0)
    eve = Operator(authority, 'ada', b'e')
    eve.token = ada.token
    eve.beat(1)
    assert authority.problem(1) == 'expected one process with this token, got heartbeats of two'


def test_a_heartbeat_that_repeats_or_lags_does_not_count(authority: Authority) -> None:
    ada = Operator(authority).request()
    ada.beat(0)
    assert ada.beat(SECOND, sent_ns=0) == (
        'expected a heartbeat after the last one, got one that repeats or goes back'
    )
    assert ada.beat(2 * SECOND, sent_ns=SECOND) == (
        'expected a heartbeat of at most 0.5 s ago, got one of 1 s'
    )
    assert ada.beat(2 * SECOND) is None


def test_a_clock_that_was_set_back_locks_nobody_out(authority: Authority) -> None:
    ada = Operator(authority).request()
    ada.beat(0)
    ada.offset_ns = 0
    assert ada.beat(SECOND) is not None
    # a new request starts afresh
    ada.request(SECOND)
    assert ada.beat(SECOND + 1) is None
    ada.confirm(SECOND + 1)


def test_what_is_known_of_an_operator_ends_with_the_token(authority: Authority) -> None:
    known = [authority.generation]
    ada = Operator(authority).request()
    known.append(authority.generation)
    ada.beat(0)
    ada.confirm(0)
    assert authority.generation == known[-1]
    authority.release()
    known.append(authority.generation)
    ada.request(SECOND)
    known.append(authority.generation)
    # somebody else after the time of this token, and without a release
    Operator(authority, 'bob', b'b').request(12 * SECOND)
    known.append(authority.generation)
    assert known == sorted(set(known))
