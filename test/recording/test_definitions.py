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
    ('text', 'found'),
    [
        (OF_ITSELF, '(more than 30 levels|maximum recursion)'),
        ('geometry_msgs/Wrench w\n', 'no geometry_msgs/msg/Wrench among'),
        ('#' * 600_000, '600000 characters'),
        ('float64 &', ''),
    ],
)
def test_definition_that_is_none_or_would_take_too_long_is_refused(text, found):
    with pytest.raises(RecordingError, match=f'expected a definition of .* used, got {found}'):
        types_of(PULSE, text, 'ros2msg')


STORE = known_types()
STAMP = ('header.stamp.sec', 'header.stamp.nanosec')
PULSE_PATHS = (*STAMP, 'sequence', 'intensity', 'width')

frame_ids = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=9)
SECOND = 1_000_000_000
# seconds are an int32
END_NS = 2**31 * SECOND
doubles = st.floats(width=64)


def encoded_pulse(stamp_ns, frame_id, *fields, little=True, padding=0):
    types = STORE.types
    time = types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, SECOND))
    message = types[PULSE](types['std_msgs/msg/Header'](time, frame_id), *fields)
    return bytes(STORE.serialize_cdr(message, PULSE, little_endian=little)) + bytes(padding)


def records_of(messages):
    return Records.of(messages, np.arange(len(messages), dtype=np.int64))


garbage = st.tuples(st.sampled_from([b'', b'\0\1\0\0', b'\0\0\0\0']), st.binary(max_size=60))
encoded = st.builds(
    encoded_pulse,
    st.integers(-END_NS, END_NS - 1),
    frame_ids,
    st.integers(0, 2**32 - 1),
    doubles,
    doubles,
    st.integers(0, 255),
    little=st.booleans(),
    padding=st.integers(0, 3),
)


@given(st.lists(encoded | garbage.map(b''.join), max_size=12))
def test_any_mixture_decodes_as_rosbags_does_and_what_it_refuses_is_left_out(raw):
    channel = Channel('/topic', PULSE, written_definition(PULSE)[0])
    columns = Decoder(channel, PULSE_PATHS, 'header.frame_id').decode(records_of(raw))
    frame_ids = set()
    for index, message in enumerate(raw):
        try:
            slow = STORE.deserialize_cdr(message, PULSE)
        except SerdeError:
            assert not columns.good[index]
            continue
        assert columns.good[index]
        frame_ids.add(slow.header.frame_id)
        for path in PULSE_PATHS:
            column = columns.number[path]
            expected = np.array(attrgetter(path)(slow)).astype(column.dtype)
            assert column[index].tobytes() == expected.tobytes()
    assert columns.strings == frame_ids


def test_the_layout_follows_the_definition_in_the_recording():
    text = 'float32 width\nfloat64 intensity\nstring note\nuint8 flag\n'
    decoder = Decoder(Channel('/topic', 'lab/msg/Pulse', text), ('intensity', 'width', 'flag'))
    raw = b'\0\1\0\0' + np.array(2.5, '<f4').tobytes() + bytes(4) + np.array(0.75).tobytes()
    raw += b'\3\0\0\0ok\0' + b'\7'
    columns = decoder.decode(records_of([raw, raw]))
    assert columns.number['intensity'].tolist() == [0.75, 0.75]
    assert columns.number['width'].tolist() == [2.5, 2.5]
    assert columns.number['flag'].tolist() == [7, 7]


@given(frame_ids, st.lists(st.tuples(st.integers(0, END_NS - 1), doubles, doubles), max_size=5))
def test_encoded_pulses_are_those_of_rosbags(frame_id, drawn):
    onset, intensity, width = np.array(drawn, object).reshape(-1, 3).T
    pulses = PulseTrain.numbered(onset.astype(np.int64), intensity, width)
    records = encode_pulses(pulses, frame_id)
    for index, (stamp, level, length) in enumerate(drawn):
        expected = encoded_pulse(stamp, frame_id, index, level, length, 0)
        assert records.message(index) == expected


@pytest.mark.parametrize('stamp_ns', [-1, END_NS])
def test_stamps_that_ros_cannot_hold_are_refused(stamp_ns):
    with pytest.raises(RecordingError, match='expected stamps from 0 to 2147483647 s, got'):
        encode_forces(ForceTrace(np.array([stamp_ns]), np.zeros(1)), (0.0, 0.0, 1.0))
