# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimates over time: what is known when, changes once each, spans with a warning."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest

from rpms_ros.report.course import course_of


def several(made_up: ModuleType, count: int = 20, **fields: Any) -> list[Any]:
    return [made_up.estimate(index, **fields) for index in range(1, count + 1)]


def test_forces_and_parameters_have_their_intervals(made_up: ModuleType) -> None:
    course = course_of(made_up.session_of(several(made_up)))
    assert course.time_s[[0, -1]].tolist() == [0.5, 10.0]
    assert course.force.value.tolist() == [10.0] * 20
    np.testing.assert_allclose(course.force.upper - course.force.value, 0.1)
    threshold = course.parameter('u_thr')
    # 1.96 standard deviations of 0.01
    np.testing.assert_allclose(threshold.upper - threshold.value, 0.0196, rtol=1e-3)
    assert course.has_course


def test_what_is_not_known_is_left_out(made_up: ModuleType) -> None:
    empty = {'curve_force': np.empty(0), 'curve_lower': np.empty(0), 'curve_upper': np.empty(0)}
    unknown = {'nonlinear_identifiability': np.array([0, 2, 2, 2])}
    estimates = [
        made_up.estimate(1, samples=0),
        made_up.estimate(2, **empty),
        *several(made_up, 3, **unknown)[2:],
    ]
    course = course_of(made_up.session_of(estimates))
    assert course.force.known.tolist() == [False, False, True]
    assert course.parameter('u_thr').known.tolist() == [False, True, False]
    assert course.parameter('u_sat').known.tolist() == [False, True, True]
    assert not course.has_course


def test_a_change_that_is_renamed_counts_once_under_its_last_name(made_up: ModuleType) -> None:
    told = [
        made_up.estimate(
            index, changes=1, change_kinds=(kind,), change_ago=np.array([0.5 * index - 4.0])
        )
        for index, kind in ((9, 'gain'), (10, 'thresholds'))
    ]
    (change,) = course_of(made_up.session_of([*several(made_up, 8), *told])).changes
    assert (change.kind, change.time_s) == ('thresholds', pytest.approx(4.0))
    assert 'the coil probably moved' in change.reason


def test_warnings_become_spans_and_short_breaks_do_not_end_them(made_up: ModuleType) -> None:
    # a reason says why an interval is wide, as of all estimates of a verdict that is good
    estimates = [
        made_up.estimate(
            index,
            doubts=('curve_negative',) if index in (3, 5, 12) else (),
            reasons=('followed by another estimator',),
        )
        for index in range(1, 21)
    ]
    flags = course_of(made_up.session_of(estimates)).flags
    assert [(flag.start_s, flag.end_s) for flag in flags] == [(1.5, 2.5), (6.0, 6.0)]
    assert {flag.text for flag in flags} == {'the curve is negative: a muscle does not push'}


def test_a_fault_is_a_span_while_it_is_counted_not_ever_after(made_up: ModuleType) -> None:
    counts = [0, 0, 3, 9, 9, 9, 9, 9]
    estimates = [
        made_up.estimate(index + 1, faults={'force_frozen': count} if count else {}, doubts=('x',))
        for index, count in enumerate(counts)
    ]
    (flag,) = course_of(made_up.session_of(estimates)).flags
    assert (flag.start_s, flag.end_s) == (1.5, 2.0)
    assert flag.text.startswith('force_frozen: ')
