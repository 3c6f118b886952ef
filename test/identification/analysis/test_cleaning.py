# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.analysis.responses import clean
from rpms_ros.pulses import ForceTrace

MILLISECOND = 1_000_000


def trace(force, step=MILLISECOND):
    return ForceTrace(np.arange(len(force), dtype=np.int64) * step, np.asarray(force, float))


def noise(count, size=1.0):
    return size * np.random.default_rng(0).standard_normal(count)


def test_white_noise_is_measured_under_a_slow_force_and_artifacts():
    time = np.arange(20_000) * 1e-3
    force = 10 * np.sin(2 * np.pi * time) + noise(len(time), 0.2)
    force[::50] += 100.0
    # one artifact in 50 samples touches 8 % of the third differences: the median moves by 10 %
    assert clean(trace(force)).noise == pytest.approx(0.2, rel=0.15)


def test_samples_come_in_order_and_once():
    force = noise(200)
    stamps = np.arange(200, dtype=np.int64) * MILLISECOND
    shuffled = np.random.default_rng(1).permutation(200)
    twice = np.concatenate((shuffled, [5]))
    found = clean(ForceTrace(stamps[twice], force[twice]))
    assert np.array_equal(found.stamp_ns, stamps)
    assert np.array_equal(found.force, force)
    assert any('1 force samples have the stamp of another' in line for line in found.findings)


def test_what_is_no_number_is_left_out_and_said():
    force = noise(300)
    force[[3, 70]] = np.nan
    found = clean(trace(force))
    assert len(found.force) == 298
    assert '2 force samples are NaN or infinite' in found.findings[0]


def test_what_is_too_large_is_left_out_and_said_without_a_unit():
    force = noise(300)
    force[70] = 2e4
    found = clean(trace(force))
    assert len(found.force) == 299
    assert found.findings == ('1 force samples are beyond 10000; they are not used',)


def test_a_sensor_at_its_end_is_saturated_only_there():
    force = noise(1000)
    force[400:420] = 50.0
    force[700] = 50.0
    found = clean(trace(force))
    # a single sample at the end is no run of equal values
    assert np.array_equal(np.flatnonzero(found.saturated), np.arange(400, 420))
    # without a unit: the samples may be torques
    assert '(at 50)' in found.findings[0]


def test_a_constant_force_is_not_saturated():
    assert not clean(trace(np.zeros(200))).saturated.any()


@pytest.mark.parametrize('place', [430, 500, 999])
def test_a_change_of_the_rate_is_said_once(place):
    stamps = np.cumsum(np.where(np.arange(2000) < place, 1, 2) * MILLISECOND).astype(np.int64)
    found = clean(ForceTrace(stamps, noise(2000)))
    (sentence,) = found.findings
    assert 'from 1000 to 500 Hz' in sentence


def test_a_gap_is_no_change_of_the_rate():
    stamps = np.arange(2000, dtype=np.int64) * MILLISECOND
    stamps[1000:] += 500 * MILLISECOND
    assert clean(ForceTrace(stamps, noise(2000))).findings == ()


def test_too_few_samples_are_refused():
    with pytest.raises(IdentificationError, match='at least 100 samples, got 99'):
        clean(trace(noise(99)))
