# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps of the parameters of the recursion, and trials of other starts."""

import numpy as np

from rpms_ros.identification.projection.fit import LEAST_ENERGY
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.fit import empty_fit
from rpms_ros.identification.projection.settings import ProjectionSettings
from rpms_ros.identification.recursion.fit import evaluate
from rpms_ros.identification.recursion.fit import go_to
from rpms_ros.identification.recursion.fit import improve
from rpms_ros.identification.recursion.fit import refresh_variance
from rpms_ros.identification.recursion.kinds import Explained
from rpms_ros.identification.recursion.memory import Memory
from rpms_ros.identification.saved_state import Restorable
from rpms_ros.identification.saved_state import expect
from rpms_ros.pulses import FloatArray

# Another start is tried every so many steps, with so many steps of its own; it is taken if its
# cost is lower by more than noise explains (chi-square, one in a thousand, four parameters).
_CHALLENGE_STEPS = 20
_CHALLENGER_STEPS = 5
_CHALLENGER_GAIN = 18.5
_START_DAMPING = 1e-2
_FIRST_VARIANCE = 0.01


class Learner(Restorable):
    """Parameters of the recursion and their steps.

    Parameters
    ----------
    model : ProjectionSettings
        Start, prior and bounds.
    """

    fit: Fit
    _steps: int

    def __init__(self, model: ProjectionSettings) -> None:
        functions = model.basis.functions
        start = np.array(model.start)
        self.prior = model.as_prior()
        self.fit = empty_fit(start, functions, 1)
        # scratch: a trial step, and a fit from another start
        self._workspace = empty_fit(start, functions, 1), empty_fit(start, functions, 1)
        self._starts = model.starts()
        self._steps = 0

    def _check_restored(self) -> None:
        made = self._workspace[0]
        shapes = ((one.shape, other.shape) for one, other in zip(self.fit, made, strict=True))
        expect(all(one == other for one, other in shapes), 'Learner', 'arrays of one model')

    def restart(self, found: Explained) -> None:
        """Continue from the muscle found after a change, and raise the damping again."""
        self.fit.theta[:] = found.theta
        self.fit.linear[:] = found.linear
        self.fit.levels[:] = found.level
        self.fit.damping[0] = _START_DAMPING

    def learn(self, memory: Memory) -> None:
        """Take a step from the memory; a failure is counted."""
        fit = self.fit
        if fit.variance[0] == 0.0:
            power = float(memory.energy[0] / memory.samples[0])
            fit.variance[0] = _FIRST_VARIANCE * power + LEAST_ENERGY
        if not evaluate(memory, self.prior, fit):
            fit.failures[0] += 1.0
            return
        refresh_variance(memory, self.prior, fit)
        self._steps += 1
        if self._steps % _CHALLENGE_STEPS == 0:
            self._challenge(
                memory, self._starts[self._steps // _CHALLENGE_STEPS % len(self._starts)]
            )
        improve(memory, self.prior, fit, self._workspace[0], 1)
        # The covariance of weighted samples depends on the sum of the squared weights.
        fit.complete[:] = fit.matrix * (memory.samples[0] / memory.squared_samples[0])

    def _challenge(self, memory: Memory, start: FloatArray) -> None:
        """Try another start; continue from there if it fits the memory better."""
        fit, (trial, other) = self.fit, self._workspace
        other.theta[:] = start
        other.linear[:] = fit.linear
        other.variance[0] = fit.variance[0]
        other.damping[0] = _START_DAMPING
        if not evaluate(memory, self.prior, other):
            return
        improve(memory, self.prior, other, trial, _CHALLENGER_STEPS)
        if other.cost[0] < fit.cost[0] - _CHALLENGER_GAIN * fit.variance[0]:
            go_to(fit, other)
            fit.damping[0] = other.damping[0]
