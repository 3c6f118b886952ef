# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames of the Rapid2 class: what is taken for an answer, and what is not."""

import pytest
from hypothesis import given, strategies as st

from rpms_ros.guard import rapid2
from rpms_ros.guard.rapid2 import framed

HELD = rapid2.REMOTE | rapid2.COIL_PRESENT


def test_published_frames_have_their_published_check_bytes():
    assert framed(b'@050') == b'@050\x2a'
    assert framed(b'X@') == b'X@\x67'
    assert framed(b'Q@') == b'Q@n'


def test_answer_has_status_and_data():
    answer = rapid2.parsed(b'EH', framed(b'E' + bytes([HELD | rapid2.READY])), 3)
    assert answer == (HELD | rapid2.READY, b'')
    assert rapid2.parsed(b'F@', framed(b'F' + bytes([HELD]) + b'253251'), 9).data == b'253251'


@pytest.mark.parametrize('command', [b'EH', b'@020', b'F@', b'\\@', b'Q@'])
@pytest.mark.parametrize(('letter', 'why'), [(b'S', 'does not suit'), (b'?', 'does not accept')])
def test_a_refusal_is_never_a_status(command, letter, why):
    # both letters have the bit of an armed device
    assert letter[0] & rapid2.ARMED
    refusal = framed(command[:1] + letter)
    for length in (3, 9, 22, rapid2.UNTIL_ZERO):
        assert rapid2.complete(refusal, length)
    with pytest.raises(ValueError, match=f'expected the instrument to obey .*{why}'):
        rapid2.parsed(command, refusal, 3)
    # not even where its check byte is wrong, or it is cut
    for broken in (refusal[:2] + b'\0', refusal[:2]):
        with pytest.raises(ValueError, match='expected'):
            rapid2.parsed(command, broken, 3)


def test_status_without_remote_control_or_against_itself():
    with pytest.raises(ValueError, match='expected remote control, got status 0x08 to EH'):
        rapid2.parsed(b'EH', framed(b'E' + bytes([rapid2.COIL_PRESENT])), 3)
    both = HELD | rapid2.STANDBY | rapid2.READY
    with pytest.raises(ValueError, match='expected standby or armed, got both'):
        rapid2.parsed(b'EH', framed(b'E' + bytes([both])), 3)


@given(st.binary(max_size=12))
def test_any_bytes_are_an_answer_or_an_error(raw):
    # as many bytes as there are, so that the length alone does not refuse them
    sound = len(raw) >= 3 and raw[:1] == b'E' and framed(raw[:-1]) == raw
    held = sound and raw[1] & rapid2.REMOTE
    if held and not (raw[1] & rapid2.STANDBY and raw[1] & (rapid2.ARMED | rapid2.READY)):
        assert rapid2.parsed(b'EH', raw, len(raw)) == (raw[1], raw[2:-1])
    else:
        with pytest.raises(ValueError, match='expected'):
            rapid2.parsed(b'EH', raw, len(raw))


@pytest.mark.parametrize(
    'frame',
    [
        b'',
        b'E',
        b'EH',
        b'EH\x00',
        framed(b'b@'),
        framed(b'R@'),
        framed(b'[010'),
        framed(b'@101'),
        framed(b'@9'),
    ],
)
def test_frames_that_no_driver_has_use_for(frame):
    assert rapid2.command_of(frame) is None


def test_every_percent_is_a_command_and_nothing_else_is():
    for percent in range(101):
        assert rapid2.percent_of(rapid2.power(percent)) == percent
        assert rapid2.command_of(framed(rapid2.power(percent))) == rapid2.power(percent)
    for none in (b'@101', b'@1 0', b'@+10', b'@-01', b'A050', '@٠٥٠'.encode()):
        assert rapid2.percent_of(none) is None
    with pytest.raises(ValueError, match=r'expected an intensity in 0\.\.100 percent, got 101'):
        rapid2.power(101)


@pytest.mark.parametrize(
    ('text', 'major', 'length'),
    [(b'5.0.0', 5, 21), (b'7.1', 7, 22), (b' 9.0.1', 9, 24), (b'11.0.0', 11, 24)],
)
def test_version_says_how_long_the_parameters_are(text, major, length):
    assert rapid2.version_of(framed(b'N' + text + b'\0')) == major
    assert rapid2.parameters_length(major) == length


@pytest.mark.parametrize('answer', [b'', b'N', framed(b'Nabc\0'), framed(b'N\0'), b'N7.1\0\0'])
def test_what_is_no_version(answer):
    with pytest.raises(ValueError, match='expected a version'):
        rapid2.version_of(answer)


def test_numbers_in_the_data():
    assert rapid2.set_percent(b'\x38040001000100100001') == 40
    assert rapid2.celsius(b'253401') == 40.1
    with pytest.raises(ValueError, match='expected an intensity in percent, got'):
        rapid2.set_percent(b'\x38 40')
    with pytest.raises(ValueError, match='expected two temperatures in tenths of a degree, got'):
        rapid2.celsius(b'25325x')
