# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The fixtures that users import, as docs/nodes.md shows them: a plugin of other tests."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rpms_ros.testing import LONGEST_TRAIN_S, Graph, SimulatedMuscle

PAGE = Path(__file__).resolve().parents[1] / 'docs' / 'nodes.md'


def test_the_example_of_the_page_is_a_test_that_passes(tmp_path: Path) -> None:
    (example,) = re.findall(r'```python\n(pytest_plugins.*?)```', PAGE.read_text(), re.DOTALL)
    (tmp_path / 'test_pull_alarm.py').write_text(f'{example}')
    answer = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', str(tmp_path)],
        cwd=tmp_path,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert '1 passed' in answer.stdout, answer.stdout + answer.stderr


def test_a_muscle_is_identified_and_the_truth_is_known(graph: Graph) -> None:
    muscle = SimulatedMuscle(
        graph, {'estimator': 'recursive'}, subject='simulation', noise=0.001, seed=2
    )
    shares = np.random.default_rng(1).uniform(0.3, 1.0, 100)
    muscle.wait_until(muscle.stimulate(shares))
    last = muscle.estimates[-1]
    assert last.pulses > 80
    truth = np.interp(last.curve_intensity, muscle.truth.curve_intensity, muscle.truth.curve_force)
    # 5 s of random pulses: the curve is known to a few percent of its largest force
    assert np.abs(last.curve_force - truth).max() < 0.1 * truth.max()


def test_pulses_that_nobody_would_keep_are_refused(graph: Graph) -> None:
    muscle = SimulatedMuscle(graph, False)
    with pytest.raises(ValueError, match=r'at most 8\.0 s, got 200 in 10\.0 s'):
        muscle.stimulate([0.5] * 200)
    with pytest.raises(ValueError, match=r'expected pulses .* got 0 in 0\.0 s'):
        muscle.stimulate([])
    assert LONGEST_TRAIN_S == 8.0
    assert muscle.identifier is None


def test_two_muscles_in_one_process_and_two_namespaces(graph: Graph) -> None:
    legs = {
        name: SimulatedMuscle(
            graph,
            {'estimator': 'recursive'},
            namespace=name,
            subject='simulation',
            seed=seed,
            noise=0.0,
        )
        for seed, name in enumerate(('left', 'right'))
    }
    shares = np.random.default_rng(1).uniform(0.3, 1.0, 40)
    # one leg only: nothing of it may show in the other
    legs['left'].wait_until(legs['left'].stimulate(shares))
    assert max(legs['left'].forces) > 1.0
    assert not any(legs['right'].forces)
    graph.wait_for(lambda: bool(legs['right'].estimates))
    assert {one.pulses for one in legs['right'].estimates} == {0}
    assert legs['left'].estimates[-1].pulses > 20
