# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Fewer estimates are a choice among those on line, and change nothing of the result."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from rpms_ros.recording import read_recording
from rpms_ros.report.result import FOLLOWED, IdentificationOptions, identified

Rpms = Callable[..., tuple[int, str, str]]


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
