# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`rpms report`: what it writes and prints, what it refuses."""

import json

import pytest

from rpms_ros.recording import read_recording, write_recording
from rpms_ros.report.figures import FIGURES
from rpms_ros.report.page import embedded


@pytest.mark.long
def test_page_json_and_files_say_the_same_as_identify(as_json, short_session, tmp_path):
    page, files = tmp_path / 'new' / 'report.html', tmp_path / 'files'
    printed = as_json('report', short_session, '--out', page, '--files', files, '--json')
    assert embedded(page.read_text(), 'report') == printed
    assert json.loads((files / 'report.json').read_text()) == printed
    assert printed['result'] == as_json('identify', short_session, '--json')
    assert {path.name for path in files.iterdir()} == {
        'report.json',
        *(f'{name}.{ending}' for name in FIGURES if name != 'parameters'
          for ending in ('png', 'svg')),
    }  # fmt: skip
    assert printed['title'] == 'short'
    assert printed['session']['notes']['schedule'] == 'uniform_random'
    assert printed['schedule']['full_intensity_pulses'] > 0


def test_the_title_is_the_muscle_that_the_notes_name(as_json, short_session, tmp_path):
    recording, named = read_recording(short_session), tmp_path / 'visit_7'
    write_recording(named, recording.pulses, recording.forces, custom={'muscle': 'soleus'})
    assert as_json('report', named, '--out', tmp_path / 'page', '--json')['title'] == 'soleus'


def test_what_is_stated_goes_into_the_page(rpms, short_session, tmp_path):
    page = tmp_path / 'report.html'
    code, out, err = rpms(
        'report', short_session, '--out', page, '--title', 'Leg 7', '--held-out', '0.5'
    )
    assert (code, err) == (0, '')
    assert out.startswith('verdict good: the identified muscle explains')
    assert f'\n{page}: ' in out
    document = embedded(page.read_text(), 'report')
    assert document['title'] == 'Leg 7'
    assert document['held_out']['held_out_s'] == pytest.approx(5.0, abs=2e-3)


@pytest.mark.parametrize(
    ('arguments', 'expected'),
    [
        (['--held-out', '1'], 'expected to hold out a share between 0 and 1, got 1.0'),
        (['--estimator', 'oracle'], 'expected an estimator of'),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(rpms, short_session, tmp_path, arguments, expected):
    page = tmp_path / 'report.html'
    code, out, err = rpms('report', short_session, '--out', page, *arguments)
    assert (code, out) == (2, '')
    assert err.startswith('rpms: error: ')
    assert expected in err
    assert err.count('\n') == 1
    assert not page.exists()
