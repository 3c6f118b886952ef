# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses and forces as arrays, their hash, and the axis of a sensor."""

from argparse import ArgumentParser
from functools import partial

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, strategies as st

from rpms_ros.axis import unit_vector
from rpms_ros.cli.options import add_reading_options
from rpms_ros.errors import AxisError
from rpms_ros.pulses import ForceTrace, Pulse, PulseHash, PulseTrain, hash_of

EPOCH_NS = 1_700_000_000_123_456_789


def fields(train):
    return [list(one) for one in (train.onset_ns, train.intensity, train.sequence, train.width)]


def test_a_train_of_pulses_keeps_order_and_bits():
    pulses = [Pulse(EPOCH_NS + 5, 0.25, 7, 2e-4), Pulse(EPOCH_NS, 1.0, 3)]
    train = PulseTrain.of(pulses)
    assert [Pulse(*values) for values in zip(*fields(train), strict=True)] == pulses
    assert train.onset_ns.dtype == np.int64
    assert train.sequence.dtype == np.int64


@given(st.floats(0.5, 1000.0), st.integers(0, 500), st.integers(0, EPOCH_NS))
def test_a_regular_train_never_drifts(rate_hz, index, start_ns):
    train = PulseTrain.regular(np.full(index + 1, 0.5), rate_hz, start_ns)
    # Half a nanosecond by rounding to whole ones, and 500 s resolve to 1e-4 ns.
    assert abs(int(train.onset_ns[-1]) - start_ns - index * 1e9 / rate_hz) <= 0.501


@given(st.integers(0, 6))
def test_parts_joined_are_the_whole(cut):
    train = PulseTrain.regular(np.linspace(0.0, 1.0, 6), 20.0)
    assert fields(PulseTrain.joined([train[:cut], train[cut:]])) == fields(train)


KINDS = [
    list,
    tuple,
    pd.Series,
    lambda values: pd.Series(values, index=range(5, 5 + len(values))),
    np.asfortranarray,
]


@pytest.mark.parametrize('kind', KINDS)
def test_numbers_of_any_kind_become_arrays(kind):
    stamps = [EPOCH_NS, EPOCH_NS + 1]
    train = PulseTrain(kind(stamps), kind([0, 1]), kind([0, 1]), kind([1e-4, 1e-4]))
    forces = ForceTrace(kind(stamps), kind([1, 2]))
    for array in (train.onset_ns, train.sequence, forces.stamp_ns):
        assert type(array) is np.ndarray
        assert array.dtype == np.int64
    for array in (train.intensity, train.width, forces.force):
        assert type(array) is np.ndarray
        assert array.dtype == np.float64
    assert train.onset_ns.tolist() == forces.stamp_ns.tolist() == stamps
    assert fields(train[train.intensity > 0.5]) == [[EPOCH_NS + 1], [1.0], [1], [1e-4]]


def test_times_of_pandas_are_nanoseconds_and_arrays_that_are_kept_are_not_copied():
    stamps = pd.to_datetime(pd.Series([EPOCH_NS, EPOCH_NS + 7]))
    assert ForceTrace(stamps, [0.0, 0.0]).stamp_ns.tolist() == [EPOCH_NS, EPOCH_NS + 7]
    assert ForceTrace(np.arange(3, dtype=np.int32), np.zeros(3)).stamp_ns.dtype == np.int64
    stamps, force = np.arange(3, dtype=np.int64), np.zeros(3)
    trace = ForceTrace(stamps, force)
    assert trace.stamp_ns is stamps
    assert trace.force is force


@pytest.mark.parametrize(
    ('make', 'match'),
    [
        (lambda: ForceTrace([0.0, 0.05], [1.0, 1.0]), 'whole numbers in stamp_ns, got float64'),
        (lambda: PulseTrain.of([Pulse(0.05, 1.0)]), 'whole numbers in onset_ns, got float64'),
        (lambda: ForceTrace(['a'], [1.0]), 'expected whole numbers in stamp_ns, got <U1'),
        (lambda: ForceTrace([0], [[1.0]]), r'expected force of shape \(n,\), got \(1, 1\)'),
        (lambda: ForceTrace(0, 1.0), r'expected stamp_ns of shape \(n,\), got \(\)'),
        (lambda: ForceTrace([0], [{}]), r'expected numbers in force, got \[\{\}\]'),
        (lambda: ForceTrace([0, 1], [0.5]), 'expected as many stamps as forces, got 2 and 1'),
        (
            lambda: PulseTrain([0, 1], [1.0], [0, 1], [1e-4, 1e-4]),
            r'expected arrays of one length, got lengths \[1, 2\]',
        ),
        *(
            (partial(PulseTrain.regular, [0.1, 0.2], rate), 'a repetition rate above 0 Hz, got')
            for rate in (0.0, -20.0, float('nan'), float('inf'))
        ),
    ],
)
def test_what_cannot_be_such_arrays_is_refused(make, match):
    with pytest.raises(ValueError, match=match):
        make()


PULSES = st.lists(
    st.builds(
        Pulse,
        st.integers(-(2**62), 2**62),
        st.floats(0, 1),
        st.integers(0, 2**40),
        st.floats(0, 0.01),
    ),
    min_size=1,
    max_size=20,
)


@given(PULSES)
def test_one_by_one_is_all_at_once(pulses):
    hashed = PulseHash()
    for pulse in pulses:
        hashed.add(pulse)
    assert hashed.for_the_log() == {
        'pulses': len(pulses),
        'first_pulse_ns': pulses[0].onset_ns,
        'pulses_sha256': hash_of(PulseTrain.of(pulses)),
    }
    assert hashed.for_the_log() == {}


@given(PULSES)
def test_any_change_gives_another_hash(pulses):
    train, first = PulseTrain.of(pulses), pulses[0]
    steps = {'onset_ns': 1, 'intensity': 0.5, 'sequence': 1, 'width': 1e-6}
    others = [
        first._replace(**{name: getattr(first, name) + step}) for name, step in steps.items()
    ]
    for changed in (pulses[:-1], [*pulses, first], *([one, *pulses[1:]] for one in others)):
        assert hash_of(PulseTrain.of(changed)) != hash_of(train)


def test_a_direction_has_length_one_whatever_it_is_written_with():
    assert unit_vector('0,-5,0') == (0.0, -1.0, 0.0)
    assert unit_vector((3e200, 0.0, 4e200)) == pytest.approx((0.6, 0.0, 0.8), abs=1e-15)
    parser = ArgumentParser()
    add_reading_options(parser)
    assert unit_vector(parser.parse_args(['--axis=-z']).axis) == (0.0, 0.0, -1.0)


@pytest.mark.parametrize('text', ['', 'up', '-w', '1,2', '0,0,0', 'nan,0,1', 'inf,0,0', '1,2,3,4'])
def test_what_is_no_direction_is_refused(text):
    with pytest.raises(AxisError, match='expected axis x, y, z, -x or three numbers'):
        unit_vector(text)
