"""On-line estimator: exact variable projection over a moving horizon.

Samples of the last 20 s are kept, condensed into cells of one pulse each, from which the normal
equations of any parameters follow exactly.  Once a period of the stamps one Gauss-Newton step is
taken from them, so the linearisation never grows old.  Cells that leave the horizon are kept as
a quadratic cost that is forgotten only where newer cells say the same.

Steps are triggered by stamps alone, so the answer does not depend on how the data are cut.
"""

from collections.abc import Mapping

import numpy as np

from rpms_ros.identification.estimate import DEFAULT_RATE
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.faults import PULSES_TOO_FREQUENT
from rpms_ros.identification.projection.arrival import absorb
from rpms_ros.identification.projection.arrival import disagreement_limit
from rpms_ros.identification.projection.arrival import forget
from rpms_ros.identification.projection.arrival import yield_to_horizon
from rpms_ros.identification.projection.cells import COUNT
from rpms_ros.identification.projection.cells import HEAD
from rpms_ros.identification.projection.cells import SIZE
from rpms_ros.identification.projection.estimator import ProjectionEstimator
from rpms_ros.identification.projection.fit import COST
from rpms_ros.identification.projection.fit import DAMPING
from rpms_ros.identification.projection.fit import MOVED
from rpms_ros.identification.projection.fit import VARIANCE
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.fit import Known
from rpms_ros.identification.projection.fit import empty_fit
from rpms_ros.identification.projection.fit import fit_linear
from rpms_ros.identification.projection.intake import LEARNT
from rpms_ros.identification.projection.intake import restate
from rpms_ros.identification.projection.normal_equations import PARAMETERS
from rpms_ros.identification.projection.normal_equations import Baseline
from rpms_ros.identification.projection.settings import ProjectionSettings
from rpms_ros.identification.projection.step import complete
from rpms_ros.identification.projection.step import improve
from rpms_ros.identification.projection.step import theta_gradient
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

# There is room for pulses at this rate over the horizon [Hz]; at a higher one it is shorter.
_HIGHEST_RATE = 120.0
# Cells that a step period can bring before a step makes room again.
_SPARE_CELLS = 128
# Cells that no pulse begins, in one step period at the most.
_CELLS_OF_PAUSES = 4
# Of the baseline over the horizon, and how near they may be [ns]: a young horizon has two.
_KNOTS = 3
_LEAST_SPACING_NS = 15 * NANOSECONDS_PER_SECOND // 2
_TOLERANCE = 1e-10
# At most so many after the memory gave way: the optimum may have moved far.
_STEPS_AFTER_CHANGE = 5
# Then another start is tried every so many steps, as long as the horizon is: as in the batch.
_CHALLENGE_STEPS = 5
_CHALLENGER_STEPS = 10
_CHALLENGER_TOLERANCE = 1e-6
_START_DAMPING = 1e-2
# Steps shorter than this, taken with little damping, only follow the noise.
_CALM = 5e-3
_CALM_DAMPING = 1e-4


class HorizonEstimator(ProjectionEstimator):
    """Moving-horizon estimator.

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

    name = 'horizon'

    def __init__(
        self,
        settings: ProjectionSettings | None = None,
        rate_hz: float = DEFAULT_RATE,
    ) -> None:
        settings = settings if settings is not None else ProjectionSettings()
        seconds = settings.horizon + settings.basis.duration
        capacity = int(seconds * _HIGHEST_RATE) + _SPARE_CELLS
        super().__init__(settings, rate_hz, capacity, _KNOTS if settings.baseline else 0)
        self._step_ns = round(settings.step_period * NANOSECONDS_PER_SECOND)
        self._horizon_ns = round(settings.horizon * NANOSECONDS_PER_SECOND)
        self._memory_ns = round(settings.basis.duration * NANOSECONDS_PER_SECOND)
        self._limit = disagreement_limit(PARAMETERS + settings.basis.functions)
        self._last_ns: int | None = None
        self._rested = True
        self._starts = settings.starts()
        self._forgotten = settings.known()
        self._turn = 0
        self._settled_ns = -(2**63)

    def update(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        """Learn from samples (samples,), ascending; return their a-priori prediction [N].

        See `rpms_ros.identification.estimate.Estimator.update`.
        """
        prediction = np.empty(len(stamp_ns))
        if not len(stamp_ns):
            return prediction
        period = stamp_ns // self._step_ns
        starts = np.flatnonzero(np.diff(period)) + 1
        for first, last in zip((0, *starts), (*starts, len(stamp_ns)), strict=True):
            if self._last_ns is not None and period[first] != self._last_ns // self._step_ns:
                self._step_if_due()
            part = slice(first, last)
            self._make_room(int(stamp_ns[first]), int(stamp_ns[last - 1]))
            self._take(stamp_ns[part], force[part], usable[part], prediction[part])
            self._last_ns = int(stamp_ns[last - 1])
        return prediction

    def forget_pulses(self) -> None:
        """Drop the pulses that still act; what the horizon holds is kept as a quadratic cost."""
        super().forget_pulses()
        size = int(self._cells.place[SIZE])
        if size:
            self._leave(size)
            self._cells.place[SIZE] = 0
            self._first = 0
        self._last_ns = None
        self._settled_ns = -(2**63)

    def estimate(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Return what is known now."""
        return self._snapshot(stamp_ns, faults)

    def _step_if_due(self) -> None:
        """Take a step, or every other one while steps lead nowhere new."""
        scalars = self._fit.scalars
        calm = scalars[MOVED] < _CALM and scalars[DAMPING] <= _CALM_DAMPING
        if calm and not self._rested:
            self._rested = True
            return
        self._rested = False
        self._step()

    def _step(self) -> None:
        """Slide the horizon and take a step."""
        if self._intake.scalars[LEARNT] == 0.0:
            return
        self._slide()
        cells, known, fit = self._cells, self._known, self._fit
        if not self._holds_samples():
            # Nothing to learn from: what is remembered is all that is known.
            fit.complete[:] = 0.0
            return
        remembers = bool(known.information.any())
        if self.settings.forgetting and remembers:
            forget(known, fit, self.settings.forgetting)
        self._solve(fit, known, refresh=True)
        if self._unsettled:
            self._challenge()
        contradicted = remembers and self._compare()
        steps = _STEPS_AFTER_CHANGE if contradicted else self.settings.steps
        self._improve(fit, known, steps, _TOLERANCE, ready=remembers and not contradicted)
        restate(cells, self._intake, fit, self._kick)

    def _holds_samples(self) -> bool:
        """Return whether the horizon holds any sample, or nothing is remembered."""
        cells = self._cells
        order = (int(cells.place[HEAD]) + np.arange(self._first, int(cells.place[SIZE]))) % len(
            cells.start_ns
        )
        return bool(cells.moments[order, COUNT].any()) or not self._known.information.any()

    @property
    def _unsettled(self) -> bool:
        """Whether the horizon may hold samples from before a contradiction."""
        assert self._last_ns is not None
        return self._last_ns < self._settled_ns

    def _compare(self) -> bool:
        """Hold what is remembered against the horizon; return whether it had to give way."""
        cells, known, fit, work = self._cells, self._known, self._fit, self._work
        assert self._last_ns is not None
        complete(cells, self._first, self._kick, self._baseline, work, fit)
        gradient = np.zeros(PARAMETERS)
        theta_gradient(fit, known, gradient)
        # After a contradiction all that leaves is suspect: more than expected is too much.
        limit = float(len(known.reference)) if self._unsettled else self._limit
        statistic = yield_to_horizon(known, fit, gradient, limit)
        if statistic > self._limit:
            self._settled_ns = self._last_ns + self._horizon_ns
        if statistic <= limit:
            return False
        # The variance stays: it was found from the horizon alone.
        self._solve(fit, known, refresh=False)
        return True

    def _challenge(self) -> None:
        """Try another start, in turn, on the horizon alone; go on from there if it fits better.

        While the horizon holds two muscles the fit follows neither, and what leaves is linearised
        at its parameters: far from those of the new muscle that quadratic cost means nothing,
        and it would hold the fit in a local minimum.
        """
        self._turn = (self._turn + 1) % (_CHALLENGE_STEPS * len(self._starts))
        turn, remainder = divmod(self._turn, _CHALLENGE_STEPS)
        if remainder:
            return
        fit = self._fit
        here = self._from_horizon_alone(fit.theta)
        other = self._from_horizon_alone(self._starts[turn])
        self._improve(other, self._forgotten, _CHALLENGER_STEPS, _CHALLENGER_TOLERANCE)
        gain = here.scalars[COST] - other.scalars[COST]
        if gain > self._limit * fit.scalars[VARIANCE]:
            fit.theta[:] = other.theta
            fit.scalars[DAMPING] = other.scalars[DAMPING]
            self._known.information[:] = 0.0
            self._known.pull[:] = 0.0
            self._solve(fit, self._known, refresh=True)

    def _from_horizon_alone(self, theta: FloatArray) -> Fit:
        """Return a fit at theta (4,), its linear unknowns solved as if nothing were remembered."""
        other = empty_fit(theta, len(self._fit.linear), len(self._fit.levels))
        other.scalars[VARIANCE] = self._fit.scalars[VARIANCE]
        other.scalars[DAMPING] = _START_DAMPING
        self._solve(other, self._forgotten, refresh=False)
        return other

    def _solve(self, fit: Fit, known: Known, refresh: bool) -> None:
        fit_linear(
            self._cells,
            self._first,
            self._kick,
            self._baseline,
            known,
            self._work,
            fit,
            refresh,
        )

    def _improve(
        self, fit: Fit, known: Known, steps: int, tolerance: float, ready: bool = False
    ) -> None:
        improve(
            self._cells,
            self._first,
            self._kick,
            self._baseline,
            known,
            self._work,
            fit,
            self._trial,
            steps,
            tolerance,
            ready,
        )

    def _slide(self) -> None:
        """Let cells go that lie before the horizon; keep what leads the state up to it."""
        assert self._last_ns is not None
        cells = self._cells
        capacity = len(cells.start_ns)
        head, size = int(cells.place[HEAD]), int(cells.place[SIZE])
        start_ns = cells.start_ns[(head + np.arange(size)) % capacity]
        surplus = size - (capacity - _SPARE_CELLS)
        oldest = self._last_ns - self._horizon_ns
        leaving = int(np.searchsorted(start_ns[1:], oldest, side='right'))
        self._leave(min(max(leaving, surplus), size - 1))
        begin = int(start_ns[self._first])
        gone = int(np.searchsorted(start_ns, begin - self._memory_ns))
        gone = min(max(gone, surplus), self._first)
        if gone > 0:
            cells.place[HEAD] = (head + gone) % capacity
            cells.place[SIZE] -= gone
            self._first -= gone
        spacing = max((self._last_ns - begin) // (_KNOTS - 1), _LEAST_SPACING_NS)
        self._baseline = Baseline(self._baseline.knots, begin, spacing)

    def _make_room(self, first_ns: int, last_ns: int) -> None:
        """Let there be room for the cells up to `last_ns`, at the cost of the oldest ones.

        What leaves is remembered as always.  Pulses that began long before the first sample, in
        an outage of the force, no longer act.
        """
        pending = self._pending
        pending.drop(pending.begin_until(first_ns - 2 * self._memory_ns))
        cells = self._cells
        capacity = len(cells.start_ns)
        coming = pending.begin_until(last_ns)
        most = capacity - _CELLS_OF_PAUSES
        if coming > most:
            self._faults.add(PULSES_TOO_FREQUENT, coming - most)
            pending.drop(coming - most)
            coming = most
        lacking = int(cells.place[SIZE]) + coming + _CELLS_OF_PAUSES - capacity
        if lacking > 0:
            self._leave(min(max(lacking, self._first), int(cells.place[SIZE])))
            cells.place[HEAD] = (int(cells.place[HEAD]) + lacking) % capacity
            cells.place[SIZE] -= lacking
            self._first = max(self._first - lacking, 0)

    def _leave(self, last: int) -> None:
        """Keep what cells up to `last` say as a quadratic cost."""
        if last <= self._first:
            return
        absorb(
            self._cells,
            self._first,
            last,
            self._kick,
            self._baseline,
            self._known,
            self._work,
            self._fit,
            self._trial,
        )
        self._first = last
