# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""rpms export: other readers find the same numbers in it."""

import csv
import json
from array import array
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.io import loadmat

from rpms_ros import estimate_messages, messages
from rpms_ros.identification import CONVERGED, Estimate
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import FurtherTopic, read_recording, write_recording
from rpms_ros.recording.rosbag.definitions import known_types

Rpms = Callable[..., tuple[int, str, str]]
FORMATS = ('csv', 'mat')
HOSTILE = '=HYPERLINK("http://x","a")\t\nb'
NOTE = '=Ada Lovelace'
START = 1_700_000_000_123_456_789


def estimate(stamp_ns: int, name: str = 'u_thr') -> Estimate:
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


def estimates_topic(estimates: list[Estimate]) -> FurtherTopic:
    types = known_types()
    built = [estimate_messages.estimate_message(one, types.types) for one in estimates]
    for message in built:
        # rosbags takes arrays of NumPy only
        for name, value in vars(message).items():
            if isinstance(value, array):
                setattr(message, name, np.array(value))
    kind = messages.MUSCLE_ESTIMATE
    encoded = [bytes(types.serialize_cdr(message, kind)) for message in built]
    return FurtherTopic('/estimate', kind, [one.stamp_ns for one in estimates], encoded)


@pytest.fixture
def session(tmp_path: Path) -> Path:
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


def exported(rpms: Rpms, session: Path, kind: str, *options: object) -> Path:
    place = session.with_name('exported.mat' if kind == 'mat' else f'exported-{kind}')
    code, out, err = rpms('export', session, '--to', kind, '--out', place, *options)
    assert (code, err) == (0, '')
    assert out == f'{place}: 3 pulses, 200 samples, 2 estimates\n'
    return place


def tables(place: Path) -> dict[str, dict[str, Any]]:
    """Return force and pulses as another program reads them, times in ns after the first."""
    if place.is_file():
        content = loadmat(place, simplify_cells=True)
        found = {name: dict(content[name]) for name in ('force', 'pulses')}
        origin = int(content['session']['origin_ns'])
        for table in found.values():
            assert (table['stamp_ns'] - origin == np.rint(1e9 * table['time_s'])).all()
        return found
    origin = int(json.loads((place / 'session.json').read_text())['origin_ns'])
    found = {}
    for name in ('force', 'pulses'):
        with (place / f'{name}.csv').open(newline='') as file:
            head, *rows = csv.reader(file)
        times, *columns = zip(*rows, strict=True)
        found[name] = dict(zip(head[1:], (np.array(one, float) for one in columns), strict=True))
        stamps = [int(Decimal(time).scaleb(9)) + origin for time in times]
        found[name]['stamp_ns'] = np.array(stamps)
    return found


@pytest.mark.parametrize('kind', FORMATS)
def test_every_number_is_there_with_all_of_its_digits(
    rpms: Rpms, session: Path, kind: str
) -> None:
    found, before = tables(exported(rpms, session, kind)), read_recording(session)
    np.testing.assert_array_equal(found['force']['stamp_ns'], before.forces.stamp_ns)
    np.testing.assert_array_equal(found['force']['force_N'], before.forces.force)
    np.testing.assert_array_equal(found['pulses']['stamp_ns'], before.pulses.onset_ns)
    for name, values in (
        ('intensity', before.pulses.intensity),
        ('width_s', before.pulses.width),
        ('sequence', before.pulses.sequence),
    ):
        np.testing.assert_array_equal(found['pulses'][name], values)


def test_estimates_are_a_table_that_no_spreadsheet_runs(rpms: Rpms, session: Path) -> None:
    folder = exported(rpms, session, 'csv')
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


@pytest.mark.parametrize('kind', FORMATS)
def test_anonymous_leaves_out_date_name_and_notes(rpms: Rpms, session: Path, kind: str) -> None:
    named = session.rename(session.with_name('Ada'))
    place = exported(rpms, named, kind, '--anonymous')
    files = [place] if place.is_file() else [one for one in place.rglob('*') if one.is_file()]
    content = b'\n'.join(one.read_bytes() for one in files)
    if kind == 'mat':
        content = repr(loadmat(place, simplify_cells=True)).encode()
    for secret in (b'Ada', b'1700000000', b'2023-11'):
        assert secret not in content
    found, before = tables(place), read_recording(named)
    assert found['pulses']['stamp_ns'][0] == 0
    steps = np.diff(found['force']['stamp_ns'])
    np.testing.assert_array_equal(steps, np.diff(before.forces.stamp_ns))


@pytest.mark.parametrize('kind', FORMATS)
def test_nothing_is_replaced_and_nothing_is_half_written(
    rpms: Rpms, session: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = session.with_name('there.mat')
    place.write_text('mine')
    code, _, err = rpms('export', session, '--to', kind, '--out', place)
    assert code == 2
    assert 'expected nothing at' in err
    assert place.read_text() == 'mine'
    place.unlink()
    before = sorted(session.parent.iterdir())

    def full(*_: object, **__: object) -> None:
        raise OSError('disk full')

    name = {'csv': 'csv.writer', 'mat': 'scipy.io.savemat'}[kind]
    monkeypatch.setattr(f'rpms_ros.recording.export.{name}', full)
    code, _, err = rpms('export', session, '--to', kind, '--out', place)
    assert code == 2
    assert err.endswith('got disk full\n')
    assert sorted(session.parent.iterdir()) == before


def test_a_matlab_file_is_called_one(rpms: Rpms, session: Path) -> None:
    code, _, err = rpms('export', session, '--to', 'mat', '--out', 'a')
    assert code == 2
    assert 'expected a file that ends with .mat' in err


def test_a_torque_is_named_as_one(rpms: Rpms, session: Path, tmp_path: Path) -> None:
    recording = read_recording(session)
    further = [estimates_topic([replace(estimate(int(START)), unit='N m')])]
    path = tmp_path / 'torque'
    write_recording(path, recording.pulses, recording.forces, further=further, quantity='torque')
    for kind in FORMATS:
        place = tmp_path / f'{kind}.mat'
        assert rpms('export', path, '--to', kind, '--out', place, '--quantity', 'torque')[0] == 0
        torque = tables(place)['force']['torque_Nm']
        np.testing.assert_array_equal(torque, recording.forces.force)
    # the force of a recording whose estimates are of a torque
    code, _, err = rpms('export', path, '--to', 'csv', '--out', tmp_path / 'force')
    assert code == 1
    assert 'expected estimates in N, got N m (--quantity?)' in err
