# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The hash of pulses as they are given is that of the same pulses in a recording."""

from hypothesis import given, strategies as st

from rpms_ros.pulses import Pulse, PulseHash, PulseTrain, hash_of

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
def test_one_by_one_is_all_at_once(pulses: list[Pulse]) -> None:
    hashed = PulseHash()
    for pulse in pulses:
        hashed.add(pulse)
    found = hashed.taken()
    assert found is not None
    assert found.count == len(pulses)
    assert found.first_ns == pulses[0].onset_ns
    assert found.sha256 == hash_of(PulseTrain.of(pulses))
    assert hashed.taken() is None


@given(PULSES)
def test_any_change_gives_another_hash(pulses: list[Pulse]) -> None:
    train = PulseTrain.of(pulses)
    for changed in (
        pulses[:-1],
        [*pulses, pulses[0]],
        [pulses[0]._replace(onset_ns=pulses[0].onset_ns + 1), *pulses[1:]],
        [pulses[0]._replace(intensity=pulses[0].intensity + 0.5), *pulses[1:]],
        [pulses[0]._replace(sequence=pulses[0].sequence + 1), *pulses[1:]],
        [pulses[0]._replace(width=pulses[0].width + 1e-6), *pulses[1:]],
    ):
        assert hash_of(PulseTrain.of(changed)) != hash_of(train)
