# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""rpms report: what it writes, and the schedule and the hash of the session in every command."""

import hashlib
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.cli.options import FAILURE
from rpms_ros.recording import read_recording, session_hash, write_recording
from rpms_ros.recording.rosbag.definitions import encoded, known_types
from rpms_ros.recording.rosbag.reading import ACCEPTED_SCHEDULE
from rpms_ros.recording.rosbag.writing import FurtherTopic
from rpms_ros.report.figures import FIGURES


def embedded(page):
    """The document that a page carries."""
    return json.loads(re.search(r'id="report">(.*?)</script>', page, re.DOTALL)[1])


@pytest.mark.long
def test_page_json_and_files_say_the_same_as_identify(as_json, short_session, tmp_path):
    page, files = tmp_path / 'new' / 'report.html', tmp_path / 'files'
    printed = as_json('report', short_session, '--out', page, '--files', files, '--json')
    assert embedded(page.read_text()) == printed
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
    code, out, err = rpms('report', short_session, '--out', page, '--title', 'Leg 7')
    assert (code, err) == (0, '')
    assert out.startswith('verdict good: the identified muscle explains')
    assert f'\n{page}: ' in out
    document = embedded(page.read_text())
    assert document['title'] == 'Leg 7'


def test_a_file_that_is_no_page_is_not_replaced(rpms, short_session, tmp_path):
    kept = tmp_path / 'session.csv'
    kept.write_text('t,f\n')
    code, _, err = rpms('report', short_session, '--out', kept)
    assert (code, kept.read_text()) == (FAILURE, 't,f\n')
    assert err == f'rpms: error: expected a page (.html) with --out, got a file {kept}\n'
    code, _, err = rpms('report', short_session, '--out', tmp_path / 'new.pdf')
    assert (code, (tmp_path / 'new.pdf').exists()) == (FAILURE, False)


TEXT = 'name: warm-up\nsegments: [{kind: single, intensity: 1}]\n'
HASH = hashlib.sha256(TEXT.encode()).hexdigest()


def accepted(name='warm-up', digest=HASH, duration=10.0):
    """A schedule of 200 pulses that was accepted at 10^18 ns, serialised."""
    types = known_types().types
    header = types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](10**9, 0), 'coil')
    message = types[ACCEPTED_SCHEDULE](header, name, TEXT, digest, 'ada', 200, duration)
    return encoded(message, ACCEPTED_SCHEDULE)


def with_schedules(source, path, *messages, width=None):
    """Return a copy of a recording with schedules that were accepted before the rest came."""
    recording = read_recording(source)
    time_ns = [int(recording.pulses.onset_ns[0])] * len(messages)
    further = [FurtherTopic('/accepted_schedule', ACCEPTED_SCHEDULE, time_ns, messages)]
    pulses = recording.pulses if width is None else replace(recording.pulses, width=width)
    write_recording(path, pulses, recording.forces, further=further)
    return path


def test_info_verify_and_identify_show_schedule_and_session(rpms, short_session, tmp_path):
    announced = with_schedules(short_session, tmp_path / 'announced', accepted())
    code, out, err = rpms('info', announced)
    assert (code, err) == (0, '')
    line = f'warm-up, 200 pulses, 10 s, started by ada, sha256 {HASH}'
    assert f'accepted: {line}' in ' '.join(out.split())
    code, out, _ = rpms('verify', announced)
    assert code == 0
    assert f'ok       {line}' in out
    (schedule,) = json.loads(rpms('info', announced, '--json')[1])['schedules']
    assert (schedule['name'], schedule['sha256']) == ('warm-up', HASH)
    assert (schedule['pulses'], schedule['accepted_ns']) == (200, 10**18)
    code, out, _ = rpms('identify', announced)
    assert code == 0
    assert f'warm-up, sha256 {HASH}' in ' '.join(out.split())
    assert session_hash(read_recording(announced)) in out
    document = json.loads(rpms('identify', announced, '--json')[1])
    assert [one['sha256'] for one in document['schedules']] == [HASH]


def test_a_text_that_does_not_fit_its_hash_is_named(rpms, short_session, tmp_path):
    path = with_schedules(short_session, tmp_path / 'bag', accepted(digest='0' * 64))
    code, out, _ = rpms('verify', path)
    assert code == 1
    assert 'FAULT    /accepted_schedule: the text of warm-up is not the one whose hash' in out
    assert json.loads(rpms('info', path, '--json')[1])['faults'] == {'altered_schedule': 1}


def test_hostile_schedules_are_left_out_or_made_harmless(rpms, short_session, tmp_path):
    moving = accepted('\x1b[2J\n' + 'x' * 5000, duration=math.nan)
    path = with_schedules(short_session, tmp_path / 'bag', moving, accepted()[:30], b'\0\1')
    code, out, _ = rpms('info', path, '--json')
    document = json.loads(out, parse_constant=pytest.fail)
    assert code == 1
    assert document['faults'] == {'undecodable_message': 2}
    (schedule,) = document['schedules']
    assert schedule['name'].isprintable()
    assert len(schedule['name']) == 200
    assert schedule['duration_s'] is None


def test_a_report_holds_hash_and_schedule_and_takes_widths_that_are_no_number(
    rpms, short_session, tmp_path
):
    widths = np.full(200, math.nan)
    path = with_schedules(short_session, tmp_path / 'bag', accepted(), width=widths)
    code, _, err = rpms('report', path, '--out', tmp_path / 'page.html')
    assert (code, err) == (0, '')
    page = (tmp_path / 'page.html').read_text()
    visible = page[: page.index('<script type="application/json"')]
    assert session_hash(read_recording(path)) in visible
    assert HASH in visible
    assert 'warm-up: 200 pulses' in visible
    report = embedded(page)
    assert report['schedule']['pulse_width_s'] == []


def test_every_command_that_reads_keeps_to_its_memory(rpms, short_session, tmp_path):
    bound = ['--max-memory', '0.0001']
    refused = 'expected a recording that can be read within 0.0001 GB (--max-memory allows more)'
    commands = [
        ['info', short_session],
        ['verify', short_session],
        ['identify', short_session],
        ['analyze', short_session],
        ['report', short_session, '--out', tmp_path / 'page.html'],
    ]
    for command in commands:
        code, out, err = rpms(*command, *bound)
        assert (code, out) == (2, ''), command
        assert refused in err
        assert err.count('\n') == 1
