# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""rpms study: one table of many recordings, however it is worked out."""

import csv
import json
import shutil
from pathlib import Path

import pytest

from rpms_ros.cli import main
from rpms_ros.report.study import StudyOptions, StudyTable, columns, found_recordings

COUNT = 4


@pytest.fixture(scope='module')
def sessions(tmp_path_factory):
    """Four recordings of two seconds, one of them without a force, in a folder."""
    folder = tmp_path_factory.mktemp('study') / 'sessions'
    for number in range(COUNT):
        path = folder / f'session_{number}'
        options = ['--duration', '2', '--seed', str(number), '--quiet']
        assert main(['simulate', '--out', str(path), *options]) == 0
    return folder


@pytest.fixture(scope='module')
def expected(sessions, tmp_path_factory):
    """The table of one process."""
    folder = tmp_path_factory.mktemp('study') / 'one'
    assert main(['study', str(sessions), '--out', str(folder), '--jobs', '1', '--quiet']) == 0
    return (folder / 'results.csv').read_bytes()


def table_of(folder):
    with (folder / 'results.csv').open(newline='') as file:
        return list(csv.DictReader(file))


def test_one_row_a_recording(sessions, expected):
    rows = list(csv.DictReader(expected.decode().splitlines()))
    assert [row['recording'] for row in rows] == [
        str(sessions / f'session_{number}') for number in range(COUNT)
    ]
    assert list(rows[0]) == columns()
    for row in rows:
        assert (row['status'], row['samples'], row['pulses']) == ('ok', '2000', '40')
        assert (row['verdict'], bool(row['reasons'])) == ('good', True)
        assert float(row['u_thr']) < float(row['u_sat'])
        assert 0 < float(row['steady_force_50']) < float(row['steady_force_100'])
        for name in ('u_thr', 'steady_force_50', 'steady_force_100', 'twitch_peak_n'):
            assert float(row[f'{name}_lower']) < float(row[name]) < float(row[f'{name}_upper'])
        assert int(row['start_ns']) == 1_700_000_000_000_000_000
        assert len(row['session_hash']) == 64


@pytest.mark.long
def test_table_does_not_depend_on_the_number_of_processes(rpms, sessions, expected, tmp_path):
    code, out, err = rpms('study', sessions, '--out', tmp_path / 'two', '--jobs', 2)
    assert (code, err) == (0, '')
    assert out == f'{tmp_path / "two"}: 4 recordings, 0 failed, 0 done before; verdicts: 4 good\n'
    assert (tmp_path / 'two' / 'results.csv').read_bytes() == expected


def test_failures_are_rows_with_their_reason_and_tried_again(rpms, sessions, tmp_path):
    folder = tmp_path / 'sessions'
    shutil.copytree(sessions / 'session_0', folder / 'good')
    shutil.copytree(sessions / 'session_1', folder / 'bad')
    (folder / 'bad' / 'session_1_0.mcap').write_bytes(b'')
    missing = tmp_path / 'missing'
    out = tmp_path / 'table'
    code, text, err = rpms('study', folder, missing, '--out', out, '--jobs', 1)
    assert code == 1
    assert text.endswith('3 recordings, 2 failed, 0 done before; verdicts: 1 good\n')
    assert f'rpms: {folder / "bad"}: expected' in err
    assert f'rpms: {missing}: expected' in err
    bad, good, nothing = table_of(out)
    assert (bad['status'], good['status'], nothing['status']) == ('failed', 'ok', 'failed')
    assert bad['reason'].endswith('got an empty file')
    assert nothing['reason'].endswith('got no such file or folder')
    shutil.copy(sessions / 'session_1' / 'session_1_0.mcap', folder / 'bad')
    code, text, _ = rpms('study', folder, '--out', out, '--jobs', 1)
    assert (code, text) == (0, f'{out}: 2 recordings, 0 failed, 1 done before; verdicts: 2 good\n')


def test_goes_on_where_it_stopped(rpms, sessions, expected, tmp_path):
    rpms('study', sessions / 'session_2', '--out', tmp_path, '--jobs', 1)
    _, text, _ = rpms('study', sessions, '--out', tmp_path, '--jobs', 1)
    assert text == f'{tmp_path}: 4 recordings, 0 failed, 1 done before; verdicts: 4 good\n'
    assert (tmp_path / 'results.csv').read_bytes() == expected
    # Other options, or a recording that has changed, are other rows.
    options = ['--out', tmp_path, '--jobs', 1, '--rate-hz', 10]
    _, text, _ = rpms('study', sessions / 'session_2', *options)
    assert text == f'{tmp_path}: 1 recording, 0 failed, 0 done before; verdicts: 1 good\n'


def test_interrupted_study_keeps_what_is_done(sessions, tmp_path, monkeypatch):
    from rpms_ros.report import study

    def interrupted(paths, options, *_):
        yield paths[0], study.work(str(paths[0]), options)
        raise KeyboardInterrupt

    monkeypatch.setattr(study, 'finished', interrupted)
    assert main(['study', str(sessions), '--out', str(tmp_path)]) == 130
    monkeypatch.undo()
    assert [row['status'] for row in table_of(tmp_path)] == ['ok']
    assert [row['status'] for row in json.loads((tmp_path / 'results.json').read_text())] == ['ok']


def test_a_name_is_no_formula(tmp_path, monkeypatch):
    name = '=HYPERLINK("http:evil","click")'
    monkeypatch.chdir(tmp_path)
    Path(name).mkdir()
    (Path(name) / 'bag_0.mcap').write_bytes(b'')
    assert main(['study', name, '--out', 'study', '--jobs', '1', '--quiet']) == 1
    (row,) = table_of(Path('study'))
    assert row['recording'] == f"'{name}"
    assert row['status'] == 'failed'


@pytest.mark.long
def test_earlier_results_are_no_recordings(rpms, sessions, tmp_path):
    """What the README says, `rpms study out/* --out out/study`, twice."""
    out = tmp_path / 'out'
    shutil.copytree(sessions / 'session_0', out / 'session')
    rpms('identify', out / 'session', '--out', out / 'results')
    rpms('report', out / 'session', '--out', out / 'report.html', '--files', out / 'figures')
    for done in (0, 1):
        given = sorted(out.iterdir())
        code, text, _ = rpms('study', *given, '--out', out / 'study', '--jobs', 1)
        assert (code, text.split('; ')[0].split(': ')[1]) == (
            0,
            f'1 recording, 0 failed, {done} done before',
        )
    # a study below a folder that is looked through is no recording either
    assert found_recordings([out], out / 'study') == [out / 'session']
    # an empty folder, and a text that nobody of us wrote, are still told
    (out / 'empty').mkdir()
    assert found_recordings([out / 'empty'], out / 'study') == [out / 'empty']


def test_a_verdict_that_is_not_good_is_told(rpms, sessions, tmp_path):
    options = ['--out', tmp_path, '--jobs', 1, '--sign', -1]
    code, text, err = rpms('study', sessions / 'session_0', *options)
    assert code == 1
    assert text.endswith('; verdicts: 1 no\n')
    assert 'no: the force comes out negative' in err
    (row,) = table_of(tmp_path)
    assert (row['status'], row['verdict']) == ('ok', 'no')


def test_nothing_to_study_is_an_error(rpms, tmp_path):
    table = tmp_path / 'trial.csv'
    table.write_text('time,force\n')
    code, out, err = rpms('study', table, '--out', tmp_path / 'study')
    assert (code, out) == (2, '')
    assert f'expected recordings or folders of recordings, got none in {table}' in err
    assert not (tmp_path / 'study').exists()


def test_what_counts_twice_and_what_is_not_comparable_is_told(tmp_path):
    same, models = {'session_hash': '0a'}, ('history law', None)
    paths = [Path('a'), Path('b')]
    table = StudyTable(tmp_path, paths, StudyOptions())
    for path, model in zip(paths, models, strict=True):
        table.add(
            path, {'status': 'ok', 'twitch_time_constant_s': 0.03, 'train_model': model} | same
        )
    twice, different = table.remarks()
    assert twice == 'a, b hold the same pulses and forces: they count more than once'
    assert 'different models (history law, response to one pulse)' in different
