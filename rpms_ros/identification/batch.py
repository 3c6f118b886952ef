# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Off-line estimator: variable projection over all samples, from many starts.

The samples are condensed into blocks of one pulse each, from which the normal equations of any
parameters follow exactly (`rpms_ros.identification.projection`), so that the cost of a fit grows
with the pulses, not with the samples.  A fit is made whenever the recording has doubled, so that
every sample has an a-priori prediction, and once more for an estimate.  With `choose_basis`,
latency and time constant of the basis are chosen by the samples
(`rpms_ros.identification.projection.basis_search`).
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from rpms_ros.identification.constancy.answer import examined
from rpms_ros.identification.estimate import DEFAULT_RATE
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.laguerre import LaguerreBasis
from rpms_ros.identification.projection.basis_search import BasisSearch
from rpms_ros.identification.projection.basis_search import basis_at
from rpms_ros.identification.projection.block_statistics import grown
from rpms_ros.identification.projection.data_intake import recompute_state
from rpms_ros.identification.projection.estimate_builder import EstimateBuilder
from rpms_ros.identification.projection.estimator import ProjectionEstimator
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.fit import empty_fit
from rpms_ros.identification.projection.fit import fit_linear
from rpms_ros.identification.projection.problem import BaselineKnots
from rpms_ros.identification.projection.problem import Problem
from rpms_ros.identification.projection.sample_record import SampleRecord
from rpms_ros.identification.projection.settings import ProjectionSettings
from rpms_ros.identification.projection.step import complete_equations
from rpms_ros.identification.projection.step import improve
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import nanoseconds

_FIRST_FIT_NS = NANOSECONDS_PER_SECOND
_GROWTH = 2
# A shorter recording gets a constant baseline: its slope could not be determined.
_SHORTEST_SLOPE_NS = 5 * NANOSECONDS_PER_SECOND
# Later fits for predictions alone start from the fit before and try no other start.
_LAST_SCOUTING_NS = 10 * NANOSECONDS_PER_SECOND
_SCOUTED_BLOCKS = 200
_SCOUTING_STEPS = 5
_SCOUTING_TOLERANCE = 1e-3
_FINAL_STEPS = 12
_FINAL_TOLERANCE = 1e-9
_ROUNDS = 2
_START_DAMPING = 1e-2
# The newest part of a recording that chooses the basis, the least samples for that, and the
# length from which the whole grid of bases is searched once more.
_CHOSEN_NS = 40 * NANOSECONDS_PER_SECOND
_LEAST_SAMPLES = 500
_SEARCHED_AGAIN_NS = 10 * NANOSECONDS_PER_SECOND


class BatchEstimator(ProjectionEstimator):
    """Batch estimator; its memory grows with the recording.

    Parameters
    ----------
    settings : ProjectionSettings or None
        Model and numerics.
    rate_hz : float
        Rate for which the recruitment curve is stated [Hz].

    Raises
    ------
    IdentificationError
        If the rate is not above zero.
    """

    name = 'batch'
    on_line = False

    _origin_ns: int | None
    _last_ns: int
    _due_ns: int
    _interval_ns: int
    _fitted_samples: int
    _place: tuple[int, int]
    _searches: int
    _looked_at: tuple[int, int]
    _record: SampleRecord

    def __init__(
        self,
        settings: ProjectionSettings | None = None,
        rate_hz: float = DEFAULT_RATE,
    ) -> None:
        super().__init__(settings, rate_hz)
        if not self.settings.baseline:
            self._reshape(0)
        self._origin_ns = None
        self._last_ns = 0
        self._due_ns = 0
        self._interval_ns = _FIRST_FIT_NS
        self._fitted_samples = 0
        self._place = (0, 0)
        self._searches = 0
        self._looked_at = (0, 0)
        self._record = SampleRecord()
        if self.settings.choose_basis:
            self._use(self.settings.basis)

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending, none before one that was already added [ns, 1]."""
        super().add_pulses(onset_ns, intensity)
        if self.settings.choose_basis and len(onset_ns):
            weight = self._delay_line.weight[-len(onset_ns) :]
            self._record.add_pulses(onset_ns, intensity, weight)

    def forget_pulses(self) -> None:
        """Drop the pulses that still act: the clock has jumped, their lag is unknown."""
        super().forget_pulses()
        self._record.jump()

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore a saved state; see `Restorable.restore`."""
        super().restore(state)
        if self.settings.choose_basis:
            self._use(basis_at(self.settings.basis, self._place))

    def update(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        """Add samples (samples,), ascending; return their a-priori prediction [N].

        See `rpms_ros.identification.estimate.Estimator.update`.
        """
        prediction = np.empty(len(stamp_ns))
        first = 0
        if not len(stamp_ns):
            return prediction
        if self._origin_ns is None:
            self._origin_ns = int(stamp_ns[0])
            self._due_ns = self._origin_ns + _FIRST_FIT_NS
        while first < len(stamp_ns):
            if stamp_ns[first] >= self._due_ns:
                early = self._last_ns - self._origin_ns < _LAST_SCOUTING_NS
                self._fit_all(scouting=early)
                while stamp_ns[first] >= self._due_ns:
                    self._interval_ns *= _GROWTH
                    self._due_ns += self._interval_ns
            last = int(np.searchsorted(stamp_ns, self._due_ns))
            part = slice(first, last)
            self._make_room(int(stamp_ns[last - 1] - stamp_ns[first]))
            self._take(stamp_ns[part], force[part], usable[part], prediction[part])
            if self.settings.choose_basis:
                chosen = usable[part]
                self._record.add(stamp_ns[part][chosen], force[part][chosen])
            self._last_ns = int(stamp_ns[last - 1])
            first = last
        return prediction

    def estimate(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Fit all samples so far and return the estimate."""
        self._fit_all(scouting=True)
        return examined(self._build(stamp_ns, faults), self._problem, self._fit)

    def _make_room(self, span_ns: int) -> None:
        """Enlarge the ring buffer for the pending pulses and the blocks of a pause."""
        need = int(self._problem.blocks.size[0]) + len(self._delay_line.begin_ns)
        need += span_ns // 200_000_000 + 2
        if need > len(self._problem.blocks.start_ns):
            blocks = grown(self._problem.blocks, 2 * need)
            self._problem = self._problem._replace(blocks=blocks)

    def _reshape(self, knots: int) -> None:
        """Change the number of knots of the baseline."""
        theta, functions = self._fit.theta, self.settings.basis.functions
        self._fit = empty_fit(theta, functions, knots)
        self._trial = empty_fit(theta, functions, knots)
        baseline = BaselineKnots(knots, 0, 1)
        self._problem = self._problem._replace(baseline=baseline)

    def _place_knots(self) -> None:
        """Spread the baseline's knots evenly over the recording so far."""
        assert self._origin_ns is not None
        span = self._last_ns - self._origin_ns
        spacing = self.settings.knot_spacing * NANOSECONDS_PER_SECOND
        parts = max(round(span / spacing), 1) if span >= _SHORTEST_SLOPE_NS else 0
        if parts + 1 != self._problem.baseline.knots:
            self._reshape(parts + 1)
        baseline = BaselineKnots(parts + 1, self._origin_ns, -(-span // max(parts, 1)))
        self._problem = self._problem._replace(baseline=baseline)

    def _fit_all(self, scouting: bool) -> None:
        """Fit all samples; with `scouting`, try every start with a few steps first."""
        samples = int(self._intake.learnt[0])
        if self._origin_ns is None or samples == self._fitted_samples:
            return
        self._fitted_samples = samples
        if self.settings.baseline:
            self._place_knots()
        self._fit_basis(scouting)
        if self.settings.choose_basis and self._choose_basis():
            self._fit_basis(scouting)

    def _fit_basis(self, scouting: bool) -> None:
        """Fit all samples with the present basis."""
        fit = self._fit
        fit.variance[0] = 0.0
        fit_linear(self._problem, fit, True)
        improve(self._problem, fit, self._trial, _SCOUTING_STEPS, _SCOUTING_TOLERANCE, False)
        if scouting:
            self._scout(fit)
        for _ in range(_ROUNDS):
            fit_linear(self._problem, fit, True)
            improve(self._problem, fit, self._trial, _FINAL_STEPS, _FINAL_TOLERANCE, False)
        complete_equations(self._problem, fit)
        recompute_state(self._problem, self._intake, fit)

    def _choose_basis(self) -> bool:
        """Choose the basis that explains the recording best; return whether it has changed."""
        part = self._record.window(_CHOSEN_NS)
        if part is None or part.samples.stop - part.samples.start < _LEAST_SAMPLES:
            return False
        looked_at = part.samples.start, part.samples.stop
        if looked_at == self._looked_at:
            return False
        self._looked_at = looked_at
        search = BasisSearch(
            self._record,
            part,
            self.settings.basis,
            self._fit.theta,
            self._problem.prior,
            self.settings.knot_spacing,
        )
        first_ns, last_ns = self._record.span_ns(part)
        everywhere = self._searches < 1 + (last_ns - first_ns > _SEARCHED_AGAIN_NS)
        self._searches += everywhere
        place = search.best(self._place, everywhere)
        if place == self._place:
            return False
        self._place = place
        basis = basis_at(self.settings.basis, place)
        old = self._intake
        parts = self._record.parts()
        problem, intake, waiting = self._record.condensed(
            basis, self._problem.prior, self._problem.baseline, parts
        )
        self._problem = problem
        self._intake = old._replace(state=intake.state, fresh=intake.fresh)
        self._delay_line.restart(*self._record.newest_pulses(waiting), basis.latency)
        self._use(basis)
        return True

    def _use(self, basis: LaguerreBasis) -> None:
        """Use a basis from now on."""
        self._rate = 2.0 / basis.time_constant
        self._delay_line.latency(basis.latency)
        self._builder = EstimateBuilder(
            self.name, basis, self.rate_hz, self.settings.confidence, wide=True
        )

    def _scout(self, fit: Fit) -> None:
        """Try every start on the newest blocks; keep the best if it fits all blocks better."""
        problem = self._newest_blocks()
        best = self._trial_from(problem, fit, fit.theta)
        for theta in self.settings.starts():
            other = self._trial_from(problem, fit, theta)
            if other.cost[0] < best.cost[0]:
                best = other
        fit_linear(self._problem, best, False)
        improve(self._problem, best, self._trial, _SCOUTING_STEPS, _SCOUTING_TOLERANCE, False)
        if best.cost[0] < fit.cost[0]:
            fit.theta[:] = best.theta
            fit.damping[0] = best.damping[0]

    def _newest_blocks(self) -> Problem:
        """Return the problem of the newest blocks, led by those whose pulses still act on them."""
        blocks = self._problem.blocks
        size = int(blocks.size[0])
        order = (int(blocks.head[0]) + np.arange(size)) % len(blocks.start_ns)
        first = max(size - _SCOUTED_BLOCKS, 0)
        begin_ns = blocks.start_ns[order[first]] - nanoseconds(self.memory)
        # the clock may have jumped back
        earlier = np.flatnonzero(blocks.start_ns[order[:first]] < begin_ns)
        lead = int(earlier[-1]) if len(earlier) else 0
        newest = {
            name: values[order[lead:]]
            for name, values in blocks._asdict().items()
            if name not in ('head', 'size')
        }
        newest |= {'head': np.zeros_like(blocks.head), 'size': blocks.size - lead}
        return self._problem._replace(blocks=type(blocks)(**newest), first=first - lead)

    def _trial_from(self, problem: Problem, fit: Fit, theta: FloatArray) -> Fit:
        """Return a fit after a few steps from theta (4,), with the variance of `fit`."""
        other = empty_fit(theta, len(fit.linear), len(fit.levels))
        other.variance[0] = fit.variance[0]
        other.damping[0] = _START_DAMPING
        fit_linear(problem, other, False)
        improve(problem, other, self._trial, _SCOUTING_STEPS, _SCOUTING_TOLERANCE, False)
        return other
