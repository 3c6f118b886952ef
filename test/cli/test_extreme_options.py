# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Options with values that are not possible: exit code 2 and one line."""

from collections.abc import Callable
from pathlib import Path

import pytest

Rpms = Callable[..., tuple[int, str, str]]
PAPER = ('--estimator', 'recursive', '--preset', 'paper_table_4')


def assert_refused(outcome: tuple[int, str, str], message: str) -> None:
    code, out, err = outcome
    assert (code, out) == (2, '')
    assert err.startswith(f'rpms: error: {message}')
    assert err.count('\n') == 1


@pytest.mark.parametrize('options', [(), PAPER])
def test_a_negative_seed_of_identify_is_refused(
    rpms: Rpms, short_session: Path, options: tuple[str, ...]
) -> None:
    assert_refused(rpms('identify', short_session, '--seed', -1, *options), 'expected a seed, ')


@pytest.mark.parametrize(
    'arguments',
    [
        ('simulate', '--schedule', 'sinusoid', '--subject', 'random'),
        ('simulate', '--schedule', 'sinusoid', '--noise', 0.1),
        ('protocol', 'twitches'),
    ],
)
def test_a_negative_seed_of_what_is_made_is_refused(
    rpms: Rpms, tmp_path: Path, arguments: tuple[object, ...]
) -> None:
    path = tmp_path / 'new'
    assert_refused(rpms(*arguments, '--seed', -1, '--out', path), 'expected a seed, ')
    assert not path.exists()


@pytest.mark.parametrize('estimator', ['batch', 'recursive'])
def test_a_rate_at_which_nobody_is_stimulated_is_refused(
    rpms: Rpms, short_session: Path, estimator: str
) -> None:
    outcome = rpms('identify', short_session, '--rate-hz', 1e6, '--estimator', estimator)
    assert_refused(outcome, 'expected a repetition rate from 0.1 to 1000 Hz, got ')
