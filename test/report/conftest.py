# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What tests of reports share: made-up estimates, and a simulated session with a report on it."""

from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import read_recording, write_recording
from rpms_ros.report.course import course_of
from rpms_ros.report.page import as_page
from rpms_ros.report.recorded import recorded_messages
from rpms_ros.report.result import IdentificationOptions, identified, result_of
from rpms_ros.report.session_report import headline_of, report_of
from rpms_ros.schema import plain

START_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope='session')
def made_up(beside):
    """The module of made-up estimates: `estimate`, `session_of`."""
    return beside('made_up_estimates')


def _make_recording(path, low=0.0, custom=None):
    """Ten seconds of a simulated muscle with noise; at `low` = 1 at one intensity."""
    generator = np.random.default_rng(1)
    pulses = PulseTrain.regular(generator.uniform(low, 1.0, 200), 20.0, START_NS)
    muscle = Contraction(simulation_subject(), fixed_rate_hz=20.0)
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = START_NS + np.arange(10_000) * 1_000_000
    force = muscle.force(stamps) + 0.02 * generator.standard_normal(len(stamps))
    write_recording(path, pulses, ForceTrace(stamps, force), custom=custom)
    return path


def _make_report(path):
    """The report on a recording."""
    recording = read_recording(path)
    session = identified(recording, IdentificationOptions('recursive', 'paper_table_4'))
    result = result_of(recording, session)
    return report_of(path.name, recording, recorded_messages(recording), session, result)


def _with_session(report, session):
    """The report on other estimates."""
    result = result_of(report.recording, session)
    headline, course = headline_of(result, session), course_of(session)
    return replace(report, identified=session, result=result, headline=headline, course=course)


@pytest.fixture(scope='session')
def make_report():
    return _make_report


@pytest.fixture(scope='session')
def with_session():
    return _with_session


@pytest.fixture(scope='session')
def recording_path(tmp_path_factory):
    notes = {'coil_type': 'round <90 mm> & "flat"', 'operator': '</script><b>'}
    return _make_recording(tmp_path_factory.mktemp('report') / 'leg & <arm>', custom=notes)


@pytest.fixture(scope='session')
def report(recording_path):
    return _make_report(recording_path)


@pytest.fixture(scope='session')
def constant_report(tmp_path_factory):
    """The report on pulses of one intensity."""
    return _make_report(_make_recording(tmp_path_factory.mktemp('report') / 'constant', low=1.0))


@pytest.fixture
def with_last(report):
    """Change fields of the last estimate of the report."""

    def changed(**fields):
        *before, last = report.identified.estimates
        estimates = [*before, replace(last, **fields)]
        return _with_session(report, replace(report.identified, estimates=estimates))

    return changed


@pytest.fixture(scope='session')
def document(report):
    found = plain(report)
    assert isinstance(found, dict)
    return found


@pytest.fixture(scope='session')
def page(report):
    return as_page(report)


@pytest.fixture
def without_figures(monkeypatch):
    """Pages whose text alone is looked at: drawing takes most of their time."""
    monkeypatch.setattr('rpms_ros.report.page.as_svg', lambda *_: b'<svg/>')
