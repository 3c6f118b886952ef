# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sums of the samples since a change may have begun, and the state before it."""

import math
from typing import NamedTuple

import numpy as np

from rpms_ros.identification.projection.block_statistics import newest
from rpms_ros.identification.projection.block_statistics import without_force
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.normal_equations import advance_state
from rpms_ros.identification.projection.problem import Prior
from rpms_ros.identification.projection.uncertainty import uncertainty
from rpms_ros.identification.recursion.intake import recompute_response
from rpms_ros.identification.recursion.kinds import UNKNOWN
from rpms_ros.identification.recursion.kinds import Explained
from rpms_ros.identification.recursion.kinds import explain
from rpms_ros.identification.recursion.kinds import freed
from rpms_ros.identification.recursion.knots import interpolate
from rpms_ros.identification.recursion.memory import Memory
from rpms_ros.identification.recursion.memory import Sums
from rpms_ros.identification.recursion.memory import add_block
from rpms_ros.identification.recursion.memory import let_baseline_drift
from rpms_ros.identification.recursion.memory import scale_memory
from rpms_ros.identification.recursion.memory import sums_of
from rpms_ros.identification.recursion.memory import without
from rpms_ros.identification.saved_state import Restorable
from rpms_ros.identification.saved_state import expect
from rpms_ros.identification.tracking.knowledge import Knowledge
from rpms_ros.pulses import FloatArray

# Samples are not used for so long: the force of earlier pulses partly has the new dynamics, and a
# block may contain samples from before the change [ns].
_SETTLING_NS = 400_000_000

# Level of intervals, which are not used.
_ANY_LEVEL = 0.95


class Until(NamedTuple):
    """State when a change may have begun: sums, parameters, spread of the residuals."""

    sums: Sums
    fit: Fit
    spread: FloatArray


class SinceChange(Restorable):
    """Sums over the samples since a change may have begun.

    Parameters
    ----------
    memory : Memory
        The memory of the recursion.
    fit : Fit
        Its parameters.
    spread : ndarray (lengths,)
        Spread of its residuals [N^2].
    """

    _until: Until
    _since: Sums
    _before: FloatArray
    _begun_ns: int

    def __init__(self, memory: Memory, fit: Fit, spread: FloatArray) -> None:
        self.begin(memory, fit, spread)
        self._shapes = self._present_shapes()

    def _present_shapes(self) -> list[tuple[int, ...]]:
        until = self._until
        arrays = (*until.sums, *until.fit, until.spread, *self._since, self._before)
        return [one.shape for one in arrays]

    def _check_restored(self) -> None:
        alike = self._present_shapes() == self._shapes
        expect(alike, 'SinceChange', 'arrays of one model')

    def begin(self, memory: Memory, fit: Fit, spread: FloatArray) -> None:
        """Keep what is known: the pulse of the newest block may be one to another muscle."""
        known = Fit(*(part.copy() for part in fit))
        self._until = Until(sums_of(memory), known, spread.copy())
        self._since = Sums(*(np.zeros_like(part) for part in self._until.sums))
        self._before = memory.chains.copy()
        self._begun_ns = 0
        if memory.blocks.size[0]:
            here = newest(memory.blocks)
            self._begun_ns = int(memory.blocks.start_ns[here])
            share = np.empty(len(self._before))
            interpolate(float(memory.blocks.intensity[here]), share)
            self._before -= float(memory.blocks.weight[here]) * share[:, None]

    def advance(self, memory: Memory) -> None:
        """Let a block begin."""
        transition = memory.blocks.transition[newest(memory.blocks)]
        for chain in self._before:
            advance_state(transition, chain)

    def add(self, memory: Memory, here: int, drift: float) -> None:
        """Add a block that is added to the memory; `drift` is the baseline's variance.

        The force of pulses before the change is that of the muscle before, and taken off.
        """
        fit, blocks = self._until.fit, memory.blocks
        if int(blocks.start_ns[here]) < self._begun_ns + _SETTLING_NS:
            return
        force = np.empty(len(fit.linear))
        recompute_response(self._before, fit.theta, fit.linear, force)
        response, moments = blocks.response.copy(), blocks.moments.copy()
        without_force(blocks, here, force, response[here], moments[here])
        since = memory._replace(
            chains=memory.chains - self._before,
            blocks=blocks._replace(response=response, moments=moments),
            **self._since._asdict(),
        )
        if since.samples[0] > 0.0:
            let_baseline_drift(since, drift)
        add_block(since, here)

    def explain(self, memory: Memory, prior: Prior, bounds: Knowledge) -> Explained:
        """Return what has changed since."""
        fit = self._until.fit
        sure = uncertainty(fit, prior, self._until.spread, _ANY_LEVEL)
        if sure is None or not self._since.samples[0] > 0.0:
            return Explained(UNKNOWN, fit.theta, fit.linear, float(fit.levels[0]))
        variance = max(float(fit.variance[0]), float(self._until.spread.max(initial=0.0)))
        since = memory._replace(**self._since._asdict())
        return explain(since, fit, sure.covariance, bounds, variance)

    def renew(self, memory: Memory, found: Explained, kept: float) -> None:
        """Let the memory hold what came since, and of what was before what still holds.

        Parameters
        ----------
        memory : Memory
            Overwritten.
        found : Explained
            What has changed.
        kept : float
            What was before counts as so many samples at the most.
        """
        fit, before = self._until.fit, self._until.sums
        if found.kind != UNKNOWN:
            force = math.sqrt(float(before.energy[0]) / max(float(before.samples[0]), 1.0))
            directions = freed(found.kind, fit.theta, fit.linear, force)
            before = without(before, directions, float(fit.variance[0]))
        share = min(kept / max(float(before.samples[0]), 1.0), 1.0)
        old = sums_of(memory._replace(**before._asdict()))
        scale_memory(memory._replace(**old._asdict()), share)
        for name in Sums._fields:
            getattr(memory, name)[:] = getattr(old, name) + getattr(self._since, name)
