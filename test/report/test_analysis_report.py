# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Document, table and figures of a muscle analysis."""

import json
from dataclasses import replace

import pytest

from rpms_ros.identification.analysis import analyze
from rpms_ros.muscle import average_subject
from rpms_ros.muscle.simulation import simulated_force
from rpms_ros.pulses import PulseTrain
from rpms_ros.report.analysis_figures import draw_analysis, draw_trains
from rpms_ros.report.analysis_report import analysis_document, analysis_text
from rpms_ros.stimulation import Schedule
from rpms_ros.stimulation.schedule.protocols import recruitment, trains, twitches


@pytest.fixture(scope='module')
def whole():
    """Return the analysis of everything in small."""
    parts = (
        twitches(intensities=(0.7, 1.0), repetitions=2),
        trains(rates_hz=(20.0,), duration_s=0.6, rest_s=1.5),
        recruitment(rates_hz=(15.0, 25.0, 35.0), levels=(0.0, 0.25, 0.5, 0.75, 1.0), rest_s=1.5),
    )
    schedule = Schedule(tuple(segment for part in parts for segment in part.segments))
    pulses = schedule.pulses()
    return analyze(pulses, simulated_force(average_subject(), pulses, schedule.length_s))


@pytest.fixture(scope='module')
def empty():
    pulses = PulseTrain.of([])
    return analyze(pulses, simulated_force(average_subject(), pulses, 2.0))


def test_the_document_is_json_without_nan_also_without_pulses(whole, empty):
    document = json.loads(json.dumps(analysis_document(whole), allow_nan=False))
    assert document['twitches']['choice']['order'] == 3
    assert document['twitches']['latency']['rows'][0]['count'] == 2
    assert document['summation']['law'].keys() == {
        'half_level', 'cooperation', 'facilitation', 'facilitation_decay', 'series_lag',
    }  # fmt: skip
    assert document['recruitment']['parameters']['threshold']['lower'] < 0.5
    assert len(document['steady']) >= 15
    document = analysis_document(empty)
    assert document['twitches'] is None
    assert document['artifacts'] is None
    assert 'no pulses' in document['findings'][0]


def test_a_recording_is_a_list_of_all_that_was_found(whole, empty):
    text, other = analysis_text([whole, empty], ['full', 'none']).split('\n\n')
    name, *lines = text.splitlines()
    assert (name, other.splitlines()[0]) == ('full', 'none')
    rows = {line[2:28].strip(): line for line in lines}
    assert '7 single pulses' in rows['recording']
    assert rows['threshold'].split()[1].startswith('48')
    assert max(map(len, lines)) <= 100


def test_every_part_has_its_figure(whole, tmp_path):
    drawn = draw_analysis(tmp_path, whole, 'session')
    assert [path.name for path in drawn] == ['twitches.png', 'trains.png', 'recruitment.png']
    for path in drawn:
        assert path.read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize(
    ('count', 'drawn', 'title'), [(1, 1, ''), (12, 12, ''), (30, 24, '24 of 30 trains')]
)
def test_every_train_is_drawn_or_the_title_says_how_many(whole, count, drawn, title):
    found = replace(whole.summation, trains=whole.summation.trains[:1] * count)
    figure = draw_trains(found)
    *panels, gains = figure.axes
    assert len(panels) == drawn
    # the gains of every train, and the line of equal pulses
    assert len(gains.get_lines()) == count + 1
    assert title in (figure.get_suptitle() or '')
    assert bool(figure.get_suptitle()) is bool(title)
