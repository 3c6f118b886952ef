# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""rpms import: what it guesses, asks and refuses; every real recording."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rpms_ros
from rpms_ros.recording import read_recording

Rpms = Callable[..., tuple[int, str, str]]
COLUMNS = ['--time', 'Time [s]', '--force', 'fGM [N]', '--pulse', 'STIM [ ]']
FOLDER = Path(os.environ.get('RPMS_RECORDINGS', Path(__file__).parents[2] / '../shared/data'))
TRIALS = sorted((FOLDER / 'rat_gastrocnemius').glob('*.csv'))


def test_a_table_becomes_a_recording(rpms: Rpms, tmp_path: Path) -> None:
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


def test_what_is_guessed_is_shown(rpms: Rpms, tmp_path: Path) -> None:
    (tmp_path / 'trial.csv').write_text(TABLE, encoding='utf-16')
    code, out, err = rpms('import', tmp_path / 'trial.csv', '--out', tmp_path / 'bag')
    assert (code, out) == (0, f'{tmp_path / "bag"}: 4 pulses, 40 samples, 0.039 s\n')
    for text in ("'kraft' in N", "'time' in ms", "'trigger'", 'decimal comma', 'UTF-16'):
        assert text in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ['bag', 'trial.csv']


def test_what_is_ambiguous_is_refused_and_nothing_is_written(rpms: Rpms, tmp_path: Path) -> None:
    table = tmp_path / 'trial.csv'
    table.write_text('time;kraft [N];force [N];trigger\n0;1;2;0\n1;1;2;5\n2;1;3;0\n')
    code, out, err = rpms('import', table, '--out', tmp_path / 'bag')
    assert (code, out) == (2, '')
    assert '--force COL decides' in err
    assert [path.name for path in tmp_path.iterdir()] == ['trial.csv']
    code, _, err = rpms('import', table, '--out', tmp_path / 'bag', '--force', 'force [N]')
    assert code == 0


def test_what_fails_while_it_is_written_leaves_nothing(
    rpms: Rpms, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def half(path: Path, *_: object, **__: object) -> None:
        path.mkdir()
        (path / 'half').write_text('')
        raise OSError('disk full')

    monkeypatch.setattr('rpms_ros.recording.write_recording', half)
    (tmp_path / 'trial.csv').write_text(TABLE)
    code, _, err = rpms('import', tmp_path / 'trial.csv', '--out', tmp_path / 'bag')
    assert code == 2
    assert err.endswith('got disk full\n')
    assert [path.name for path in tmp_path.iterdir()] == ['trial.csv']


def trial(path: Path) -> Path:
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


def test_commands_take_a_table_as_load_does(rpms: Rpms, tmp_path: Path) -> None:
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
    code, _, err = rpms('identify', table, '--axis', 'x')
    assert (code, 'expected --axis with a recording' in err) == (2, True)


@pytest.mark.skipif(not TRIALS, reason=f'no recordings in {FOLDER} (set RPMS_RECORDINGS)')
def test_there_are_24_trials() -> None:
    assert len(TRIALS) == 24


@pytest.mark.skipif(not TRIALS, reason=f'no recordings in {FOLDER} (set RPMS_RECORDINGS)')
@pytest.mark.parametrize('trial', TRIALS, ids=lambda path: path.stem)
def test_real_recordings_are_imported_and_identified(
    rpms: Rpms, tmp_path: Path, trial: Path
) -> None:
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
