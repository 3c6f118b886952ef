# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Fewer estimates are a choice among those on line, and change nothing of the result."""

import json
import re
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from rpms_ros.identification import Estimate
from rpms_ros.recording import read_recording
from rpms_ros.report.result import FOLLOWED, IdentificationOptions, identified

Rpms = Callable[..., tuple[int, str, str]]


def assert_same_bits(one: Estimate, other: Estimate) -> None:
    for field in fields(Estimate):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))


@pytest.mark.long
@pytest.mark.parametrize('estimator', ['recursive', 'tracking'])
@pytest.mark.parametrize(('most', 'made'), [(1, 7), (7, 7), (30, 25), (1000, 100)])
def test_fewer_estimates_are_among_all_of_them(
    short_session: Path, estimator: str, most: int, made: int
) -> None:
    recording = read_recording(short_session)
    options = IdentificationOptions(estimator)
    every = identified(recording, options)
    few = identified(recording, options, most_estimates=most)
    on_line = {estimate.stamp_ns: estimate for estimate in every.estimates}
    assert len(every.estimates) == 100
    assert len(few.estimates) == made
    for estimate in few.estimates:
        assert_same_bits(estimate, on_line[estimate.stamp_ns])
    assert few.last.stamp_ns == every.last.stamp_ns
    np.testing.assert_array_equal(few.prediction, every.prediction)


@pytest.mark.long
def test_a_muscle_that_changed_is_followed_in_place_of_a_mixture(
    rpms: Rpms, tmp_path: Path
) -> None:
    path, state = tmp_path / 'tired', tmp_path / 'state'
    rpms('simulate', '--out', path, '--duration', 20, '--scenario', 'fatigue', '--noise', 0.05)
    options = ('--save-state', state, '--out', tmp_path / 'results')
    _, text, _ = rpms('identify', path, *options)
    found = json.loads((tmp_path / 'results' / 'result.json').read_text())
    assert found['estimator'] == 'tracking'
    assert FOLLOWED in found['notes']
    assert 'force_percent' in found['rates']
    assert re.search('estimator +followed by tracking', text)
    # What is saved is what is returned: tracking takes bases of its own.
    recording = read_recording(path)
    tracked = identified(recording, IdentificationOptions('tracking'), most_estimates=1)
    assert found['curve']['force'] == tracked.last.curve_force.tolist()
    assert b'tracking' in state.read_bytes()
    # Who asks for a table of the paper has chosen the model.
    fixed = identified(recording, IdentificationOptions(preset='paper_table_5'))
    assert fixed.last.estimator == 'batch'
