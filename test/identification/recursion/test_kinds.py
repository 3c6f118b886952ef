# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The kind of a change, as determined by the recursion for people."""

from itertools import pairwise

import numpy as np
import pytest

from rpms_ros.identification import ExactRecursion
from rpms_ros.identification.recursion.sums import empty_memory, sums_of, without

CHANGED_S = 40
# bench/recursion_people.py: all are named, and the curve is back, within a second.
KINDS = {
    'gain step': 'gain',
    'coil moved': 'thresholds',
    'slower': 'dynamics',
    'baseline': 'baseline',
}


def recording(living_sessions, kind: str):
    """Return a session with a change after 40 s."""
    if kind != 'baseline':
        return living_sessions.session(kind, 'random', 0, 50.0)
    what = living_sessions.session('steady', 'random', 0, 50.0)
    return what._replace(force=what.force + 1.0 * (what.stamp_ns >= CHANGED_S * 1e9))


def follow(estimator, what, first_s: float, last_s: float, cuts=()):
    """Feed a part of a session, in blocks cut at samples; return the predictions."""
    first, last = (int(1000 * second) for second in (first_s, last_s))
    pulses = (what.onset_ns >= 1e9 * first_s) & (what.onset_ns < 1e9 * last_s)
    estimator.add_pulses(what.onset_ns[pulses], what.intensity[pulses])
    usable = np.ones(len(what.force), dtype=np.bool_)
    parts = [
        estimator.update(what.stamp_ns[a:b], what.force[a:b], usable[a:b])
        for a, b in pairwise([first, *cuts, last])
    ]
    return np.concatenate(parts)


def error(estimate, what) -> float:
    """Return the largest error of the curve at the end, relative to its maximum."""
    truth = what.curve[-1]
    return float(np.abs(estimate.curve_force - truth).max() / truth.max())


@pytest.mark.parametrize('kind', KINDS)
def test_a_change_is_named_and_what_it_left_is_kept(living_sessions, kind: str) -> None:
    what = recording(living_sessions, kind)
    estimator = ExactRecursion()
    follow(estimator, what, 0.0, 42.5)
    estimate = estimator.estimate(42_500_000_000, {})
    assert (estimate.changes, estimate.change_kinds) == (1, (KINDS[kind],))
    # Within a block or two of the first pulse that the changed muscle answers.
    assert estimate.change_ago[-1] == pytest.approx(2.5, abs=0.25)
    # A muscle that is learnt anew needs 5 s and more for it.
    assert error(estimate, what) < 0.01
    follow(estimator, what, 42.5, 50.0)
    assert error(estimator.estimate(0, {}), what) < 0.01


def test_what_no_change_explains_has_no_name(living_sessions) -> None:
    what = recording(living_sessions, 'gain step')
    noise = np.random.default_rng(3).standard_normal(len(what.force))
    shaken = what._replace(force=what.force + 1.0 * noise * (what.stamp_ns >= CHANGED_S * 1e9))
    estimator = ExactRecursion()
    follow(estimator, shaken, 0.0, 45.0)
    assert estimator.estimate(45_000_000_000, {}).change_kinds == ('unknown',)


def test_blocks_and_a_saved_state_change_no_bit_where_the_muscle_changes(living_sessions) -> None:
    what = recording(living_sessions, 'coil moved')
    whole, cut, restored = ExactRecursion(), ExactRecursion(), ExactRecursion()
    expected = follow(whole, what, 0.0, 43.0)
    # Before the change is certain: what came since is part of the state.
    cuts = (40_111, 40_333, 40_777)
    assert follow(cut, what, 0.0, 43.0, cuts).tobytes() == expected.tobytes()
    half = ExactRecursion()
    follow(half, what, 0.0, 40.4)
    restored.restore(half.state())
    assert follow(restored, what, 40.4, 43.0).tobytes() == expected[40_400:].tobytes()
    assert repr(restored.state()) == repr(whole.state())


def test_sums_without_a_direction_say_nothing_of_it_and_the_same_of_the_rest() -> None:
    generator = np.random.default_rng(1)
    samples, unknowns = 400, 2 * 3 + 1
    regressors = generator.standard_normal((samples, unknowns))
    truth = generator.standard_normal(unknowns)
    moved = generator.standard_normal(unknowns)
    force = regressors @ (truth + 3.0 * moved)
    memory = empty_memory(2, 3)
    memory.gram[:] = np.tril(regressors.T @ regressors)
    memory.cross[:] = regressors.T @ force
    memory.energy[0], memory.samples[0] = force @ force, samples
    directions = 1e3 * moved[None]
    left = without(sums_of(memory), directions, 1e-6)
    gram = np.tril(left.gram) + np.tril(left.gram, -1).T
    # Rounding of sums of 400 squares times 1e3 squared.
    np.testing.assert_allclose(gram @ moved, 0.0, atol=1e-6)
    distance = left.energy[0] - 2.0 * truth @ left.cross + truth @ gram @ truth
    assert distance == pytest.approx(0.0, abs=1e-6 * float(memory.energy[0]))
