# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Numbers that belong to one model are not read as those of another."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rpms_ros.report.result import NOT_A_TWITCH, IdentificationResult, ImpulseResponse, Stated

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


@pytest.mark.parametrize(
    ('ends', 'told'), [((3.6, 3.8), True), ((4.2, 4.3), True), ((3.6, 3.9), False)]
)
def test_peaks_differ_where_their_intervals_have_nothing_in_common(
    ends: tuple[float, float], told: bool
) -> None:
    time, peak = np.arange(3.0), Stated(3.7, *ends)
    response = ImpulseResponse(time_s=time, force=np.array([0.0, 4.0, 1.0]))
    lower, upper = np.array([0.0, 3.85, 0.9]), np.array([0.0, 4.15, 1.1])
    banded = replace(response, lower=lower, upper=upper)
    for one, twitch_peak, expected in (
        (banded, {'twitch_peak_n': peak}, told),
        (response, {'twitch_peak_n': peak}, False),
        (banded, None, False),
    ):
        result = SimpleNamespace(physiology=twitch_peak, impulse_response=one)
        assert IdentificationResult.is_no_twitch.fget(result) is expected
