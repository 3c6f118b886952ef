# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""rpms analyze and the protocols for it."""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from rpms_ros.cli import main
from rpms_ros.cli.analyze import _joined
from rpms_ros.identification.analysis.responses import clean
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import read_recording, write_recording

FOLDER = Path(os.environ.get('RPMS_RECORDINGS', Path(__file__).parents[2] / '../shared/data'))
TRIAL = FOLDER / 'rat_gastrocnemius' / 'GMe1_ISOM01_OR.csv'


def simulate(folder, subject, seed):
    """Return a recording of the protocol of twitches."""
    schedule, path = folder / 'twitches.yaml', folder / f'{subject}-{seed}'
    assert main(['protocol', 'twitches', '--out', str(schedule)]) == 0
    options = ['--subject', subject, '--noise', '0.02', '--artifact', '2', '--seed', str(seed)]
    command = ['simulate', '--quiet', '--out', str(path), '--schedule', str(schedule)]
    assert main([*command, *options]) == 0
    return path


@pytest.fixture(scope='module')
def magnetic(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp('magnetic'), 'rpms', 1)


@pytest.fixture(scope='module')
def electrical(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp('electrical'), 'fes', 1)


def test_json_is_one_object_and_nothing_else(rpms, magnetic):
    code, out, _ = rpms('analyze', magnetic, '--json')
    assert code == 0
    assert out.count('\n') == 1
    document = json.loads(out)
    assert document['contents'] == {'single pulse': 60}
    # T_a of Table 2
    assert document['twitches']['time_constant'] == pytest.approx(38.44e-3, rel=0.02)
    assert document['twitches']['latency']['mean'] == pytest.approx(9.45e-3, abs=0.5e-3)


def test_several_recordings_follow_one_another_and_get_a_folder_each(
    rpms, magnetic, electrical, tmp_path
):
    code, out, err = rpms('analyze', magnetic, electrical, '--out', tmp_path)
    assert code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ['1-rpms-1', '2-fes-1']
    magnetic_text, electrical_text = out.split('\n\n')
    # the latencies of Table 1
    for text, latency in ((magnetic_text, 9.45), (electrical_text, 24.4)):
        (mean,) = re.findall(r'\n  delay of the model +([0-9.]+) \+-', text)
        assert float(mean) == pytest.approx(latency, abs=0.5)
    assert 'rpms: rpms-1: there is no steady force' in err
    assert 'rpms: fes-1: there is no steady force' in err


def test_parts_of_a_session_are_analysed_as_one(rpms, magnetic):
    code, out, _ = rpms('analyze', '--together', magnetic, magnetic, '--json')
    assert code == 0
    document = json.loads(out)
    assert document['twitches']['latency']['count'] == 120
    # the sample rate does not change between the parts
    assert not any('sample rate' in line for line in document['findings'])


def test_a_sensor_zeroed_between_trials_changes_no_steady_force(rpms, tmp_path):
    """The baseline went straight from trial to trial: the steady forces were 0.2 to 0.7 N low."""
    stamps, found = np.arange(11_000, dtype=np.int64) * 1_000_000, []
    for offset in (0.0, 2.0):
        for trial, levels in enumerate([[0.4, 0.6, 0.8], [0.5, 0.7, 1.0]]):
            pulses = PulseTrain.regular(np.repeat(levels, 60), 20.0, 10**9)
            muscle = Contraction(simulation_subject())
            muscle.add_pulses(pulses.onset_ns, pulses.intensity)
            force = muscle.force(stamps) + 0.01 * np.random.default_rng(trial).normal(size=11_000)
            shown = ForceTrace(stamps, force + trial * offset)
            write_recording(tmp_path / f'{offset}-{trial}', pulses, shown)
        paths = [tmp_path / f'{offset}-{trial}' for trial in range(2)]
        document = json.loads(rpms('analyze', '--together', '--json', *paths)[1])
        found.append(document['recruitment']['maximum_force'])
    assert found[1] == pytest.approx(found[0], rel=1e-4)
    assert found[0]['value'] == pytest.approx(10.0, rel=0.01)


def test_each_of_several_trials_may_be_clipped_and_have_a_wild_sample():
    """Above the rest of each, the ends of two sensors are two; and a mean takes a spike along."""
    stamps, sessions = np.arange(11_000, dtype=np.int64) * 1_000_000, []
    pulses = PulseTrain.regular(np.full(60, 0.9), 20.0, 10**9)
    for trial in range(2):
        muscle = Contraction(simulation_subject())
        muscle.add_pulses(pulses.onset_ns, pulses.intensity)
        force = muscle.force(stamps) + 0.01 * np.random.default_rng(trial).normal(size=11_000)
        force = np.minimum(force, 8.0)
        force[900] = 1e9
        sessions.append((pulses, ForceTrace(stamps, force)))
    found = clean(_joined(sessions)[1])
    assert len(found.force) == 2 * 11_000 - 2
    first, second = found.saturated[:10_999].sum(), found.saturated[10_999:].sum()
    assert first == pytest.approx(second, rel=0.05)
    assert first > 1000


def test_many_trials_are_ten_seconds_apart(rpms, tmp_path):
    """The pause doubled with every trial: with the 31st the stamps overflowed."""
    stamps = np.arange(1500, dtype=np.int64) * 1_000_000
    force = np.random.default_rng(0).normal(size=1500)
    pulse = PulseTrain.regular(np.ones(1), 20.0, 10**8)
    write_recording(tmp_path / 'one', pulse, ForceTrace(stamps, force))
    code, _, err = rpms('analyze', '--together', '--json', *[tmp_path / 'one'] * 40)
    assert code in (0, 1)
    assert 'Error' not in err


def test_forces_and_torques_are_no_parts_of_one_session(rpms, tmp_path):
    paths = [tmp_path / 'leg.csv', tmp_path / 'arm.csv']
    for path, title in zip(paths, ('Force [N]', 'Torque [Nm]'), strict=True):
        lines = [f'{at / 100},{at % 7},{5 * (at % 50 == 9)}' for at in range(200)]
        path.write_text('\n'.join([f'Time [s],{title},Gate', *lines]))
    code, out, err = rpms('analyze', '--together', *paths)
    assert (code, out) == (2, '')
    assert err.endswith('rpms: error: expected one quantity, got N and N m\n')


def test_intensities_that_mean_nothing_are_not_used(rpms, magnetic):
    _, out, err = rpms('analyze', '--unknown-intensity', magnetic, '--json')
    assert json.loads(out)['twitches']['latency']['rows'][0]['intensity'] is None
    assert 'the intensity of 60 of 60 pulses is not recorded' in err


def test_a_recording_that_tells_nothing_is_told_apart(rpms, magnetic, tmp_path):
    recording = read_recording(magnetic)
    random = np.random.default_rng(0).uniform(0.0, 1.0, 100)
    modulated = PulseTrain.regular(random, 20.0, int(recording.forces.stamp_ns[2000]))
    write_recording(tmp_path / 'modulated', modulated, recording.forces)
    code, out, err = rpms('analyze', tmp_path / 'modulated')
    assert code == 1
    assert '1 modulated train' in out
    assert 'use `rpms identify` for them' in err


@pytest.mark.skipif(not TRIAL.exists(), reason='no recordings (set RPMS_RECORDINGS)')
def test_identify_and_analyze_state_the_same_of_a_trial(rpms):
    one = json.loads(rpms('identify', TRIAL, '--force', 'fGM [N]', '--json')[1])['dynamics']
    other = json.loads(rpms('analyze', TRIAL, '--force', 'fGM [N]', '--json')[1])['dynamics']
    assert one == other
    # the force begins 4.0 ms after the pulse, and no model says when
    assert one['onset_s']['value'] == pytest.approx(4.0e-3, abs=1e-6)
    shown = ' '.join(rpms('analyze', TRIAL, '--force', 'fGM [N]')[1].split())
    constant = f'{1e3 * one["twitch_time_constant_s"]["value"]:.2f} ms'
    assert re.search(rf'onset of force 4\.0+ ms \(.*\) T_a, history law {constant}', shown)
