# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages to domain values and back, with the classes of rclpy and of rosbags."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from rosbags.typesys import Stores, get_typestore

from rpms_ros import estimate_messages, messages
from rpms_ros.axis import along, unit_vector
from rpms_ros.errors import MessageError
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.pulses import Pulse
from rpms_ros.report.recorded import differences

STORE = get_typestore(Stores.ROS2_JAZZY)

# builtin_interfaces/Time counts its seconds in an int32
stamps = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)
numbers = st.floats(allow_nan=False, allow_infinity=False)


@pytest.fixture(scope='module')
def estimate(beside):
    """Make an estimate in which every array of a message has elements."""
    make = beside('made_up_estimates').estimate
    values = {
        'stamp_ns': 1_700_000_000_123_456_789,
        'linear_names': ('basis_1', 'basis_2', 'basis_3'),
        'linear': np.array([1.0, -2.0, 0.1]),
        'damping': 1e-4,
        'condition_number': 712.0,
        'physiology_names': ('latency_s',),
        'physiology': np.array([9.45e-3]),
        'physiology_lower': np.array([8e-3]),
        'physiology_upper': np.array([10e-3]),
        'response_lower': np.zeros(41),
        'response_upper': np.ones(41),
        'faults': {'late_pulse': 2, 'force_not_finite': 1},
        'doubts': ('late_pulse',),
        'unit': 'N m',
        'rate_names': ('force_percent', 'time_constant_percent'),
        'rate': np.array([-12.0, 3.0]),
        'rate_lower': np.array([-14.0, 2.0]),
        'rate_upper': np.array([-10.0, 4.0]),
        'changes': 1,
        'change_kinds': ('gain',),
        'change_ago': np.array([3.25]),
        'disturbance': 0.4,
        'disturbance_deviation': 0.1,
        'reasons': ('the pulses have one intensity',),
    }
    return lambda **changes: make(3, **{**values, **changes})


@given(stamps, numbers, st.integers(0, 2**32 - 1), numbers)
def test_a_pulse_survives_the_round_trip(onset, intensity, sequence, width):
    pulse = Pulse(onset, intensity, sequence, width)
    assert messages.pulse_of(messages.pulse_message(pulse, MESSAGE_TYPES)) == pulse


def test_integers_become_floats_and_the_sequence_wraps():
    message = messages.pulse_message(Pulse(5, 1, 2**32 + 7, 0), MESSAGE_TYPES, 'coil')
    assert type(message.intensity) is float
    assert type(message.width) is float
    assert message.sequence == 7
    assert message.header.frame_id == 'coil'


@pytest.mark.parametrize('build', [MESSAGE_TYPES, STORE.types], ids=['rclpy', 'rosbags'])
@given(stamp=stamps, force=numbers)
def test_a_force_survives_the_round_trip(build, stamp, force):
    for axis in messages.AXES.values():
        message = messages.force_message(stamp, force, axis, build, 'sensor')
        assert messages.force_of(message, axis) == (stamp, force)
    assert message.header.frame_id == 'sensor'


# far enough below the largest double that three of them can be added
forces = st.floats(-1e300, 1e300)


@given(st.tuples(forces, forces, forces), stamps)
def test_force_and_axis_agree_with_those_of_a_recording(vector, stamp):
    axis = unit_vector('0.3,-0.2,0.9')
    message = messages.force_message(stamp, 0.0, axis, STORE.types)
    message.wrench.force = STORE.types[messages.VECTOR](*vector)
    components = [np.array([value]) for value in vector]
    recorded = along(axis, components)
    live = messages.force_of(message, axis)[1]
    assert np.array([live]).tobytes() == recorded.tobytes()


def test_an_estimate_survives_the_round_trip_in_every_bit(estimate):
    for given_ in (
        estimate(),
        estimate(curve_force=np.empty(0), nonlinear_covariance=np.empty((0, 0))),
    ):
        sent = estimate_messages.estimate_message(given_, MESSAGE_TYPES)
        assert differences(given_, estimate_messages.estimate_of(sent)) == []


def test_every_field_of_the_message_is_filled(estimate):
    message = estimate_messages.estimate_message(estimate(), MESSAGE_TYPES, 'wrist')
    empty = type(message)()
    for name in message.get_fields_and_field_types():
        assert getattr(message, name) != getattr(empty, name), name


@pytest.mark.parametrize(
    ('name', 'length'),
    [
        ('nonlinear', 4),
        ('linear', 3),
        ('curve_force', 101),
        ('response_force', 41),
        ('fault_counts', 2),
        ('nonlinear_covariance', 16),
        ('nonlinear_identifiability', 4),
        ('rate', 2),
        ('rate_lower', 2),
        ('change_ago', 1),
    ],
)
def test_arrays_that_belong_together_have_one_length(estimate, name, length):
    message = estimate_messages.estimate_message(estimate(), MESSAGE_TYPES)
    setattr(message, name, getattr(message, name)[:-1])
    with pytest.raises(MessageError, match=f'expected {length} elements in {name}'):
        estimate_messages.estimate_of(message)


def test_what_a_device_could_not_confirm_goes_with_its_pulse():
    pulse = Pulse(1, 0.5, 2, 1e-4, 3)
    message = messages.pulse_message(pulse, MESSAGE_TYPES)
    assert message.unverified == message.UNVERIFIED_DELIVERY | message.UNVERIFIED_INTENSITY
    assert messages.pulse_of(message) == pulse
    names = ('header', 'sequence', 'intensity', 'width')
    older = SimpleNamespace(**{name: getattr(message, name) for name in names})
    assert messages.pulse_of(older) == pulse._replace(unverified=0)


def test_an_estimate_of_an_older_definition_is_read(estimate):
    """Without what was appended later."""
    message = estimate_messages.estimate_message(estimate(), MESSAGE_TYPES)
    younger = ('rate', 'change', 'disturbance', 'reasons', 'nonlinear_identifiability', 'unit')
    names = [n for n in message.get_fields_and_field_types() if not n.startswith(younger)]
    older = SimpleNamespace(**{name: getattr(message, name) for name in names})
    found = estimate_messages.estimate_of(older)
    assert found.nonlinear_identifiability.tolist() == []
    assert found.rate_names == found.change_kinds == found.reasons == ()
    assert found.changes == len(found.rate) == len(found.change_ago) == 0
    assert found.unit == 'N'
