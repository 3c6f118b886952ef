# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether the muscle stayed the same, in sentences, for sessions of which the answer is known."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest

from rpms_ros.report.course import course_of, steadiness

COUNT = 80


def told(made_up: ModuleType, forces: np.ndarray, half: float = 0.1, **fields: Any) -> str:
    estimates = [
        made_up.estimate(index + 1, float(force), half, **fields)
        for index, force in enumerate(forces)
    ]
    return steadiness(course_of(made_up.session_of(estimates)))


def test_a_steady_muscle_stayed_the_same_within_what_the_intervals_allow(
    made_up: ModuleType,
) -> None:
    # twice 0.5 % of half an interval: 0.7 %
    assert told(made_up, np.full(COUNT, 10.0), 0.05) == (
        'The muscle stayed the same within 1 % from 8 s on.'
    )
    wandering = np.full(COUNT, 10.0)
    wandering[15:-1] += 0.3 * np.sin(np.linspace(0.0, 9.4, COUNT - 16))
    assert 'within 3 %' in told(made_up, wandering, 0.05)


def test_a_force_that_falls_is_told_with_its_interval(made_up: ModuleType) -> None:
    forces = np.full(COUNT, 10.0)
    forces[15:] = np.linspace(10.0, 7.7, COUNT - 15)
    # intervals of 1 % and 1.3 %: together 1.6 % of the start, times 0.77
    assert told(made_up, forces) == (
        'The force at full intensity fell by 23 % (22 to 24 %) between 8 and 40 s.'
    )
    assert 'rose by' in told(made_up, forces[::-1].copy())


@pytest.mark.parametrize(
    ('kind', 'words'),
    [
        ('thresholds', 'The coil probably moved at 20.0 s: the threshold went from 0.48 to 0.56,'),
        ('gain', 'The force of all intensities changed at 20.0 s: the force at full intensity'),
        ('dynamics', 'The response to a pulse changed its shape at 20.0 s'),
        ('unknown', 'Something changed at 20.0 s'),
    ],
)
def test_a_sudden_change_is_told_with_what_it_did(
    made_up: ModuleType, kind: str, words: str
) -> None:
    def at(index: int) -> Any:
        late = index > 40
        fields = {
            'changes': 1, 'change_kinds': (kind,), 'change_ago': np.array([0.5 * index - 20.0]),
            'nonlinear': np.array([0.56, 1.06, 4.0, 6.0]),
        } if late else {}  # fmt: skip
        return made_up.estimate(index, 8.0 if late else 10.0, **fields)

    text = steadiness(course_of(made_up.session_of([at(index) for index in range(1, COUNT + 1)])))
    assert text.startswith(words)
    # two intervals of 1 % and 1.25 %, times 0.8
    assert text.endswith('the force at full intensity fell by 20 % (19 to 21 %).')
    assert text.count('fell by') == 1


@pytest.mark.parametrize('kind', ['thresholds', 'gain', 'dynamics'])
def test_what_is_the_same_afterwards_is_no_change(made_up: ModuleType, kind: str) -> None:
    def at(index: int, moved: float = 0.0, half: float = 0.1) -> Any:
        late = index > 40
        covariance = np.diag([1e-6, 1e-6, 0.01, 0.01])
        fields = {'nonlinear_covariance': covariance}
        if late:
            fields |= {
                'changes': 1, 'change_kinds': (kind,), 'change_ago': np.array([0.5 * index - 20.0])
            }  # fmt: skip
            # a few seconds of something else
            shift = 0.04 * np.exp(-(index - 40) / 8) + moved
            fields['nonlinear'] = np.array([0.48 + shift, 0.98 + shift, 4.0, 6.0])
        return made_up.estimate(index, 10.0, half, **fields)

    def said(*options: float) -> str:
        estimates = [at(index, *options) for index in range(1, COUNT + 1)]
        return steadiness(course_of(made_up.session_of(estimates)))

    assert said().startswith('Something at 20.0 s looked like another muscle, but thresholds,')
    assert 'an effort, a spasm or a bump, say. The muscle stayed the same within' in said()
    # thresholds that stay elsewhere, and a force that is too vague to tell
    assert 'looked like another' not in said(0.02)
    assert 'looked like another' not in said(0.0, 1.0)


def test_a_jump_of_the_baseline_is_not_the_muscle(made_up: ModuleType) -> None:
    jump = {'changes': 1, 'change_kinds': ('baseline',), 'change_ago': np.array([1.0])}
    assert 'which is not the muscle' in told(made_up, np.full(COUNT, 10.0), **jump)


def test_an_estimator_that_takes_the_muscle_for_constant_does_not_tell(
    made_up: ModuleType,
) -> None:
    text = told(made_up, np.full(COUNT, 10.0), rate_names=(), rate=np.empty(0))
    assert 'assumes a muscle that does not change' in text
