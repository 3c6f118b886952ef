# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A simulated session with a report on it, made once."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rpms_ros.identification import ModifiedRecursiveLM
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import read_recording, write_recording
from rpms_ros.report.recorded import recorded_messages
from rpms_ros.report.result import IdentificationOptions, identified, result_of
from rpms_ros.report.session import SessionAnalysis, analyse, as_document, as_page
from rpms_ros.report.session.analysis import ReportSettings
from rpms_ros.stimulation.limits.device_specification import load_device_specification

START_NS = 1_700_000_000_000_000_000


def _make_recording(path: Path, low: float = 0.0, custom: dict[str, str] | None = None) -> Path:
    """Ten seconds of a simulated muscle with noise; at `low` = 1 at one intensity."""
    generator = np.random.default_rng(1)
    pulses = PulseTrain.regular(generator.uniform(low, 1.0, 200), 20.0, START_NS)
    muscle = Contraction(simulation_subject(), fixed_rate_hz=20.0)
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = START_NS + np.arange(10_000) * 1_000_000
    force = muscle.force(stamps) + 0.02 * generator.standard_normal(len(stamps))
    write_recording(path, pulses, ForceTrace(stamps, force), custom=custom)
    return path


def _make_analysis(path: Path, settings: ReportSettings | None = None) -> SessionAnalysis:
    """What `rpms report` analyses."""
    recording = read_recording(path)
    session = identified(recording, IdentificationOptions('recursive', 'paper_table_4'))
    return analyse(
        path.name,
        recording,
        recorded_messages(path),
        session,
        result_of(recording, session),
        ModifiedRecursiveLM,
        settings,
    )


@pytest.fixture(scope='session')
def make_recording() -> Callable[..., Path]:
    return _make_recording


@pytest.fixture(scope='session')
def make_analysis() -> Callable[..., SessionAnalysis]:
    return _make_analysis


@pytest.fixture(scope='session')
def recording_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    notes = {'coil_type': 'round <90 mm> & "flat"', 'operator': '</script><b>'}
    return _make_recording(tmp_path_factory.mktemp('report') / 'leg & <arm>', custom=notes)


@pytest.fixture(scope='session')
def analysis(recording_path: Path) -> SessionAnalysis:
    settings = ReportSettings(
        device=load_device_specification('rapid2-240v'), stated={'age': '34'}
    )
    return _make_analysis(recording_path, settings)


@pytest.fixture(scope='session')
def document(analysis: SessionAnalysis) -> dict[str, Any]:
    return as_document(analysis)


@pytest.fixture(scope='session')
def page(analysis: SessionAnalysis, document: dict[str, Any]) -> str:
    return as_page(analysis, document)
