# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Definitions of messages, and messages read and written many at once: the same as one by one."""

import json
import os
import sys
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from rosbags.serde import SerdeError

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording.rosbag.definitions import (
    FOLDER,
    PULSE,
    differs_from_known,
    known_types,
    types_of,
    written_definition,
)
from rpms_ros.recording.rosbag.records import Channel, Records
from rpms_ros.recording.rosbag.topic_reading import Decoder
from rpms_ros.recording.rosbag.writing import encode_forces, encode_pulses

SOURCES = Path(__file__).parents[2] / 'msg_defs' / 'msg'
NAMES = sorted(path.stem for path in SOURCES.glob('*.msg'))


def installed_share():
    """Return where the build of rpms_msgs put its descriptions."""
    prefixes = [*filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(':')), sys.prefix]
    shares = [Path(prefix, 'share/rpms_msgs/msg') for prefix in prefixes]
    return next(share for share in shares if share.is_dir())


@pytest.mark.parametrize('name', NAMES)
def test_text_and_hash_are_those_of_the_interface_package(name):
    assert (FOLDER / f'{name}.msg').read_bytes() == (SOURCES / f'{name}.msg').read_bytes()
    generated = json.loads((installed_share() / f'{name}.json').read_text())
    hashes = {entry['type_name']: entry['hash_string'] for entry in generated['type_hashes']}
    assert written_definition(f'rpms_msgs/msg/{name}')[1] == hashes[f'rpms_msgs/msg/{name}']


def test_a_definition_in_idl_is_not_read_and_a_known_type_is_taken_as_known():
    assert types_of(PULSE, 'module {', 'ros2idl') is known_types()
    for text, found in (('', 'in the recording, got'), ('module {', 'used, got one in ros2idl')):
        with pytest.raises(RecordingError, match=f'a definition of lab/msg/Jaw .*{found}'):
            types_of('lab/msg/Jaw', text, 'ros2idl')


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
def test_a_definition_of_another_version_contradicts_nothing(change, contradicts):
    types = types_of(PULSE, change(written_definition(PULSE)[0]), 'ros2msg')
    assert differs_from_known(PULSE, types) is contradicts


OF_ITSELF = f'rpms_msgs/Pulse p\n{"=" * 80}\nMSG: rpms_msgs/Pulse\nrpms_msgs/Pulse p\n'


@pytest.mark.parametrize(
    ('text', 'encoding', 'found'),
    [
        (OF_ITSELF, 'ros2msg', '(more than 30 levels|maximum recursion)'),
        ('geometry_msgs/Wrench w\n', 'ros2msg', 'no geometry_msgs/msg/Wrench among'),
        ('#' * 600_000, 'ros2msg', '600000 characters'),
        ('float64 &', 'ros2msg', ''),
    ],
)
def test_definition_that_is_none_or_would_take_too_long_is_refused(text, encoding, found):
    with pytest.raises(RecordingError, match=f'expected a definition of .* used, got {found}'):
        types_of(PULSE, text, encoding)


STORE = known_types()
STAMP = ('header.stamp.sec', 'header.stamp.nanosec')
PULSE_PATHS = (*STAMP, 'sequence', 'intensity', 'width')

frame_ids = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=9)
seconds = st.integers(-(2**31), 2**31 - 1)
nanoseconds = st.integers(0, 999_999_999)
doubles = st.floats(width=64)


@st.composite
def pulse_messages(draw):
    types = STORE.types
    time = types['builtin_interfaces/msg/Time'](draw(seconds), draw(nanoseconds))
    header = types['std_msgs/msg/Header'](time, draw(frame_ids))
    fields = draw(st.integers(0, 2**32 - 1)), draw(doubles), draw(doubles)
    return types[PULSE](header, *fields, draw(st.integers(0, 255)))


def decoder_of(kind, paths):
    return Decoder(Channel('/topic', kind, written_definition(kind)[0]), paths, 'header.frame_id')


def records_of(messages):
    return Records.of(messages, np.arange(len(messages), dtype=np.int64))


garbage = st.tuples(st.sampled_from([b'', b'\0\1\0\0', b'\0\0\0\0']), st.binary(max_size=60))
encoded = st.builds(
    lambda message, little, padding: (
        bytes(STORE.serialize_cdr(message, PULSE, little_endian=little)) + bytes(padding)
    ),
    pulse_messages(),
    st.booleans(),
    st.integers(0, 3),
)


@given(st.lists(encoded | garbage.map(b''.join), max_size=12))
def test_any_mixture_decodes_as_rosbags_does_and_what_it_refuses_is_left_out(raw):
    columns = decoder_of(PULSE, PULSE_PATHS).decode(records_of(raw))
    for index, message in enumerate(raw):
        try:
            slow = STORE.deserialize_cdr(message, PULSE)
        except SerdeError:
            assert not columns.good[index]
            continue
        assert columns.good[index]
        for path in PULSE_PATHS:
            column = columns.number[path]
            expected = np.array(attrgetter(path)(slow)).astype(column.dtype)
            assert column[index].tobytes() == expected.tobytes()


@given(st.lists(encoded, max_size=12))
def test_frame_ids_are_those_of_rosbags(raw):
    columns = decoder_of(PULSE, PULSE_PATHS).decode(records_of(raw))
    slow = [STORE.deserialize_cdr(message, PULSE) for message in raw]
    assert columns.good.all()
    assert columns.strings == {message.header.frame_id for message in slow}


def test_the_layout_follows_the_definition_in_the_recording():
    text = 'float32 width\nfloat64 intensity\nstring note\nuint8 flag\n'
    decoder = Decoder(Channel('/topic', 'lab/msg/Pulse', text), ('intensity', 'width', 'flag'))
    raw = b'\0\1\0\0' + np.array(2.5, '<f4').tobytes() + bytes(4) + np.array(0.75).tobytes()
    raw += b'\3\0\0\0ok\0' + b'\7'
    columns = decoder.decode(records_of([raw, raw]))
    assert columns.number['intensity'].tolist() == [0.75, 0.75]
    assert columns.number['width'].tolist() == [2.5, 2.5]
    assert columns.number['flag'].tolist() == [7, 7]


@given(
    frame_ids, st.lists(st.tuples(st.integers(0, 2**31 * 10**9 - 1), doubles, doubles), max_size=5)
)
def test_encoded_pulses_are_those_of_rosbags(frame_id, drawn):
    onset, intensity, width = np.array(drawn, object).reshape(-1, 3).T
    pulses = PulseTrain.numbered(onset.astype(np.int64), intensity, width)
    records = encode_pulses(pulses, frame_id)
    types = STORE.types
    for index, (stamp, level, length) in enumerate(drawn):
        time = types['builtin_interfaces/msg/Time'](*divmod(stamp, 1_000_000_000))
        header = types['std_msgs/msg/Header'](time, frame_id)
        message = types[PULSE](header, index, level, length, 0)
        assert records.message(index) == bytes(
            STORE.serialize_cdr(message, PULSE, little_endian=True)
        )


@pytest.mark.parametrize('stamp_ns', [-1, 2**31 * 1_000_000_000])
def test_stamps_that_ros_cannot_hold_are_refused(stamp_ns):
    with pytest.raises(RecordingError, match='expected stamps from 0 to 2147483647 s, got'):
        encode_forces(ForceTrace(np.array([stamp_ns]), np.zeros(1)), (0.0, 0.0, 1.0))
