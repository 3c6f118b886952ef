# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables that begin amid stimulation, and those that begin at rest."""

import numpy as np
import pytest

from rpms_ros.identification import CURVE_INTENSITY, estimator_by_name, identify
from rpms_ros.muscle import Contraction, Subject
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording.importing import ImportOptions, import_file
from rpms_ros.recording.importing.whole_file import begins_amid

RATE = 20.0
# pulses come with samples, 500 ms after the beginning
STAMP_NS = np.arange(15_000, dtype=np.int64) * 1_000_000
PULSES = PulseTrain.regular(np.random.default_rng(5).uniform(size=290), RATE, 500_000_000)


def session(first, sign=1.0):
    """The session from a sample on."""
    muscle = Contraction(Subject())
    muscle.add_pulses(PULSES.onset_ns, PULSES.intensity)
    noise = 0.02 * np.random.default_rng(6).standard_normal(len(STAMP_NS))
    force = sign * muscle.force(STAMP_NS) + noise + 3.0
    pulses = PULSES[PULSES.onset_ns >= STAMP_NS[first]]
    return pulses, ForceTrace(STAMP_NS[first:], force[first:])


def table(path, first):
    pulses, forces = session(first)
    gate = np.isin(forces.stamp_ns, pulses.onset_ns).astype(float)
    rows = np.column_stack((1e-9 * forces.stamp_ns, forces.force, gate))
    np.savetxt(path, rows, delimiter=',', header='time,force,gate', comments='', fmt='%.6f')
    return import_file(path, ImportOptions(time='time', force='force', pulse='gate'))


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize(
    ('first', 'amid'), [(0, False), (480, False), (499, False), (5020, True), (8030, True)]
)
def test_a_beginning_amid_stimulation_is_seen(first, amid, sign):
    assert begins_amid(*session(first, sign)) is amid


def test_nothing_is_learnt_from_the_force_of_pulses_that_are_not_in_the_file(tmp_path):
    found = table(tmp_path / 'late.csv', 5020)
    assert found.pulses.sequence[0] == 1
    assert any('the force is not at rest there' in text for _, text in found.facts)
    # the intensities are not in the table
    pulses = PULSES[PULSES.onset_ns >= STAMP_NS[5020]]
    known = PulseTrain(pulses.onset_ns, pulses.intensity, found.pulses.sequence, pulses.width)
    last = identify(estimator_by_name('batch'), known, found.forces).last
    truth = Subject().steady_force(CURVE_INTENSITY, RATE)
    assert last.faults.keys() == {'samples_excluded'}
    assert np.abs(last.curve_force - truth).max() < 0.005 * truth.max()
    # as it is not without that
    worse = identify(estimator_by_name('batch'), pulses_from_0(known), found.forces).last
    assert np.abs(worse.curve_force - truth).max() > 0.005 * truth.max()


def pulses_from_0(pulses):
    return PulseTrain(pulses.onset_ns, pulses.intensity, pulses.sequence - 1, pulses.width)
