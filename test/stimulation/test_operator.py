# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One operator, by a token, in two steps; stop buttons, of which one is enough to stop."""

import pytest
from hypothesis import given, strategies as st

from rpms_ros.stimulation.driver.authority import Authority, Beat
from rpms_ros.stimulation.driver.safety_monitor import Refused
from rpms_ros.stimulation.driver.stop_buttons import UNCOUNTED, ButtonState, StopButtons

SECOND = 1_000_000_000
A, B = b'a', b'b'
LATER_NS = 300_000_001
DAY = 86_400 * SECOND
said = st.tuples(st.sampled_from([A, B, b'c']), st.integers(0, 20), st.booleans(), st.booleans())


class Operator:
    """Beats for an authority, with a clock of its own that is off by a day."""

    def __init__(self, authority, name='ada', source=b'a'):
        self.authority, self.name, self.source = authority, name, source
        self.token, self.offset_ns = '', DAY

    def request(self, now_ns=0):
        self.token = self.authority.request(self.name, now_ns)
        return self

    def beat(self, now_ns, enable=True, sent_ns=None):
        stamp_ns = (now_ns if sent_ns is None else sent_ns) + self.offset_ns
        beat = Beat(self.token, stamp_ns, enable, self.source)
        return self.authority.beat(beat, now_ns)

    def confirm(self, now_ns):
        self.authority.confirm(self.name, self.token, now_ns)

    def arm(self, now_ns=0):
        self.beat(now_ns)
        self.confirm(now_ns)


@pytest.fixture
def authority():
    return Authority(0.5, valid_s=10.0)


@pytest.fixture
def ada(authority):
    """An operator who has asked for a token."""
    return Operator(authority).request()


@pytest.fixture
def buttons():
    return StopButtons(0.3)


def test_two_steps_arm(authority, ada):
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


def test_nobody_else_arms_or_starts(authority, ada):
    eve = Operator(authority, 'eve', b'e')
    with pytest.raises(Refused, match='expected no other operator, got ada'):
        eve.request(SECOND)
    ada.arm(1)
    with pytest.raises(Refused, match='expected no other operator, got ada'):
        ada.request(20 * SECOND)
    for name, token in (('eve', ada.token), ('ada', ''), ('ada', '\ud800'), ('ada', 'x')):
        with pytest.raises(Refused, match='expected operator and token: that of ada, got another'):
            authority.require(name, token)
    authority.release()
    for name, token in (('ada', ada.token), ('', '')):
        with pytest.raises(Refused, match='token: one that was asked for, got another one'):
            authority.require(name, token)
    assert eve.request(21 * SECOND).token


def test_a_request_that_nobody_confirms_runs_out(authority, ada):
    late = 10 * SECOND + 1
    ada.beat(late)
    with pytest.raises(Refused, match='expected the confirmation within 10 s of the request'):
        ada.confirm(late)
    assert Operator(authority, 'eve').request(late).token
    with pytest.raises(Refused, match='expected operator and token: that of eve'):
        ada.confirm(late)


@pytest.mark.parametrize('name', ['', '  ', 'x' * 65, 'a\nb', '\x00', 'ada\0', 'ada\n', '\x1fada'])
def test_a_name_is_a_name(authority, name):
    with pytest.raises(Refused, match='expected a name of 1 to 64 printable characters, got'):
        authority.request(name, 0)


def test_heartbeat_and_enable_keep_it_armed(authority, ada):
    ada.arm()
    assert authority.problem(SECOND // 2) is None
    # a stranger does not
    stranger = 'expected a heartbeat with the token of the operator, got another one'
    assert Operator(authority, 'ada', b'e').beat(SECOND // 2) == stranger
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
    ada.arm(SECOND + 2)
    assert authority.problem(SECOND + 2) is None


def test_a_released_enable_is_at_no_moment_shown_as_held(authority, ada, monkeypatch):
    ada.arm()
    assert not authority.released_enable(0)
    ada.beat(1, enable=False)
    shown = []

    def looked_at(seconds):
        # as by the thread that publishes the status
        shown.append(authority.enabled)
        return round(seconds * SECOND)

    monkeypatch.setattr('rpms_ros.stimulation.driver.authority.nanoseconds', looked_at)
    assert authority.released_enable(1)
    assert not authority.released_enable(SECOND)
    assert set(shown) == {False}


def test_a_heartbeat_that_repeats_or_lags_does_not_count(ada):
    ada.beat(0)
    repeats = 'expected a heartbeat after the last one, got one that repeats or goes back'
    assert ada.beat(SECOND, sent_ns=0) == repeats
    assert ada.beat(2 * SECOND, sent_ns=SECOND) == (
        'expected a heartbeat of at most 0.5 s ago, got one of 1 s'
    )
    assert ada.beat(2 * SECOND) is None
    # a clock that was set back locks nobody out: a new request starts afresh
    ada.offset_ns = 0
    assert ada.beat(3 * SECOND) == repeats
    ada.request(3 * SECOND)
    ada.arm(3 * SECOND + 1)


def test_a_press_counts_that_is_released_before_anybody_looks(buttons):
    buttons.present({A: '/hand'})
    buttons.heard(A, 1, False, 0)
    assert buttons.taken_press() == ''
    buttons.heard(A, 2, True, 0)
    buttons.heard(A, 3, False, 0)
    assert not buttons.pressed
    assert buttons.taken_press() == 'emergency stop is pressed (/hand)'
    assert buttons.taken_press() == ''
    # held: one press
    for sequence in range(4, 10):
        buttons.heard(A, sequence, True, 0)
        assert bool(buttons.taken_press()) == (sequence == 4)


def test_a_press_counts_once_in_whatever_order_its_copies_come(buttons):
    # a button that is new: its first words come by both ways, the kept ones first
    for kept in (True, False):
        buttons.heard(A, 1, True, 0, kept)
        buttons.heard(A, 2, False, 0, kept)
    assert buttons.taken_press()
    # heard by one way only
    buttons.heard(A, 3, True, 0, kept=True)
    buttons.heard(A, 4, False, 0, kept=True)
    assert buttons.taken_press()
    buttons.heard(A, 3, True, 0)
    assert buttons.taken_press() == ''


def test_each_press_counts_where_the_middleware_does_not_count_messages(buttons):
    for _ in range(3):
        # the copies that are kept for those who come late are read first
        for kept in (True, False):
            buttons.heard(A, UNCOUNTED, True, 0, kept)
            buttons.heard(A, UNCOUNTED, False, 0, kept)
        assert buttons.taken_press()
        assert buttons.taken_press() == ''
    for first in (True, False, False):
        buttons.heard(A, UNCOUNTED, True, 0)
        assert bool(buttons.taken_press()) == first


def test_a_state_that_was_kept_is_no_sign_of_life_and_no_press_if_it_is_over(buttons):
    buttons.heard(A, 1, False, 0, kept=True)
    assert buttons.problem(0) == 'expected stop button 61 to say its state, got nothing yet'
    buttons.heard(A, 2, True, 0, kept=True)
    assert buttons.problem(0) == 'emergency stop is pressed (61)'
    buttons.heard(A, 3, False, 0, kept=True)
    buttons.heard(A, 4, False, 0)
    assert buttons.taken_press() == ''
    assert buttons.problem(0) is None


def test_a_reset_lets_go_of_a_button_that_is_gone_but_not_of_a_pressed_one(buttons):
    buttons.heard(A, 1, False, 0)
    buttons.heard(B, 1, False, LATER_NS)
    buttons.present({B: '/hand'})
    assert 'got silence' in buttons.problem(LATER_NS)
    # messages that may be lost stand against pulses until then, too
    buttons.overrun('too many')
    assert buttons.problem(LATER_NS) == 'too many'
    buttons.forget_gone()
    assert buttons.problem(LATER_NS) is None
    buttons.heard(A, 2, True, LATER_NS)
    buttons.forget_gone()
    assert buttons.problem(LATER_NS) == 'emergency stop is pressed (61)'
    buttons.clear()
    assert buttons.problem(LATER_NS) is not None


def test_a_button_that_came_as_another_one_went_has_to_speak_after_a_reset(buttons):
    buttons.heard(A, 1, False, 0)
    buttons.heard(B, 1, False, LATER_NS)
    # one has gone, and one has come and is silent: as many as are known
    buttons.present({B: '/hand', b'c': '/wall'})
    buttons.forget_gone()
    assert buttons.problem(LATER_NS) == (
        'expected every stop button to speak, got 1 still unknown'
    )
    assert buttons.states(LATER_NS) == [
        ('/hand', ButtonState.RELEASED),
        ('/wall', ButtonState.UNKNOWN),
    ]


def test_a_button_that_must_be_present_is_not_forgotten():
    buttons = StopButtons(0.3, names=('foot',))
    absent = 'expected stop button foot on the graph, speaking and released, got none'
    buttons.heard(B, 1, False, 0)
    buttons.present({B: '/console'})
    assert buttons.problem(0) == absent
    # it has spoken, and is not known by its name yet
    buttons.heard(A, 1, False, 0)
    assert buttons.problem(0) == absent
    buttons.present({A: '/left/foot', B: '/console'})
    assert buttons.problem(0) is None
    # gone: before its silence is too long, after it, and after a reset
    buttons.present({B: '/console'})
    assert buttons.problem(0) == absent
    buttons.heard(B, 2, False, LATER_NS)
    assert 'got silence' in str(buttons.problem(LATER_NS))
    buttons.forget_gone()
    assert buttons.problem(LATER_NS) == absent
    buttons.clear()
    buttons.heard(B, 3, False, LATER_NS)
    buttons.present({B: '/console'})
    assert buttons.problem(LATER_NS) == absent


@pytest.mark.parametrize(
    ('name', 'node', 'found'),
    [
        ('/foot', '/foot', True),
        ('foot', '/foot', True),
        ('foot', '/left/foot', True),
        ('/foot', '/left/foot', False),
        ('foot', '/barefoot', False),
        ('left', '/left/foot', False),
    ],
)
def test_a_button_that_must_be_present_is_known_by_its_node(name, node, found):
    buttons = StopButtons(0.3, required=False, names=(name,))
    buttons.heard(A, 1, False, 0)
    buttons.present({A: node})
    assert (buttons.problem(0) is None) == found


@given(st.lists(said, max_size=40))
def test_the_newest_of_each_counts_in_whatever_order_they_come(messages):
    # what a publisher says under one number is one thing
    messages = [(who, count, (count + who[0]) % 3 == 0, kept) for who, count, _, kept in messages]
    buttons = StopButtons(0.3, required=False)
    for who, number, pressed, kept in messages:
        buttons.heard(who, number, pressed, 0, kept)
    newest = {
        who: max((number, pressed) for other, number, pressed, _ in messages if other == who)[1]
        for who, *_ in messages
    }
    assert buttons.pressed == any(newest.values())
    states = dict(buttons.states(0))
    for who, pressed in newest.items():
        assert (states[who.hex()] is ButtonState.PRESSED) == pressed
    if buttons.problem(0) is None:
        assert all(state is ButtonState.RELEASED for state in states.values())
