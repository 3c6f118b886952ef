# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recursion for people: on line, one pass, a state of fixed size.

The algorithm of the paper with additions for people: Laguerre functions behind a latency,
alpha_thr free with a prior, a baseline, a weight for the interval between pulses, sums that are
valid for any parameters instead of derivatives at past parameters (`recursive_kernel`), a memory
that grows with the samples and is shortened when the muscle has changed, and intervals.

Steps are triggered by pulses and stamps alone, so the answer does not depend on how the data
are cut.

**Changes.**  The logarithm of the mean square q of the a-priori errors of a block is compared with
that of the last blocks of a like force: ``z = (log q - mean) / deviation``, limited to -3..3.  The
sum ``c <- max(0, c + z - 1.5)`` (Page's cumulative sum) stays near zero while the muscle does not
change.  A block of 50 ms or more adds at most 1.5, a shorter one less, so 1.2 s of pulses are
needed to exceed 35: a knock or a pulse that was not heard is no change.  Errors count that are
larger than with more force, and than doubts about the weights of the pulses explain.  A block with
z above 3 has a weight such that it would have had 3; between the pulses only if the two before it
are not like it, as the baseline may move there.

**Weights of pulses** are those of Eq. (10), which not every muscle has.  Where they differ from
pulse to pulse, as that of the first one of a train does, blocks weigh less: 5 to 21 % of one pulse
was enough to shift the baseline, and with it a curve without low intensities, by 2 to 3 %.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rpms_ros.errors import IdentificationError, check_number
from rpms_ros.identification.estimation.blocks import (
    COUNT,
    FORCE,
    LONGEST_BLOCK_NS,
    TIME,
    PulseDelayLine,
    newest,
)
from rpms_ros.identification.estimation.estimate_builder import (
    MISFIT,
    Counters,
    EstimateBuilder,
    Muscle,
    ResidualSums,
    Uncertainty,
    condition_number,
)
from rpms_ros.identification.estimation.prior import scaled_inverse
from rpms_ros.identification.estimation.settings import PRIOR, Prior, ProjectionSettings
from rpms_ros.identification.estimation.window_fit import (
    DEVIATION_VARIANCES,
    GAP,
    LEAST_ENERGY,
    RARE,
)
from rpms_ros.identification.model.estimate import DEFAULT_RATE, Estimate
from rpms_ros.identification.model.levenberg_marquardt import Ending
from rpms_ros.identification.model.recruitment import PARAMETERS, SINES, coordinates, recruitment
from rpms_ros.identification.quality.doubts import (
    CHANGED_LATELY,
    FACTORISATION_FAILED,
    INTERVALS_VARY,
    RESIDUALS_ALIKE,
    PlausibilityCheck,
    doubted,
)
from rpms_ros.identification.recursion.recursive_kernel import (
    KNOTS,
    Fit,
    StepProblem,
    add_block,
    begin_block,
    empty_fit,
    empty_memory,
    evaluate,
    excited,
    fresh_prediction_state,
    improve,
    interpolated_curve,
    let_baseline_drift,
    predict,
    recompute_response,
    reduced,
    refresh_variance,
    residual_sum,
    scale_memory,
    solve_linear,
    take,
    weak_ridge,
)
from rpms_ros.muscle.recruitment import RecruitmentParameters
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray

PEOPLE = ProjectionSettings(start=RecruitmentParameters(0.50, 0.90, 6.0, 5.5))
"""Model for people: latency of 8 ms, alpha_thr free."""

# Samples are forgotten with this time constant, in time during which pulses act; after a change
# the memory has the weight of so many seconds of samples [s].
_MEMORY_TIME, _MEMORY_AFTER_CHANGE = 40.0, 0.02
# Standard deviation of the random walk of the baseline in a second, relative to that of the noise
# of a sample.
_WALK = 0.1
# Shortest time between two steps of the parameters [ns].
_STEP_NS = 40_000_000
# Another start is tried every so many steps, with so many steps of its own; it is taken if its
# cost is lower by more than noise explains (chi-square, one in a thousand, four parameters).
_CHALLENGE_STEPS = 20
_CHALLENGER_STEPS = Ending(5, 0.0, 0.0)
_ONE_STEP, _FOLLOWING = Ending(1, 0.0, 0.0), Ending(20, 1e-6, 0.0)
_CHALLENGER_GAIN = 18.5
_START_DAMPING = 1e-2
_FIRST_VARIANCE = 0.01
# The deviation's size and length are chosen every so many steps; correlated residuals count at
# most by this factor then.
_SHAPE_STEPS, _MOST_INFLATION = 20, 10.0
# Most blocks of a class over which mean and deviation are taken: fewer while errors fall, or the
# first ones hide pulses that were not heard.
_BLOCKS, _FIRST_BLOCKS = 200.0, 30.0
_MOST, _DRIFT, _LIMIT, _BLOCK_S = 3.0, 1.5, 35.0, 0.05
# Classes of blocks by their force, relative to its root mean square, and blocks to know one.
_CLASSES, _FEW = 4, 10.0
# Standard deviation of the logarithm of a mean of 50 squares of white noise.
_LEAST_DEVIATION = 0.2
# Before this time the errors fall because the recursion learns [s].
_SETTLING_TIME = 5.0


class ChangeTest:
    """State of the test.

    Attributes
    ----------
    learnt_s : float
        Time in which pulses acted since the start or the last change [s].
    changes : int
        How many changes were found.
    power : float
        Mean square of the force in the last blocks [N^2].
    changed_ns : int or None
        When the newest change began [ns]; None before one, and after a jump of the clock.
    """

    def __init__(self) -> None:
        self.changed_ns: int | None = None
        self.changes = self._begun_ns = 0
        self.learnt_s = self._sum = self.power = 0.0
        self._mean, self._variance, self._blocks = np.zeros((3, _CLASSES))
        # logarithms of the errors of the last blocks: a glitch is in one or two of them
        self._newest = [0.0, 0.0, 0.0]

    def interrupt(self) -> None:
        """Reset the sum and forget when a change was: the next blocks are of another clock."""
        self._sum = 0.0
        self.changed_ns = None

    @property
    def settling(self) -> bool:
        """Whether the errors fall because the recursion learns."""
        return self.learnt_s <= _SETTLING_TIME

    def take(
        self,
        start_ns: int,
        lasted: float,
        error: float,
        force: float,
        doubt: float,
        acting: bool,
        counted: float = 1.0,
    ) -> tuple[float, bool]:
        """Add a block; return its weight, and whether the muscle has changed.

        The weight is below 1 where the errors are unusually large, between the pulses for no
        longer than a few blocks: there the baseline may have moved.

        Parameters
        ----------
        start_ns : int
            When the block began [ns].
        lasted : float
            How long it was [s].
        error : float
            Mean square of its a-priori errors, above zero [N^2].
        force : float
            Its mean force above the baseline [N]: errors of a model grow with the force.
        doubt : float
            Error that the weights of its pulses and the curve may have [N].
        acting : bool
            Whether pulses act in it.
        counted : float
            Share of it that counts, below 1 where a pulse may be missing.
        """
        value = math.log(error)
        self._newest = [*self._newest[1:], value]
        self.power += (force**2 - self.power) / _BLOCKS * acting
        ratio = (self.power + LEAST_ENERGY) / (force**2 + LEAST_ENERGY)
        at = min(int(max(1.0 + 0.5 * math.log2(ratio), 0.0)), _CLASSES - 1)
        # of a class that is not known yet: the one that is known best
        like = at if self._blocks[at] >= _FEW else int(np.argmax(self._blocks))
        weight = 1.0
        if self._blocks[like] >= _FEW:
            deviation = math.sqrt(max(self._variance[like], _LEAST_DEVIATION**2))
            # what is usual with more force moves the baseline
            known = self._blocks[: like + 1] >= _FEW
            usual = [*self._mean[: like + 1][known], math.log(doubt**2 + LEAST_ENERGY)]
            usual += [] if acting else [min(self._newest)]
            away = (value - max(usual)) / deviation
            weight = math.exp(min((_MOST - away) * deviation, 0.0))
            if self._sum == 0.0:
                self._begun_ns = start_ns
            if acting and not self.settling:
                added = min(max(away, -_MOST), _MOST) - _DRIFT
                self._sum = max(0.0, self._sum + counted * added * min(lasted / _BLOCK_S, 1.0))
        if not acting:
            return weight, False
        self.learnt_s += lasted
        if self._sum > _LIMIT:
            self.changes += 1
            self.changed_ns = self._begun_ns
            self._sum = self.learnt_s = 0.0
            self._blocks[:] = self._mean[:] = 0.0
            return weight, True
        if self._sum == 0.0:
            most = _FIRST_BLOCKS if self.settling else _BLOCKS
            count = self._blocks[at] = min(self._blocks[at] + 1.0, most)
            away = value - self._mean[at]
            self._mean[at] += away / count
            self._variance[at] += (away * (value - self._mean[at]) - self._variance[at]) / count
        return weight, False


# Lengths over which residuals are summed [ns].
_LENGTH_NS = np.array([100_000_000, 500_000_000, 2_000_000_000])
# Least number of sums for a result.
_LEAST_SUMS = 3.0


class ResidualSpread:
    """Running means of (sum of residuals)^2 / samples, for each length."""

    def __init__(self) -> None:
        self._cell = np.zeros_like(_LENGTH_NS)
        self._sum, self._count, self._total, self._weight = np.zeros((4, len(_LENGTH_NS)))
        # samples, seconds and squared recruitment
        self._kept = np.zeros(3)

    def take(
        self, start_ns: int, seconds: float, error: float, samples: float, rho: float, kept: float
    ) -> None:
        """Add a block.

        Parameters
        ----------
        start_ns : int
            Its start [ns].
        seconds : float
            The time that its samples cover.
        error : float
            Sum of its residuals [N].
        samples : float
            Number of its samples.
        rho : float
            Recruitment of its pulse.
        kept : float
            Factor on the weights of earlier blocks.
        """
        ended = (start_ns // _LENGTH_NS != self._cell) & (self._count > 0.0)
        self._total[ended] += self._sum[ended] ** 2 / self._count[ended]
        self._weight[ended] += 1.0
        self._sum[ended] = self._count[ended] = 0.0
        self._cell = start_ns // _LENGTH_NS
        self._sum += error
        self._count += samples
        self._total *= kept
        self._weight *= kept
        self._kept *= kept
        self._kept += (samples, seconds, rho**2)

    def forget(self) -> None:
        """Forget all earlier blocks."""
        self._total[:] = self._weight[:] = self._kept[:] = 0.0

    @property
    def sums(self) -> ResidualSums:
        """The means, zero with too few sums, and what they were made from."""
        mean = self._total / np.maximum(self._weight, 1.0) * (self._weight >= _LEAST_SUMS)
        return ResidualSums(mean, float(self._weight[0]), *self._kept.tolist())


# Residuals count for the intervals with this share of the time since the last change as time
# constant: the first ones are errors of parameters that were not known yet.
_NEWEST = 0.25
# Errors below this share of the variance are not distinguished.
_FLOOR = 0.01
# Error of the model as a share of the force, all of it in the direction that is asked for.
_SHARE = 3e-4
# Residuals are alike where sums over half a second are this share of the force, and by so much
# above those of white noise: an effort, or a slip of the coil.
_ALIKE, _SURELY = 2e-3, 16.0
# Without a lower intensity than this the constant part of the curve shows in the ripple alone, and
# sums over a tenth of a second tell by this factor of what distorts that, such as a filter.
_LOW, _ALSO = 0.1, 4.0
# Intervals vary where the weights of more than this share of the pulses differ by this factor from
# the weight of the one before; a lost pulse makes two.
_VARYING, _APART = 0.1, 1.1
# Where the weight of a pulse by its interval differs from that of the one before, Eq. (10) may be
# wrong by all of it: blocks weigh less above this share of the weight, while the twitch lasts [s].
_KNOWN, _TWITCH = 0.01, 0.1
# The share of it that errors are taken to be: other pulses act, and by less.
_EXPLAINED = 0.5
# Where the memory has fewer pulses than this of intensities not further away than that, the curve
# is not known: errors may be so large a share of the force.
_SEEN, _NEAR, _UNSEEN_ERROR = 5.0, 0.05, 0.1
# Usual is the mean of so many intervals, gaps are rare among so many; after one, for so long [ns],
# blocks weigh and count so little.
_INTERVALS, _LATEST = 10.0, 50.0
_AFTER_GAP_NS, _AFTER_GAP, _NEVER_NS = 500_000_000, 0.01, -(2**62)
_FIRST_INTERVAL_NS = 50e6


class FixedSizeRecursion:
    """Recursive Levenberg-Marquardt with sums that are valid for any parameters.

    Parameters
    ----------
    settings : ProjectionSettings
        Basis, start, prior, `by_rate` and level of the intervals; `PEOPLE` by default.
    rate_hz : float
        Repetition rate for which the recruitment curve is stated [Hz].

    Raises
    ------
    IdentificationError
        If the rate is not above zero.
    """

    name = 'recursive'
    on_line = True

    def __init__(
        self, settings: ProjectionSettings = PEOPLE, rate_hz: float = DEFAULT_RATE
    ) -> None:
        check_number(IdentificationError, 'repetition rate', rate_hz, 0, above=True, unit='Hz')
        self.settings, self.rate_hz = settings, rate_hz
        basis = settings.basis
        self._input_gain = basis.input_gain
        self._rate = 2.0 / basis.time_constant
        self._memory = empty_memory(KNOTS, basis.functions)
        self._prediction = fresh_prediction_state(basis.functions)
        start = np.zeros(PARAMETERS + SINES * settings.deviation)
        start[:PARAMETERS] = settings.start
        self._fit = empty_fit(start, basis.functions, 1)
        # of the last step that could be taken
        self._information = self._fit.matrix.copy()
        # scratch: a trial step, and a fit from another start
        self._trial, self._other = (empty_fit(start, basis.functions, 1) for _ in range(2))
        self._starts = [other[: len(start)] for other in settings.starts(SINES)]
        # the latter: places in `SIZES` and `LENGTHS`
        self._steps, self._shape = 0, (0, 1)
        self._prior = self._prior_of(self._shape)
        self._test = ChangeTest()
        self._spread = ResidualSpread()
        self._stepped_ns: int | None = None
        self._delay_line = PulseDelayLine(basis.latency, settings.by_rate, rate_hz)
        self._builder = EstimateBuilder(
            self.name, basis, rate_hz, settings.confidence, False, interpolated_curve
        )
        self._plausibility = PlausibilityCheck()
        # pulses that acted, those of another weight than the one before, the last weight, and the
        # share by which the weights of the pulses that act may be wrong
        self._acted, self._varied, self._last_weight, self._unsure = 0, 0, 1.0, 0.0
        # the last pulse, the mean interval, and the pulse after the last gap [ns]; share of gaps
        self._last_ns: int | None = None
        self._interval_ns, self._gap_ns, self._gaps = _FIRST_INTERVAL_NS, _NEVER_NS, 0.0

    @property
    def memory(self) -> float:
        """Longest time for which a pulse acts on the model's output [s]."""
        return self.settings.basis.duration

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending, none before one that was already added [ns, 1]."""
        self._plausibility.add_pulses(onset_ns, intensity)
        self._delay_line.add(onset_ns, intensity)

    def forget_pulses(self) -> None:
        """Drop the pulses that still act: the clock has jumped, their lag is unknown."""
        self._delay_line.forget()
        self._memory.blocks.size[0] = 0
        self._stepped_ns = self._last_ns = None
        self._gap_ns = _NEVER_NS
        carried = self._prediction
        carried.error_energy[0] = carried.force_energy[0] = carried.squares[0] = 0.0
        self._test.interrupt()

    def update(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        """Learn from samples (samples,), ascending; return their a-priori prediction [N].

        See `rpms_ros.identification.model.estimate.Estimator.update`.
        """
        prediction = np.empty(len(stamp_ns))
        blocks, carried = self._memory.blocks, self._prediction
        self._plausibility.add_forces(force, usable)
        first = 0
        while first < len(stamp_ns):
            end_ns = self._begin_blocks(int(stamp_ns[first]))
            last = int(np.searchsorted(stamp_ns, end_ns, side='right'))
            part, level = slice(first, last), float(self._fit.levels[0])
            given = stamp_ns[part], force[part], usable[part]
            prediction[part] = take(*given, blocks, carried, level, self._rate)
            first = last
        return prediction

    def predict(self, stamp_ns: IntArray) -> FloatArray:
        """Return the prediction of the next samples (samples,), ascending [N]."""
        line, carried, fit = self._delay_line, self._prediction, self._fit
        pending = line.begin_ns, line.intensity, self._input_gain * line.weight
        return predict(stamp_ns, pending, self._memory, carried, fit, self._rate)

    def estimate(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Return the present estimate."""
        fit, carried = self._fit, self._prediction
        energy = float(carried.force_energy[0])
        counters = Counters(
            samples=int(carried.learnt[0]),
            pulses=self._plausibility.pulses,
            intensity_range=self._plausibility.intensity_range,
            output_error=float(np.sqrt(carried.error_energy[0] / energy)) if energy > 0.0 else 0.0,
        )
        if fit.failures[0]:
            faults = {**faults, FACTORISATION_FAILED: int(fit.failures[0])}
        estimate = self._builder.make(stamp_ns, *self._found(), PRIOR.deviation, counters, faults)
        estimate = replace(self._plausibility.examine(estimate), changes=self._test.changes)
        settling = self._test.changes > 0 and self._test.settling
        varied, sums = self._varied > _VARYING * self._acted, self._spread.sums
        # of the mean force in half a second
        power = self._test.power * 0.5 * sums.samples / max(sums.seconds, 1e-3)
        alike = sums.spread[1] > max(_ALIKE**2 * power, _SURELY * float(fit.variance[0]))
        alike |= counters.intensity_range[0] > _LOW and sums.spread[0] > _ALSO * fit.variance[0]
        doubts = {INTERVALS_VARY: varied, CHANGED_LATELY: settling, RESIDUALS_ALIKE: bool(alike)}
        estimate = doubted(estimate, doubts)
        if self._test.changed_ns is None:
            return estimate
        ago = np.array([(stamp_ns - self._test.changed_ns) / NANOSECONDS_PER_SECOND])
        # the test does not tell what has changed
        return replace(estimate, change_kinds=('unknown',), change_ago=ago)

    def _found(self) -> tuple[Muscle, Uncertainty | None]:
        """Return the muscle that is known, and its uncertainty, None while there is no sample."""
        fit, sums = self._fit, self._spread.sums
        many = len(fit.theta)
        joint = many + len(fit.linear)
        levels, moved = fit.levels.copy(), float(fit.moved[0])
        muscle = Muscle(fit.theta.copy(), fit.linear.copy(), levels, moved, float(fit.damping[0]))
        if not fit.samples[0] > 0.0:
            return muscle, None
        data = self._information
        variance, before = float(fit.variance[0]), self._prior.deviation
        ridge = np.full(len(data) - many, weak_ridge(fit.energy[0], fit.samples[0], variance))

        of_linear = data[many:joint, many:joint]
        of_model = _SHARE**2 * float(fit.linear @ of_linear @ fit.linear)
        noise, spread = variance + of_model, float(sums.spread.max(initial=0.0)) + of_model
        known = np.concatenate((noise / before**2, ridge))
        covariance = noise * scaled_inverse(data + np.diag(known))[:joint, :joint]
        # parameter by parameter: what correlates residuals, such as an effort, may also be in
        # what the parameters have in common; those of theta at most to those of the prior
        scale = np.full(joint, math.sqrt(max(1.0, spread / noise)))
        deviation = np.sqrt(np.maximum(np.diag(covariance)[:many], 1e-300))
        scale[:many] = np.minimum(scale[:many], np.maximum(before / deviation, 1.0))
        covariance *= np.outer(scale, scale)
        area = np.linalg.norm(fit.linear) * np.linalg.norm(self.settings.basis.area)
        by_basis = MISFIT * float(area) / math.sqrt(len(fit.linear))
        muscle = muscle._replace(
            condition=condition_number(of_linear),
            area_error=math.hypot(by_basis, sums.missing_area(variance)),
        )
        return muscle, Uncertainty(
            covariance, self.settings.confidence, muscle.theta, muscle.linear
        )

    def _begin_blocks(self, stamp_ns: int) -> int:
        """Begin the block of a sample; return the end of that block [ns]."""
        line, blocks = self._delay_line, self._memory.blocks
        begun = line.begin_until(stamp_ns)
        for pulse in range(begun):
            weight = float(line.weight[pulse])
            least, most = sorted((weight, self._last_weight))
            self._varied += self._acted > 0 and most > _APART * least
            self._acted, self._last_weight = self._acted + 1, weight
            begin_ns = int(line.begin_ns[pulse])
            # before the block ends: one that is missing has acted in it
            self._note_interval(begin_ns)
            self._begin_block(begin_ns, float(line.intensity[pulse]), weight)
            self._unsure = math.hypot(self._unsure, most / least - 1.0)
        line.drop(begun)
        if not blocks.size[0] or blocks.start_ns[newest(blocks)] < stamp_ns - LONGEST_BLOCK_NS:
            self._begin_block(stamp_ns, 0.0, 0.0)
        end_ns = int(blocks.start_ns[newest(blocks)]) + LONGEST_BLOCK_NS
        return min(end_ns, int(line.begin_ns[0])) if len(line.begin_ns) else end_ns

    def _note_interval(self, begin_ns: int) -> None:
        """Note a pulse, and whether one before it may be missing."""
        if self._last_ns is not None:
            interval_ns, usual_ns = begin_ns - self._last_ns, self._interval_ns
            gap = interval_ns > GAP * usual_ns
            self._gaps += (gap - self._gaps) / _LATEST
            if gap and self._gaps < RARE:
                self._gap_ns = begin_ns
            self._interval_ns += (min(interval_ns, 2.0 * usual_ns) - usual_ns) / _INTERVALS
        self._last_ns = begin_ns

    def _begin_block(self, start_ns: int, intensity: float, weight: float) -> None:
        """End the present block and begin the next one."""
        memory = self._memory
        if memory.blocks.size[0]:
            self._close_block(start_ns)
        fit = self._fit
        begin_block(memory, start_ns, intensity, self._input_gain * weight, self._rate)
        recompute_response(memory.chains, fit.theta, fit.linear, self._prediction.response)

    def _close_block(self, end_ns: int) -> None:
        """Add a complete block to the memory, test for a change, take a step if one is due."""
        memory, fit = self._memory, self._fit
        here = newest(memory.blocks)
        samples = float(memory.blocks.moments[here, COUNT])
        start_ns = int(memory.blocks.start_ns[here])
        squares = float(self._prediction.squares[0])
        self._prediction.squares[0] = 0.0
        if not samples:
            return
        seconds = (end_ns - start_ns) / NANOSECONDS_PER_SECOND
        error = squares / samples + _FLOOR * float(fit.variance[0]) + LEAST_ENERGY
        residual = residual_sum(memory.blocks, self._prediction.response, float(fit.levels[0]))
        moments, kept = memory.blocks.moments[here], 1.0
        # as the model has it: the measured one may be that of a knock
        force = (float(moments[FORCE]) - residual) / samples - float(fit.levels[0])
        intensity, acting = float(memory.blocks.intensity[here]), excited(memory, self._input_gain)
        gap = start_ns - self._gap_ns < _AFTER_GAP_NS
        unseen = intensity > 0.0 and not gap and self._unseen(intensity, samples)
        doubt = force * max(_EXPLAINED * self._unsure, _UNSEEN_ERROR * unseen)
        counted = _AFTER_GAP if gap else 1.0
        share, changed = self._test.take(start_ns, seconds, error, force, doubt, acting, counted)
        share *= counted * min(1.0, (_KNOWN / max(self._unsure, _KNOWN)) ** 2)
        self._unsure *= math.exp(-seconds / _TWITCH)
        if acting:
            scale_memory(memory, math.exp(-seconds / _MEMORY_TIME))
            window = min(max(_NEWEST * self._test.learnt_s, 1.0), _MEMORY_TIME)
            kept = math.exp(-seconds / window)
        for sums in (memory.blocks.gram, memory.blocks.response, memory.blocks.moments):
            sums[here] *= share
        weight = float(memory.blocks.weight[here]) / self._input_gain
        rho = recruitment(intensity, fit.theta)
        # the block may have ended without samples: their mean time is half of what they cover
        covered = 2.0 * float(memory.blocks.moments[here, TIME]) / (share * samples)
        self._spread.take(start_ns, covered, share * residual, share * samples, weight * rho, kept)
        let_baseline_drift(memory, _WALK**2 * seconds)
        add_block(memory, here)
        if changed:
            after = _MEMORY_AFTER_CHANGE * samples / max(seconds, 1e-3)
            scale_memory(memory, min(after / float(memory.samples[0]), 1.0))
            self._spread.forget()
            fit.damping[0] = _START_DAMPING
        if self._stepped_ns is None or end_ns - self._stepped_ns >= _STEP_NS:
            self._stepped_ns = end_ns
            self._learn()

    def _unseen(self, intensity: float, samples: float) -> bool:
        """Return whether hardly a pulse in the memory was like one with so many samples."""
        energy = np.diag(self._memory.gram)[:-1].reshape(KNOTS, -1).sum(axis=1)
        near = np.abs(np.arange(1.0, KNOTS + 1.0) / KNOTS - intensity) < _NEAR
        seen = energy[near].sum() * self._memory.samples[0]
        return bool(seen < _SEEN * energy.sum() * samples)

    def _learn(self) -> None:
        """Take a step from the memory; a failure is counted."""
        memory, fit = self._memory, self._fit
        if fit.variance[0] == 0.0:
            fit.variance[0] = _FIRST_VARIANCE * memory.energy[0] / memory.samples[0] + LEAST_ENERGY
        if not evaluate(memory, self._prior, fit):
            fit.failures[0] += 1.0
            return
        refresh_variance(memory, self._prior, fit)
        self._steps += 1
        due = self.settings.deviation and self._steps % _SHAPE_STEPS == 0
        if due and self._choose_shape():
            # where the deviation has another prior, all else has to follow, before another start
            # is compared with it
            self._fit = self._improved(self._fit, _FOLLOWING)
        if self._steps % _CHALLENGE_STEPS == 0:
            self._challenge(self._starts[self._steps // _CHALLENGE_STEPS % len(self._starts)])
        self._fit = self._improved(self._fit, _ONE_STEP)
        # The covariance of weighted samples depends on the sum of the squared weights.
        self._information = self._fit.matrix * (memory.samples[0] / memory.squared_samples[0])

    def _prior_of(self, shape: tuple[int, int]) -> Prior:
        """Return the prior with a deviation of this size and length."""
        if not self.settings.deviation:
            return PRIOR
        deviation = np.sqrt(DEVIATION_VARIANCES[shape][:SINES])
        return PRIOR._replace(
            mean=np.append(PRIOR.mean, 0.0 * deviation),
            deviation=np.append(PRIOR.deviation, deviation),
            lower=np.append(PRIOR.lower, deviation - np.inf),
            upper=np.append(PRIOR.upper, deviation + np.inf),
        )

    def _choose_shape(self) -> bool:
        """Let the deviation follow the evidence, its size by one place; return whether it does."""
        fit, many = self._fit, len(self._fit.theta)
        spread = float(self._spread.sums.spread.max(initial=0.0))
        variance = min(max(spread, fit.variance[0]), _MOST_INFLATION * fit.variance[0])
        information, slope = np.zeros((many, many)), np.zeros(many)
        if not reduced(self._memory, fit, information, slope):
            return False

        def evidence(shape: tuple[int, int]) -> float:
            prior = self._prior_of(shape)
            away = (coordinates(fit.theta) - prior.mean) / prior.deviation
            scale = np.outer(prior.deviation, prior.deviation) / variance
            matrix = information * scale + np.eye(many)
            right = slope * prior.deviation / variance - away
            gained = right @ np.linalg.solve(matrix, right)
            return float(gained - away @ away - np.linalg.slogdet(matrix)[1])

        near = [shape for shape in DEVIATION_VARIANCES if abs(shape[0] - self._shape[0]) <= 1]
        before, self._shape = self._shape, max([self._shape, *near], key=evidence)
        self._prior = self._prior_of(self._shape)
        # the cost by that prior
        return self._shape != before and solve_linear(self._memory, self._prior, fit)

    def _improved(self, fit: Fit, ending: Ending) -> Fit:
        """Return a fit after some steps; the other of it and the trial is scratch."""
        if improve(StepProblem(self._memory, self._prior), fit, self._trial, ending):
            fit, self._trial = self._trial, fit
        return fit

    def _challenge(self, start: FloatArray) -> None:
        """Try another start; continue from there if it fits the memory better."""
        fit, other = self._fit, self._other
        other.theta[:], other.linear[:] = start, fit.linear
        other.variance[0], other.damping[0] = fit.variance[0], _START_DAMPING
        if not evaluate(self._memory, self._prior, other):
            return
        other = self._improved(other, _CHALLENGER_STEPS)
        if other.cost[0] < fit.cost[0] - _CHALLENGER_GAIN * fit.variance[0]:
            other.moved[0], other.failures[0] = fit.moved[0], fit.failures[0]
            self._fit, other = other, fit
        self._other = other
