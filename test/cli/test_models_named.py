# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Numbers that belong to one model are not read as those of another."""

from collections.abc import Callable
from pathlib import Path

import pytest

from rpms_ros.report.result import NOT_A_TWITCH

Rpms = Callable[..., tuple[int, str, str]]


@pytest.mark.long
@pytest.mark.parametrize(('estimator', 'told'), [('recursive', True), ('batch', False)])
def test_a_response_that_is_no_twitch_is_told_from_the_twitch_closest_to_it(
    rpms: Rpms, tmp_path: Path, estimator: str, told: bool
) -> None:
    """The functions of `recursive` begin after this muscle does: two peaks of its force differ."""
    session, report = tmp_path / 'session', tmp_path / 'report.html'
    simulated = ['--schedule', 'sinusoid', '--duration', 18, '--noise', 0.02, '--seed', 1]
    rpms('simulate', '--out', session, *simulated)
    _, out, _ = rpms('identify', session, '--estimator', estimator)
    assert (NOT_A_TWITCH in ' '.join(out.split())) == told
    rpms('report', session, '--estimator', estimator, '--out', report)
    assert (f'<p>The response is {NOT_A_TWITCH}.</p>' in report.read_text()) == told
