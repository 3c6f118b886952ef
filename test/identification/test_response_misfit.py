# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""On-line estimates say that the response is not one of the model, or that the muscle changes."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import StreamSettings, estimator_by_name, identify
from rpms_ros.identification.quality.doubts import RESPONSE_MISFIT, ResponseMisfit
from rpms_ros.pulses import ForceTrace, PulseTrain


def doubts(name: str, what) -> tuple[str, ...]:
    """Return the doubts of the last estimate of a session."""
    pulses = PulseTrain.regular(what.intensity, 20.0, 1_000)
    settings = StreamSettings(estimate_period=5.0)
    found = identify(
        estimator_by_name(name), pulses, ForceTrace(what.stamp_ns, what.force), settings
    )
    return found.last.doubts


@pytest.mark.parametrize('name', ['recursive', 'tracking'])
def test_a_response_of_the_model_is_not_doubted(living_sessions, name: str) -> None:
    assert doubts(name, living_sessions.session('steady', 'random', 3, 25.0)) == ()


@pytest.mark.long
@pytest.mark.parametrize('excitation', ['random', 'sinusoid'])
def test_a_twitch_too_fast_for_the_functions_is_said(living_sessions, excitation: str) -> None:
    fast = replace(living_sessions.SUBJECT, time_constant=8e-3)
    what = living_sessions.session('steady', excitation, 3, 25.0, fast)
    assert RESPONSE_MISFIT in doubts('recursive', what)
    # tracking finds functions for it
    assert RESPONSE_MISFIT not in doubts('tracking', what)


@pytest.mark.parametrize('name', ['tracking', 'recursive'])
def test_functions_that_begin_a_little_late_are_not_doubted(living_sessions, name: str) -> None:
    soon = replace(living_sessions.SUBJECT, latency=0.0)
    assert doubts(name, living_sessions.session('steady', 'random', 3, 25.0, soon)) == ()


def test_a_sudden_change_that_was_found_is_no_misfit(living_sessions) -> None:
    what = living_sessions.session('gain step', 'random', 0, 50.0)
    assert RESPONSE_MISFIT not in doubts('recursive', what)


def filled(cuts) -> ResponseMisfit:
    """Return the sums over made-up samples cut into blocks."""
    generator = np.random.default_rng(1)
    stamp = np.arange(25_000, dtype=np.int64) * 1_000_000
    onset = np.arange(500, dtype=np.int64) * 50_000_000
    force, prediction = generator.standard_normal((2, len(stamp)))
    intensity = generator.uniform(size=len(onset))
    misfit = ResponseMisfit()
    for first, last in pairwise([0, *cuts, len(stamp)]):
        known = (onset >= first * 1_000_000) & (onset < last * 1_000_000)
        misfit.add_pulses(onset[known], intensity[known])
        part = slice(first, last)
        usable = np.ones(last - first, dtype=np.bool_)
        misfit.add(stamp[part], force[part], prediction[part], usable)
    return misfit


def test_blocks_change_no_bit_and_a_state_is_restored() -> None:
    whole = filled(())
    # Errors as large as the force itself, but none that follow the pulses' intensities.
    assert whole.sizes[0] < 0.1
    assert repr(filled((3, 9_000, 9_025, 17_333)).state()) == repr(whole.state())
    again = ResponseMisfit()
    again.restore(whole.state())
    assert again.sizes == whole.sizes
    broken = {**whole.state(), '_by_lag': np.zeros((2, 2))}
    with pytest.raises(IdentificationError, match='expected arrays of one size'):
        again.restore(broken)
