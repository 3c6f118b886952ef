# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stop buttons: unknown, silent or pressed stands against pulses; the newest of each counts."""

import pytest
from hypothesis import given, strategies as st

from rpms_ros.stimulation.driver.stop_buttons import UNCOUNTED, ButtonState, StopButtons

A, B = b'a', b'b'
LATER_NS = 300_000_001


def test_without_a_button_no_pulse_is_possible() -> None:
    assert StopButtons(0.3).problem(0) == (
        'expected a stop button that says its state at a rate, got none'
    )
    assert StopButtons(0.3, required=False).problem(0) is None


def test_a_button_that_is_there_and_says_nothing_counts() -> None:
    buttons = StopButtons(0.3, required=False)
    buttons.present({A: '/desk'})
    assert buttons.problem(0) == 'expected every stop button to speak, got 1 still unknown'
    assert buttons.states(0) == [('/desk', ButtonState.UNKNOWN)]
    # known from its first word on, whenever the graph is looked at again
    buttons.heard(A, 1, False, 0)
    assert buttons.problem(0) is None
    buttons.present({A: '/desk'})
    assert buttons.problem(0) is None


def test_silence_counts_as_pressed() -> None:
    buttons = StopButtons(0.3)
    buttons.heard(A, 1, False, 0)
    assert buttons.problem(LATER_NS - 1) is None
    assert buttons.problem(LATER_NS) == (
        'expected stop button 61 to say its state every 0.3 s, got silence for 0.3 s'
    )
    assert buttons.states(LATER_NS) == [('61', ButtonState.SILENT)]


def test_a_press_counts_that_is_released_before_anybody_looks() -> None:
    buttons = StopButtons(0.3)
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


def test_a_press_counts_once_in_whatever_order_its_copies_come() -> None:
    buttons = StopButtons(0.3)
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


def test_each_press_counts_where_the_middleware_does_not_count_messages() -> None:
    buttons = StopButtons(0.3)
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


def test_a_press_that_was_over_before_anybody_listened_is_none() -> None:
    buttons = StopButtons(0.3)
    buttons.heard(A, 1, True, 0, kept=True)
    buttons.heard(A, 2, False, 0, kept=True)
    buttons.heard(A, 3, False, 0)
    assert buttons.taken_press() == ''
    assert buttons.problem(0) is None


def test_a_state_that_was_kept_is_no_sign_of_life() -> None:
    buttons = StopButtons(0.3)
    buttons.heard(A, 1, False, 0, kept=True)
    assert buttons.problem(0) == 'expected stop button 61 to say its state, got nothing yet'
    buttons.heard(A, 2, True, 0, kept=True)
    assert buttons.problem(0) == 'emergency stop is pressed (61)'
    buttons.heard(A, 3, False, 0)
    assert buttons.problem(0) is None


def test_messages_that_may_be_lost_stand_against_pulses_until_reset() -> None:
    buttons = StopButtons(0.3)
    buttons.heard(A, 1, False, 0)
    buttons.overrun('too many')
    assert buttons.problem(0) == 'too many'
    buttons.present({A: '/desk'})
    buttons.forget_gone()
    assert buttons.problem(0) is None


def test_a_reset_lets_go_of_a_button_that_is_gone_but_not_of_a_pressed_one() -> None:
    buttons = StopButtons(0.3)
    buttons.heard(A, 1, False, 0)
    buttons.heard(B, 1, False, LATER_NS)
    buttons.present({B: '/hand'})
    assert buttons.problem(LATER_NS) is not None
    buttons.forget_gone()
    assert buttons.problem(LATER_NS) is None
    buttons.heard(A, 2, True, LATER_NS)
    buttons.forget_gone()
    assert buttons.problem(LATER_NS) == 'emergency stop is pressed (61)'
    buttons.clear()
    assert buttons.problem(LATER_NS) is not None


def test_a_button_that_came_as_another_one_went_has_to_speak_after_a_reset() -> None:
    buttons = StopButtons(0.3)
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


def test_a_button_that_must_be_present_is_not_forgotten() -> None:
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
def test_a_button_that_must_be_present_is_known_by_its_node(
    name: str, node: str, found: bool
) -> None:
    buttons = StopButtons(0.3, required=False, names=(name,))
    buttons.heard(A, 1, False, 0)
    buttons.present({A: node})
    assert (buttons.problem(0) is None) == found


said = st.tuples(st.sampled_from([A, B, b'c']), st.integers(0, 20), st.booleans(), st.booleans())


@given(st.lists(said, max_size=40))
def test_the_newest_of_each_counts_in_whatever_order_they_come(
    messages: list[tuple[bytes, int, bool, bool]],
) -> None:
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
