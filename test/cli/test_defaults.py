# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What comes out where nobody chooses an estimator or a preset."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rpms_ros.nodes.identifier import IdentifierParameters, build_estimator

# Of `rpms simulate`: steady force at full intensity, and peak of the response to one pulse [N].
FULL, PEAK = 10.0, 3.52
# Twice what 18 s of a sinusoid with 0.2 % noise leave open, by the intervals of the estimate.
NEAR_FULL, NEAR_PEAK = 0.005, 0.03


def test_a_short_sinusoid_with_noise_is_right_or_is_said_not_to_be(
    rpms: Callable[..., tuple[int, str, str]], as_json: Callable[..., Any], tmp_path: Path
) -> None:
    session = tmp_path / 'session'
    rpms(
        *('simulate', '--out', session, '--schedule', 'sinusoid', '--duration', 18),
        *('--noise', 0.02, '--quiet'),
    )
    found = as_json('identify', session, '--json')
    assert found['estimator'] == 'batch'
    assert found['curve']['force'][-1] == pytest.approx(FULL, rel=NEAR_FULL)
    assert max(found['impulse_response']['force']) == pytest.approx(PEAK, rel=NEAR_PEAK)
    assert found['physiology']['twitch_peak_n']['value'] == pytest.approx(PEAK, rel=0.05)
    # The paper's recursion is far off, and that is said.
    paper = ('--estimator', 'recursive', '--preset', 'paper_table_4')
    code, out, _ = rpms('identify', session, *paper)
    assert code == 3
    assert 'no: ' in out
    assert 'steady force' not in out


def test_the_sample_of_the_readme_has_the_saturation_that_it_was_made_with(
    as_json: Callable[..., Any],
) -> None:
    sample = Path(__file__).parents[2] / 'bags' / 'sample'
    found = as_json('identify', sample, '--json')
    # Simulated with u_thr 0.48 and u_sat 0.98; half a minute with 0.2 % noise tells them to 0.002.
    assert found['recruitment']['u_thr'] == pytest.approx(0.48, abs=0.005)
    assert found['recruitment']['u_sat'] == pytest.approx(0.98, abs=0.005)
    assert found['verdict']['grade'] == 'good'
    assert found['faults'] == {}
    # Noise of 0.02 N, the sharpness alpha_thr of 5 taken for 6, and a basis with 0.5 % of its own.
    assert found['output_error_of_range'] < 0.012
    assert found['curve']['force'][-1] == pytest.approx(FULL, rel=0.1)


def test_the_node_runs_the_recursion_for_people() -> None:
    estimator = build_estimator(IdentifierParameters())
    assert type(estimator).__name__ == 'FixedSizeRecursion'
