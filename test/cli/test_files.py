# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""rpms import: what it guesses and refuses; rpms export: other readers find the same numbers."""

import csv
import json
import os
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import rpms_ros
from rpms_ros import estimate_messages, messages
from rpms_ros.identification import CONVERGED, Estimate
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import FurtherTopic, read_recording, write_recording
from rpms_ros.recording.rosbag.definitions import encoded, known_types

COLUMNS = ['--time', 'Time [s]', '--force', 'fGM [N]', '--pulse', 'STIM [ ]']
FOLDER = Path(os.environ.get('RPMS_RECORDINGS', Path(__file__).parents[2] / '../shared/data'))
TRIALS = sorted((FOLDER / 'rat_gastrocnemius').glob('*.csv'))


def test_a_table_becomes_a_recording(rpms, tmp_path):
    table = tmp_path / 'trial.csv'
    table.write_text('Time [s],STIM [ ],fGM [N]\n0,0,1\n0.5,8,2\n1,0,3\n')
    path = tmp_path / 'bag'
    code, out, err = rpms('import', table, '--out', path, *COLUMNS, '--intensity', '0.6')
    assert (code, err) == (0, '')
    assert out == f'{path}: 1 pulse, 3 samples, 1.000 s\n'
    recording = read_recording(path)
    assert recording.forces.force.tolist() == [1.0, 2.0, 3.0]
    assert recording.pulses.intensity.tolist() == [0.6]
    assert recording.facts.custom == {'source': 'trial.csv'}


TABLE = 'time;kraft;trigger\n' + ''.join(
    f'{k};{0.1 * k:.1f};{5 * (k % 10 == 5)}\n'.replace('.', ',') for k in range(40)
)


def test_what_is_guessed_is_shown(rpms, tmp_path):
    (tmp_path / 'trial.csv').write_text(TABLE, encoding='utf-16')
    code, out, err = rpms('import', tmp_path / 'trial.csv', '--out', tmp_path / 'bag')
    assert (code, out) == (0, f'{tmp_path / "bag"}: 4 pulses, 40 samples, 0.039 s\n')
    for text in ("'kraft' in N", "'time' in ms", "'trigger'", 'decimal comma', 'UTF-16'):
        assert text in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ['bag', 'trial.csv']


def test_what_is_ambiguous_is_refused_and_nothing_is_written(rpms, tmp_path):
    table = tmp_path / 'trial.csv'
    table.write_text('time;kraft [N];force [N];trigger\n0;1;2;0\n1;1;2;5\n2;1;3;0\n')
    code, out, err = rpms('import', table, '--out', tmp_path / 'bag')
    assert (code, out) == (2, '')
    assert '--force COL decides' in err
    assert [path.name for path in tmp_path.iterdir()] == ['trial.csv']
    code, _, err = rpms('import', table, '--out', tmp_path / 'bag', '--force', 'force [N]')
    assert code == 0


def test_what_fails_while_it_is_written_leaves_nothing(rpms, tmp_path, monkeypatch):
    def half(path, *_, **__):
        path.mkdir()
        (path / 'half').write_text('')
        raise OSError('disk full')

    monkeypatch.setattr('rpms_ros.recording.write_recording', half)
    (tmp_path / 'trial.csv').write_text(TABLE)
    code, _, err = rpms('import', tmp_path / 'trial.csv', '--out', tmp_path / 'bag')
    assert code == 2
    assert err.endswith('got disk full\n')
    assert [path.name for path in tmp_path.iterdir()] == ['trial.csv']


def trial(path):
    """A table of ten seconds of the simulated session."""
    session = rpms_ros.simulate(duration=10.0, seed=3)
    stamp_ns, pulses = session.force.stamp_ns, session.pulses
    time, onset = 1e-9 * (stamp_ns - stamp_ns[0]), 1e-9 * (pulses.onset_ns - stamp_ns[0])
    gate = np.isin(np.rint(1e3 * time), np.rint(1e3 * (onset + 0.5)))
    held = np.interp(time, onset + 0.5, pulses.intensity, left=0.0)
    force = np.concatenate((np.zeros(500), session.force.force[:-500]))
    rows = np.column_stack((time, force, gate, held))
    np.savetxt(path, rows, delimiter=',', header='Time [s],Force [N],Trigger,drive', comments='')
    return path


def test_commands_take_a_table_as_load_does(rpms, tmp_path):
    table = trial(tmp_path / 'trial.csv')
    stated = ('--intensity', 'drive')
    code, out, err = rpms('info', table, *stated)
    assert code == 0
    assert 'samples' in out
    assert "'Force [N]' in N, as the file says" in err
    assert rpms('import', table, '--out', tmp_path / 'bag', *stated)[0] == 0
    one, other = (
        json.loads(rpms('identify', place, '--json', *more)[1])
        for place, more in ((table, stated), (tmp_path / 'bag', ()))
    )
    assert one['recruitment'] == other['recruitment']
    page = tmp_path / 'report.html'
    assert rpms('report', table, '--out', page, *stated)[0] == 0
    assert page.stat().st_size > 1e5
    code, _, err = rpms('identify', tmp_path / 'bag', *stated)
    assert (code, 'expected --intensity with a file of a laboratory' in err) == (2, True)
    code, _, err = rpms('info', tmp_path / 'bag', '--time-unit', 'ms')
    assert (code, 'expected --time-unit with a file of a laboratory' in err) == (2, True)
    code, _, err = rpms('identify', table, '--axis', 'x')
    assert (code, 'expected --axis with a recording' in err) == (2, True)


@pytest.mark.skipif(not TRIALS, reason=f'no recordings in {FOLDER} (set RPMS_RECORDINGS)')
@pytest.mark.parametrize('trial', TRIALS, ids=lambda path: path.stem)
def test_real_recordings_are_imported_and_identified(rpms, tmp_path, trial):
    path = tmp_path / 'trial'
    assert rpms('import', trial, '--out', path, *COLUMNS)[0] == 0
    recording = read_recording(path)
    # Trains of 4, 7 or 10 pulses of 5 ms at 100 Hz, sampled every 0.5 ms.
    assert len(recording.pulses) in (4, 7, 10)
    np.testing.assert_allclose(recording.pulses.width, 5e-3, atol=1.1e-3)
    np.testing.assert_allclose(np.diff(recording.pulses.onset_ns), 10e6, atol=1.1e6)
    table = np.loadtxt(trial, delimiter=',', skiprows=1)
    assert recording.forces.force.tolist() == table[:, 3].tolist()
    code, out, err = rpms('identify', path, '--json')
    document = json.loads(out)
    # each estimator on its own finds equal pulses, which these are not: the verdict may doubt
    assert code == {'good': 0, 'doubtful': 1, 'no': 3}[document['verdict']['grade']]
    assert document['curve'] is None
    assert document['faults'] == {}
    assert 'only the product of recruitment and dynamics can be identified' in err
    assert np.isfinite(document['impulse_response']['force']).all()


HOSTILE = '=HYPERLINK("http://x","a")\t\nb'
NOTE = '=Ada Lovelace'
START = 1_700_000_000_123_456_789


def estimate(stamp_ns, name='u_thr'):
    return Estimate(
        stamp_ns=stamp_ns,
        estimator=HOSTILE,
        nonlinear_names=(name, 'u_sat'),
        nonlinear=np.array([0.5, 0.9]),
        nonlinear_covariance=np.diag([0.01, 0.04]),
        nonlinear_identifiability=np.array([CONVERGED, 0]),
        linear_names=(),
        linear=np.empty(0),
        repetition_rate=20.0,
        curve_intensity=np.linspace(0.0, 1.0, 5),
        curve_force=np.linspace(0.0, 8.0, 5),
        curve_lower=np.linspace(0.0, 7.0, 5),
        curve_upper=np.linspace(0.0, 9.0, 5),
        response_time=np.array([0.0, 0.1]),
        response_force=np.array([0.0, 1.0]),
        physiology_names=('latency_s',),
        physiology=np.array([0.009]),
        physiology_lower=np.array([0.008]),
        physiology_upper=np.array([0.010]),
        confidence=0.95,
        output_error=0.02,
        samples=100,
        pulses=3,
        faults={HOSTILE: 2},
    )


def estimates_topic(estimates):
    kind, types = messages.MUSCLE_ESTIMATE, known_types().types
    contents = [encoded(estimate_messages.estimate_message(one, types), kind) for one in estimates]
    return FurtherTopic('/estimate', kind, [one.stamp_ns for one in estimates], contents)


@pytest.fixture
def session(tmp_path):
    """A short session of an awkward start, with odd numbers, a gap and estimates."""
    random = np.random.default_rng(1)
    stamps = START + np.cumsum(random.integers(900_000, 1_100_000, 200))
    force = random.normal(size=200)
    force[[3, 7]] = np.nan, 1e-300
    pulses = PulseTrain(
        stamps[[0, 50, 120]] - [250_000_000, 1, -1],
        np.array([0.07, 1 / 3, 1.0]),
        np.array([7, 8, 10]),
        np.array([1e-4, 2.5e-4, 1e-4]),
    )
    path = tmp_path / 'session'
    estimates = [estimate(int(stamps[99]), HOSTILE), estimate(int(stamps[199]))]
    further = [estimates_topic(estimates)]
    custom = {'patient': NOTE}
    write_recording(path, pulses, ForceTrace(stamps, force), custom=custom, further=further)
    return path


def exported(rpms, session, *options):
    place = session.with_name('exported')
    code, out, err = rpms('export', session, '--out', place, *options)
    assert (code, err) == (0, '')
    assert out == f'{place}: 3 pulses, 200 samples, 2 estimates\n'
    return place


def table(place, name):
    """Return a table as another program reads it, its times in ns as the session has them."""
    origin = int(json.loads((place / 'session.json').read_text())['origin_ns'])
    with (place / f'{name}.csv').open(newline='') as file:
        head, *rows = csv.reader(file)
    times, *columns = zip(*rows, strict=True)
    stamps = [int(Decimal(time).scaleb(9)) + origin for time in times]
    found = dict(zip(head[1:], (np.array(one, float) for one in columns), strict=True))
    return {**found, 'stamp_ns': np.array(stamps)}


def test_every_number_is_there_with_all_of_its_digits(rpms, session):
    place, before = exported(rpms, session), read_recording(session)
    forces, pulses = before.forces, before.pulses
    train = {'intensity': pulses.intensity, 'width_s': pulses.width, 'sequence': pulses.sequence}
    for name, expected in (
        ('force', {'stamp_ns': forces.stamp_ns, 'force_N': forces.force}),
        ('pulses', {'stamp_ns': pulses.onset_ns, **train}),
    ):
        found = table(place, name)
        assert found.keys() == expected.keys()
        for column, values in expected.items():
            np.testing.assert_array_equal(found[column], values)


def test_estimates_are_a_table_that_no_spreadsheet_runs(rpms, session):
    folder = exported(rpms, session)
    with (folder / 'estimates.csv').open(newline='') as file:
        rows = list(csv.reader(file))
    assert all(not cell.startswith(('=', '+', '@', '\t')) for row in rows for cell in row)
    assert all(name.isidentifier() and name.isascii() for name in rows[0])
    table = pd.read_csv(folder / 'estimates.csv')
    assert table['u_thr'].isna().tolist() == [True, False]
    assert table['u_sat_deviation'].tolist() == [0.2, 0.2]
    assert table['u_sat_determined'].tolist() == ['not informed'] * 2
    assert table['steady_force_50'].tolist() == [4.0, 4.0]
    assert table['steady_force_100_upper'].tolist() == [9.0, 9.0]
    assert table['latency_s_lower'].tolist() == [0.008, 0.008]
    assert json.loads(table['faults'][0]) == {HOSTILE: 2}


def test_anonymous_leaves_out_date_name_and_notes(rpms, session):
    named = session.rename(session.with_name('Ada'))
    place = exported(rpms, named, '--anonymous')
    content = b'\n'.join(one.read_bytes() for one in place.iterdir())
    for secret in (b'Ada', b'1700000000', b'2023-11'):
        assert secret not in content
    assert table(place, 'pulses')['stamp_ns'][0] == 0
    steps = np.diff(table(place, 'force')['stamp_ns'])
    np.testing.assert_array_equal(steps, np.diff(read_recording(named).forces.stamp_ns))


def test_nothing_is_replaced_and_nothing_is_half_written(rpms, session, monkeypatch):
    place = session.with_name('there')
    place.write_text('mine')
    code, _, err = rpms('export', session, '--out', place)
    assert code == 2
    assert 'expected nothing at' in err
    assert place.read_text() == 'mine'
    place.unlink()
    before = sorted(session.parent.iterdir())

    def full(*_, **__):
        raise OSError('disk full')

    monkeypatch.setattr('rpms_ros.recording.export.csv.writer', full)
    code, _, err = rpms('export', session, '--out', place)
    assert code == 2
    assert err.endswith('got disk full\n')
    assert sorted(session.parent.iterdir()) == before


def test_a_torque_is_named_as_one(rpms, session, tmp_path):
    recording = read_recording(session)
    further = [estimates_topic([replace(estimate(int(START)), unit='N m')])]
    path = tmp_path / 'torque'
    write_recording(path, recording.pulses, recording.forces, further=further, quantity='torque')
    place = tmp_path / 'exported'
    assert rpms('export', path, '--out', place, '--quantity', 'torque')[0] == 0
    np.testing.assert_array_equal(table(place, 'force')['torque_Nm'], recording.forces.force)
    # the force of a recording whose estimates are of a torque
    code, _, err = rpms('export', path, '--out', tmp_path / 'force')
    assert code == 1
    assert 'expected estimates in N, got N m (--quantity?)' in err
    assert 'the force is 0 in all samples (--axis, --quantity?)' in err
