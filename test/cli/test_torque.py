# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A dynamometer measures a torque: every number of every command is then in N m."""

import re

import numpy as np
import pytest

from rpms_ros.api import load
from rpms_ros.errors import RecordingError
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import read_recording, write_recording
from rpms_ros.recording.rosbag.definitions import WRENCH_STAMPED
from rpms_ros.recording.rosbag.writing import FurtherTopic, encode_forces

ARM = 0.25


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    """Ten seconds: the force on ``/force``, and its torque about z on ``/dynamometer``."""
    generator = np.random.default_rng(1)
    pulses = PulseTrain.regular(generator.uniform(0.0, 1.0, 200), 20.0)
    muscle = Contraction(simulation_subject(), fixed_rate_hz=20.0)
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = np.arange(2500) * 4_000_000
    force = muscle.force(stamps) + 0.02 * generator.standard_normal(len(stamps))
    torques = encode_forces(ForceTrace(stamps, ARM * force), (0.0, 0.0, 1.0), 'torque')
    data = [torques.message(index) for index in range(len(torques))]
    path = tmp_path_factory.mktemp('torque') / 'leg'
    further = FurtherTopic('/dynamometer', WRENCH_STAMPED, stamps.tolist(), data)
    write_recording(path, pulses, ForceTrace(stamps, force), further=(further,))
    return path


OPTIONS = ['--force-topic', 'dynamometer', '--quantity', 'torque']


def test_a_torque_is_read_where_one_is_asked_for(recording):
    force = read_recording(recording)
    torque = load(recording, force_topic='dynamometer', quantity='torque').recording
    np.testing.assert_array_equal(torque.forces.force, ARM * force.forces.force)
    assert (force.unit, torque.unit) == ('N', 'N m')
    # the wrench of a dynamometer has no force
    assert not np.any(load(recording, force_topic='dynamometer').force.force)
    with pytest.raises(RecordingError, match='expected a quantity of force, torque, got power'):
        read_recording(recording, quantity='power')


def test_identify_states_newton_metres(rpms, as_json, recording):
    identify = ('identify', '--quiet', recording)
    force, torque = as_json(*identify, '--json'), as_json(*identify, '--json', *OPTIONS)
    assert (force['unit'], torque['unit']) == ('N', 'N m')
    # scale moves only what is linear; the solver stops at a step, not at the last bit
    np.testing.assert_allclose(
        torque['curve']['force'], ARM * np.array(force['curve']['force']), atol=1e-3
    )
    _, said, _ = rpms(*identify, *OPTIONS)
    assert 'steady torque at 20 Hz' in said
    assert re.search(r'at 20 Hz +2\.\d+ N m \(|0\.0\d+ N m', said)
    assert not re.search(r'\d N[ ,](?!m)', said)
    assert 'force' not in said


def test_a_torque_is_imported_and_saved_as_one(rpms, tmp_path):
    table, again = tmp_path / 'leg.csv', tmp_path / 'again'
    table.write_text('time [s],torque [Nm],trigger [V]\n0,0.5,0\n0.1,1.5,5\n0.2,2.5,0\n')
    code, out, _ = rpms('import', table, '--out', again)
    assert code == 0
    assert 'a torque: read it with --quantity torque' in out
    after = load(again, quantity='torque')
    after.save(tmp_path / 'saved')
    assert load(tmp_path / 'saved', quantity='torque').force.force.tolist() == [0.5, 1.5, 2.5]
    # it is no force
    assert not np.any(load(again).force.force)
    with pytest.raises(RecordingError, match='expected a quantity of force, torque, got power'):
        write_recording(tmp_path / 'x', after.pulses, after.force, quantity='power')


@pytest.mark.parametrize('unit', ['N m', 'N·m', 'mNm', 'ft-lbs'])
def test_a_table_of_a_dynamometer_is_a_torque(tmp_path, unit):
    rows = [f'{0.002 * k:.3f},{k % 7},{5 * (k % 50 == 10)}' for k in range(500)]
    table = tmp_path / 'leg.csv'
    table.write_text('\n'.join([f'time [s],torque [{unit}],trigger [V]', *rows]))
    session = load(table)
    assert session.recording.unit == 'N m'
    assert session.force.force.max() == pytest.approx(
        6 * {'N m': 1.0, 'N·m': 1.0, 'mNm': 1e-3, 'ft-lbs': 1.3558179483314004}[unit]
    )
    assert load(table, force_unit='Nm', force_scale=2.0).force.force.max() == 12.0
    with pytest.raises(
        RecordingError, match=r'expected a torque, got a force in \S+; force_unit='
    ):
        load(table, quantity='torque', force_unit='N')
