# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What users of the Rapid2 class have published about its serial line.

A frame is a command letter, its data and a check byte: the complement of the sum of the bytes
before it.  The instrument echoes the letter, adds its status and its data, and a check byte.
9600 baud, 8 data bits, no parity.  The status is that *before* the command, but for `Q` and `R`.

A refusal has a letter where the status would be: ``?`` for data that it does not accept, ``S`` for
a command that does not suit its state; a lone ``?`` says that it does not know the command.  Both
letters, read as a status, mean standby and armed at once without remote control.  That no status
can be while remote control is held, so the two cannot be taken for one another.

Sources: MagPy (N. McNair, github.com/nicolasmcnair/magpy), MAGIC (N. Saatlou et al.,
github.com/nigelrogasch/MAGIC); facts only.
"""

from typing import NamedTuple

BAUD = 9600
# start bit, eight data bits, stop bit
BYTE_S = 10 / BAUD

STANDBY = 0x01
ARMED = 0x02
READY = 0x04
COIL_PRESENT = 0x08
REPLACE_COIL = 0x10
ERROR = 0x20
REMOTE = 0x80

ENABLE, RELEASE = b'Q@', b'R@'
DISARM, ARM, TRIGGER = b'EA', b'EB', b'EH'
TEMPERATURE, PARAMETERS, VERSION = b'F@', b'\\@', b'ND'

STATUS_LENGTH = 3
TEMPERATURE_LENGTH = 9
UNTIL_ZERO = 0
"""Length of an answer that ends with a zero byte and a check byte."""
LONGEST_ANSWER = 32
# remote control is given back by the guard, when it has disarmed
_PLAIN = frozenset({ENABLE, DISARM, ARM, TRIGGER, TEMPERATURE, PARAMETERS, VERSION})
_REFUSALS = {
    ord('?'): 'data that it does not accept',
    ord('S'): 'a command that does not suit its state',
}


class Answer(NamedTuple):
    """A checked answer.

    Attributes
    ----------
    status : int
        Bits of the instrument's status.
    data : bytes
        What stands between status and check byte.
    """

    status: int
    data: bytes


def framed(body: bytes) -> bytes:
    """Return a frame: the body and its check byte."""
    return body + bytes([~sum(body) & 0xFF])


def power(percent: int) -> bytes:
    """Return the command that sets an intensity in whole percent."""
    if not 0 <= percent <= 100:
        raise ValueError(f'expected an intensity in 0..100 percent, got {percent}')
    return b'@%03d' % percent


SILENCE = framed(power(0)) + framed(DISARM)
"""Intensity zero, then disarmed."""


def percent_of(command: bytes) -> int | None:
    """Return the intensity [percent] that a command sets, None if it is another command."""
    digits = command[1:]
    if command[:1] != b'@' or len(digits) != 3 or not digits.isdigit():
        return None
    percent = int(digits)
    return percent if percent <= 100 else None


def command_of(frame: bytes) -> bytes | None:
    """Return the command in a frame, None unless it is one that a driver has use for."""
    command = frame[:-1]
    if framed(command) != frame:
        return None
    return command if command in _PLAIN or percent_of(command) is not None else None


def complete(answer: bytes, length: int) -> bool:
    """Whether these bytes are a whole answer of so many bytes, or a whole refusal."""
    if answer[:1] == b'?':
        return True
    refused = len(answer) >= STATUS_LENGTH and answer[1] in _REFUSALS
    if length != UNTIL_ZERO:
        return refused or len(answer) >= length
    refused = refused and len(answer) == STATUS_LENGTH
    return refused or answer[-2:-1] == b'\0' or len(answer) >= LONGEST_ANSWER


def wire_s(byte_count: int) -> float:
    """Return how long so many bytes are on the line [s]."""
    return byte_count * BYTE_S


def parsed(command: bytes, answer: bytes, length: int) -> Answer:
    """Return the answer to a command.

    Raises
    ------
    ValueError
        If it is a refusal, of another length, to another command, has a check byte that does not
        fit or a status that contradicts itself or does not show remote control.
    """
    name = command.decode('latin-1')
    _refuse_refusal(command, answer)
    if len(answer) != length or answer[:1] != command[:1] or framed(answer[:-1]) != answer:
        raise ValueError(
            f'expected {length} bytes that begin with {command[:1]!r} and a check byte that fits '
            f'to {name}, got {answer!r}'
        )
    status = answer[1]
    if not status & REMOTE:
        raise ValueError(f'expected remote control, got status {status:#04x} to {name}')
    if status & STANDBY and status & (ARMED | READY):
        raise ValueError(f'expected standby or armed, got both in status {status:#04x} to {name}')
    return Answer(status, answer[2:-1])


def version_of(answer: bytes) -> int:
    """Return the major version of an instrument's software from its answer to `VERSION`.

    Raises
    ------
    ValueError
        If it is no version.
    """
    _refuse_refusal(VERSION, answer)
    if answer[:1] != b'N' or framed(answer[:-1]) != answer or answer[-2:-1] != b'\0':
        raise ValueError(f'expected a version and a check byte that fits, got {answer!r}')
    major = answer[1:-2].strip().split(b'.')[0]
    if not major.isdigit() or len(major) > 3:
        raise ValueError(f'expected a version such as 7.1.0, got {answer!r}')
    return int(major)


def parameters_length(major_version: int) -> int:
    """Return the length of the answer to `PARAMETERS`, which grew with the software's version."""
    if major_version >= 9:
        return 24
    return 22 if major_version >= 7 else 21


def set_percent(data: bytes) -> int:
    """Return the intensity that is set [percent] from the data of an answer to `PARAMETERS`.

    Raises
    ------
    ValueError
        If it is no number.
    """
    # one byte of status of repetitive mode stands before it
    digits = data[1:4]
    if not digits.isdigit():
        raise ValueError(f'expected an intensity in percent, got {digits!r}')
    return int(digits)


def celsius(data: bytes) -> float:
    """Return the higher of two coil temperatures from the data of an answer to `TEMPERATURE`.

    Raises
    ------
    ValueError
        If they are no numbers.
    """
    if not data.isdigit() or len(data) != 6:
        raise ValueError(f'expected two temperatures in tenths of a degree, got {data!r}')
    return max(int(data[:3]), int(data[3:])) / 10


def _refuse_refusal(command: bytes, answer: bytes) -> None:
    name = command.decode('latin-1')
    if answer[:1] == b'?':
        raise ValueError(f'expected the instrument to obey {name}, got ?: it does not know it')
    if len(answer) == STATUS_LENGTH and answer[1] in _REFUSALS and framed(answer[:-1]) == answer:
        fault = f'expected the instrument to obey {name}'
        raise ValueError(f'{fault}, got {chr(answer[1])}: {_REFUSALS[answer[1]]}')
