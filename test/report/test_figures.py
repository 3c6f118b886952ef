# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Figure, table and agreement of a session, from a simulated one."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from rpms_ros.identification import Estimate, IdentifiedSession, ModifiedRecursiveLM, identify
from rpms_ros.muscle import Contraction, simulation_subject
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.report.figures import draw_session
from rpms_ros.report.known_muscle import of_subject
from rpms_ros.report.recorded import compare, differences


@cache
def session(low: float = 0.0) -> tuple[IdentifiedSession, PulseTrain]:
    """Eight seconds of the simulated identification; at `low` = 1 at one intensity."""
    intensity = np.random.default_rng(1).uniform(low, 1.0, 160)
    pulses = PulseTrain.regular(intensity, 20.0)
    muscle = Contraction(simulation_subject(), fixed_rate_hz=20.0)
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = np.arange(8000) * 1_000_000
    forces = ForceTrace(stamps, muscle.force(stamps))
    return identify(ModifiedRecursiveLM(), pulses, forces), pulses


@pytest.mark.long
@pytest.mark.parametrize('low', [0.0, 1.0], ids=['curve', 'one intensity'])
@pytest.mark.parametrize('known', [True, False])
def test_a_figure_is_drawn(tmp_path: Path, low: float, known: bool) -> None:
    path = tmp_path / 'session.png'
    truth = of_subject(simulation_subject(), 20.0) if known else None
    draw_session([path], *session(low), truth, 'A title')
    picture = imread(path)[..., :3]
    # four panels with lines: far from blank
    assert picture.shape[0] > 800
    assert np.mean(np.any(picture < 0.9, axis=2)) > 0.02


def nudged(estimate: Estimate) -> Estimate:
    linear = estimate.linear.copy()
    linear[0] = np.nextafter(linear[0], 1e9)
    return replace(estimate, linear=linear)


def test_one_bit_is_a_difference() -> None:
    estimates = session()[0].estimates
    assert compare(estimates[:-2], estimates).exact
    spoiled = [*estimates[:3], nudged(estimates[3]), replace(estimates[4], damping=1.0)]
    assert differences(estimates[3], spoiled[3]) == ['linear']
    agreement = compare(spoiled, estimates)
    assert (agreement.compared, agreement.missing) == (5, 0)
    assert agreement.differing == {'linear': 1, 'damping': 1}
    assert not agreement.exact
    alone = compare([replace(estimates[0], stamp_ns=7)], estimates)
    assert (alone.compared, alone.missing, alone.exact) == (0, 1, False)
    assert not compare([], estimates).exact
