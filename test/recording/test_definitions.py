# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Definitions of messages: the same text and hash here, in msg_defs and in generated code."""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from rpms_ros.errors import RecordingError
from rpms_ros.recording.rosbag.definitions import (
    FOLDER,
    PULSE,
    differs_from_known,
    known_types,
    types_of,
    written_definition,
)

SOURCES = Path(__file__).parents[2] / 'msg_defs' / 'msg'
NAMES = sorted(path.stem for path in SOURCES.glob('*.msg'))


def installed_share() -> Path:
    """Return where the build of rpms_msgs put its descriptions."""
    prefixes = [*filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(':')), sys.prefix]
    shares = [Path(prefix, 'share/rpms_msgs/msg') for prefix in prefixes]
    return next(share for share in shares if share.is_dir())


@pytest.mark.parametrize('name', NAMES)
def test_text_is_that_of_the_interface_package(name: str) -> None:
    assert (FOLDER / f'{name}.msg').read_bytes() == (SOURCES / f'{name}.msg').read_bytes()


@pytest.mark.parametrize('name', NAMES)
def test_hash_is_that_of_the_generated_messages(name: str) -> None:
    generated = json.loads((installed_share() / f'{name}.json').read_text())
    hashes = {entry['type_name']: entry['hash_string'] for entry in generated['type_hashes']}
    assert written_definition(f'rpms_msgs/msg/{name}')[1] == hashes[f'rpms_msgs/msg/{name}']


def test_unknown_type_without_definition_is_refused() -> None:
    with pytest.raises(
        RecordingError, match='expected a definition of lab/msg/Jaw in the recording, got'
    ):
        types_of('lab/msg/Jaw', '', 'ros2msg')


def test_definition_that_is_none_is_refused() -> None:
    with pytest.raises(RecordingError, match=r'expected a definition of .*Pulse that can be'):
        types_of(PULSE, 'float64 &', 'ros2msg')


def test_a_definition_in_idl_is_not_read_and_a_known_type_is_taken_as_known() -> None:
    assert types_of(PULSE, 'module {', 'ros2idl') is known_types()
    with pytest.raises(RecordingError, match='that can be used, got one in ros2idl'):
        types_of('lab/msg/Jaw', 'module {', 'ros2idl')


@pytest.mark.parametrize(
    ('change', 'contradicts'),
    [
        (lambda text: text, False),
        (lambda text: text.replace('float64 width\n', 'float64 width\nuint8 more\n'), True),
        (lambda text: text.replace('uint8 unverified\n', ''), False),
        (lambda text: text.replace('uint8 unverified\n', 'uint8 unverified\nfloat64 b\n'), False),
        (lambda text: text.replace('float64 width', 'int64 width'), True),
        (lambda text: text.replace('float64 width', 'float64 height'), True),
    ],
)
def test_a_definition_of_another_version_contradicts_nothing(
    change: Callable[[str], str], contradicts: bool
) -> None:
    types = types_of(PULSE, change(written_definition(PULSE)[0]), 'ros2msg')
    assert differs_from_known(PULSE, types) is contradicts


CALCULATED = 'module rpms_msgs { module msg { const double X = ((1)); }; };'
DEEP = f'module a {{ struct C {{ {"sequence<" * 9}double{">" * 9} x; }}; }};'
OF_ITSELF = f'rpms_msgs/Pulse p\n{"=" * 80}\nMSG: rpms_msgs/Pulse\nrpms_msgs/Pulse p\n'


@pytest.mark.parametrize(
    ('text', 'encoding', 'found'),
    [
        (OF_ITSELF, 'ros2msg', '(more than 30 levels|maximum recursion)'),
        ('geometry_msgs/Wrench w\n', 'ros2msg', 'no geometry_msgs/msg/Wrench among'),
        ('#' * 600_000, 'ros2msg', '600000 characters'),
    ],
)
def test_definition_that_would_take_too_long_is_refused(
    text: str, encoding: str, found: str
) -> None:
    with pytest.raises(RecordingError, match=f'expected a definition of .* used, got {found}'):
        types_of(PULSE, text, encoding)
