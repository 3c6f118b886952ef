# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a result may be used: good, doubtful or no, with reasons.

The checks look for signs of wrong input or failed identification in the pulses and the force, the
force simulated with the estimate (`rpms_ros.identification.simulated_fit`), the prediction of the
end of the session by an earlier estimate, the a-priori residual, and the doubts and intervals of
the estimator.
"""

import math
from collections.abc import Iterator
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rpms_ros.axis import QUANTITIES
from rpms_ros.identification import verdict_of_data
from rpms_ros.identification import verdict_of_estimate
from rpms_ros.identification.analysis.dynamics import TrainDynamics
from rpms_ros.identification.constancy.answer import FOLLOWER
from rpms_ros.identification.constancy.answer import change_over
from rpms_ros.identification.faults import PULSE_INTENSITY_INVALID
from rpms_ros.identification.output_error import settled
from rpms_ros.identification.plausibility import CLOCKS_DIFFER
from rpms_ros.identification.plausibility import OF_TIME
from rpms_ros.identification.plausibility import stated_doubt
from rpms_ros.identification.session import IdentifiedSession
from rpms_ros.identification.simulated_fit import SimulatedFit
from rpms_ros.identification.simulated_fit import simulated_fit
from rpms_ros.identification.simulated_fit import white_noise
from rpms_ros.identification.stream_settings import StreamSettings
from rpms_ros.identification.verdict_settings import DOUBTFUL
from rpms_ros.identification.verdict_settings import GOOD
from rpms_ros.identification.verdict_settings import GRADES
from rpms_ros.identification.verdict_settings import NO
from rpms_ros.identification.verdict_settings import Reason
from rpms_ros.identification.verdict_settings import VerdictSettings
from rpms_ros.printable import percent_explained
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import PulseTrain
from rpms_ros.pulses import nanoseconds
from rpms_ros.schema import documented

# Length of the end that is judged: two periods of the slow sinusoids in use; a muscle that tires
# changes by a quarter meanwhile, which leaves 0.03 of the variance unexplained.  Half of it for an
# estimator that follows such changes, because its estimate is that of the end.
_SPAN_NS = 20 * NANOSECONDS_PER_SECOND
# The force of the last pulse is over by then.
_AFTER_NS = NANOSECONDS_PER_SECOND // 2
# The estimate after this share of the session has to predict the rest.
_LEARNT_SHARE = 0.8
# A force that rose by more than this share of itself was none before [1].
_FROM_NOTHING = 10.0
_HINT = f'; --estimator {FOLLOWER} tells a muscle that changes, efforts and tremor apart'
_DYNAMICS_ONLY = 'dynamics only: one intensity shows no recruitment curve'
# With so many estimates there is one close to that time.
_ESTIMATES = 8


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether a result may be used."""

    grade: str = documented('good, doubtful or no')
    reasons: tuple[str, ...] = documented('why, the most serious first')

    @property
    def line(self) -> str:
        """The verdict in one line."""
        return f'{self.grade}: {"; ".join(self.reasons)}'


def of_reasons(reasons: Sequence[Reason], praise: str) -> Verdict:
    """Return the verdict with the grade of the most serious reason; `praise` if there is none."""
    ordered = sorted(reasons, key=lambda reason: -GRADES.index(reason[0]))
    if not ordered:
        return Verdict(grade=GOOD, reasons=(praise,))
    return Verdict(grade=ordered[0][0], reasons=tuple(text for _, text in ordered))


def period_of_estimates(duration: float) -> float:
    """Return the estimate period needed to judge a session of a duration [s].

    It is the period on line times a power of two, so that every estimate of a coarser grid is one
    of each finer grid: the verdict does not depend on how many other estimates there are.
    """
    on_line = StreamSettings().estimate_period
    return on_line * doublings(duration / (_ESTIMATES * on_line))


def doublings(least: float) -> int:
    """Return the smallest power of two that is not below `least`, at least 1."""
    return 1 if not least > 1.0 else int(2 ** math.ceil(math.log2(least)))


def verdict_of(
    session: IdentifiedSession,
    pulses: PulseTrain,
    forces: ForceTrace,
    settings: VerdictSettings | None = None,
    dynamics: TrainDynamics | None = None,
) -> Verdict:
    """Return the verdict on a session.

    Parameters
    ----------
    session : IdentifiedSession
        The result.
    pulses, forces : PulseTrain, ForceTrace
        The recording.
    settings : VerdictSettings, optional
        Thresholds.
    dynamics : TrainDynamics, optional
        Dynamics found from trains of one intensity; judged if the estimate has no curve.
    """
    settings = settings or VerdictSettings()
    unit = session.last.unit
    reasons = list(
        verdict_of_data.reasons(
            pulses, forces, settings.expected_force, settings.least_force, unit
        )
    )
    if not any(grade == NO for grade, _ in reasons):
        reasons += [
            (NO if name == CLOCKS_DIFFER else DOUBTFUL, stated_doubt(session.last, name))
            for name in OF_TIME
            if name in session.last.doubts
        ]
    if any(grade == NO for grade, _ in reasons):
        return of_reasons(reasons, '')
    if dynamics is not None and not session.last.curve_known:
        return _of_dynamics(reasons, dynamics, settings, unit)
    part = _looked_at(session, pulses)
    if np.count_nonzero(part) < 3:
        return of_reasons([*reasons, (NO, _nothing_to_judge_by(session, pulses))], '')
    found = simulated_fit(session.last, pulses, session.stamp_ns[part], session.force[part])
    span = float(np.ptp(session.force[session.usable]))
    reasons += verdict_of_estimate.of_the_estimate(session.last, found, span, settings)
    changed = list(_of_one_muscle(session, pulses, settings))
    hint = '' if changed or session.last.rate_names else _HINT
    reasons += changed
    reasons += _of_the_fit(session, pulses, part, found, settings, hint)
    explained = found.explained >= settings.good_explained
    reasons += verdict_of_estimate.of_the_estimator(session, pulses, settings, explained)
    # without a curve the force is explained at one intensity only
    scope = '' if session.last.curve_known else f'{_DYNAMICS_ONLY}; '
    praise = (
        f'{scope}the identified muscle explains {percent_explained(found.explained)} % of the '
        f'{QUANTITIES[unit]}'
    )
    return of_reasons(reasons, praise)


def _nothing_to_judge_by(session: IdentifiedSession, pulses: PulseTrain) -> str:
    nothing = 'there is no force to judge by while pulses act'
    if session.last.faults.get(PULSE_INTENSITY_INVALID):
        return f'{nothing}: {verdict_of_data.invalid_intensities(pulses)}'
    return nothing


def _of_dynamics(
    reasons: list[Reason], dynamics: TrainDynamics, settings: VerdictSettings, unit: str
) -> Verdict:
    """Return the verdict on trains of one intensity, which give dynamics but no curve."""
    if dynamics.gain < 0.0:
        text = (
            f'the {QUANTITIES[unit]} of a pulse comes out negative, {dynamics.gain:.3g} {unit}: '
            'sign or axis of the sensor is wrong (--sign, --axis)'
        )
        return of_reasons([*reasons, (NO, text)], '')
    explained = 1.0 - (1.0 - dynamics.fit_percent / 100.0) ** 2
    text = (
        f'{_DYNAMICS_ONLY}; the model of the trains ({dynamics.model}) explains '
        f'{percent_explained(explained)} % of the variance of the {QUANTITIES[unit]}'
    )
    if explained < settings.good_explained:
        grade = NO if explained < settings.least_explained else DOUBTFUL
        reasons.append((grade, text))
    if dynamics.onset_s is None:
        reasons.append((DOUBTFUL, 'noise hides when the force begins'))
    return of_reasons(reasons, text)


def _looked_at(session: IdentifiedSession, pulses: PulseTrain) -> BoolArray:
    """Return which samples (samples,) are judged: those of the end, or all of a short session."""
    stamps = session.stamp_ns
    onset = pulses.onset_ns[(pulses.onset_ns >= stamps[0]) & (pulses.onset_ns <= stamps[-1])]
    if not len(onset):
        return np.zeros(len(stamps), dtype=np.bool_)
    begin, end = int(onset.min()), int(onset.max()) + _AFTER_NS
    span_ns = _SPAN_NS // 2 if session.last.rate_names else _SPAN_NS
    if end - begin > 1.5 * span_ns:
        begin = end - span_ns
    part: BoolArray = session.in_order & (stamps >= begin) & (stamps <= end)
    return part


def _of_one_muscle(
    session: IdentifiedSession, pulses: PulseTrain, settings: VerdictSettings
) -> Iterator[Reason]:
    """Yield a reason if one estimate is made of a session in which the muscle changed."""
    last = session.last
    change = change_over(session, pulses)
    if change is None or abs(change.share) < settings.largest_change:
        return
    how = f'{"fell" if change.share < 0.0 else "rose"} by {100 * abs(change.share):.0f} %'
    if change.share > _FROM_NOTHING:
        how = 'rose from next to nothing'
    when = 'over the session'
    if change.sudden_at_s is not None:
        when = f'at about {change.sudden_at_s:.0f} s'
    yield (
        DOUBTFUL,
        (
            f'the muscle changed: the {QUANTITIES[last.unit]} that pulses cause '
            f'{how} {when}, '
            f'and {last.estimator} takes the muscle for constant; '
            f'--estimator {FOLLOWER} follows it'
        ),
    )


def _of_the_fit(
    session: IdentifiedSession,
    pulses: PulseTrain,
    part: BoolArray,
    found: SimulatedFit,
    settings: VerdictSettings,
    hint: str,
) -> Iterator[Reason]:
    """Yield reasons from residual, held-out error and baseline."""
    force, stamps = session.force, session.stamp_ns
    span = float(np.ptp(force[session.usable]))
    predicted = np.isfinite(session.shown_prediction)
    late = part & settled(stamps) & predicted
    if session.last.curve_known and not late.any():
        yield (DOUBTFUL, 'too short: no sample was predicted before it was learnt')
    residual = (force - session.prediction)[late]
    error = float(np.sqrt(np.mean(np.square(residual)))) if len(residual) else 0.0
    slow = max(error**2 - white_noise(force[late]) ** 2, 0.0) ** 0.5 if error else 0.0
    if slow > settings.largest_residual * span:
        yield (
            DOUBTFUL,
            (
                f'the residual is not white: {slow:.2g} {session.last.unit} of it, '
                f'{100 * slow / span:.2g} % of the '
                f'range of the force, is no noise of the sensor{hint}'
            ),
        )
    seconds = float(np.ptp(stamps[part])) / NANOSECONDS_PER_SECOND
    drift = abs(found.slope) * seconds
    if drift > settings.largest_drift * span:
        yield (
            DOUBTFUL,
            f'the baseline drifts by {60 * found.slope:.2g} {session.last.unit} a minute',
        )
    held_out = _held_out_errors(session, pulses)
    if held_out is not None:
        error_before, error_after = held_out
        most = max(settings.held_out_times * error_after, settings.largest_held_out * span)
        if error_before > most:
            yield (
                DOUBTFUL,
                (
                    'the end of the session, held out, is missed by '
                    f'{100 * error_before / span:.2g} % of the range of the force, '
                    f'fitted it is {100 * error_after / span:.2g} %'
                ),
            )


def _held_out_errors(session: IdentifiedSession, pulses: PulseTrain) -> tuple[float, float] | None:
    """Return the error on the end of the session with an earlier estimate, and with the last [N].

    None if there is no earlier estimate.
    """
    stamps = session.stamp_ns
    duration = int(stamps[-1] - stamps[0])
    grid = nanoseconds(period_of_estimates(duration / NANOSECONDS_PER_SECOND))
    boundary = (int(stamps[0]) + round(_LEARNT_SHARE * duration)) // grid * grid
    before = [one for one in session.estimates[:-1] if one.stamp_ns < boundary]
    end = session.usable & (stamps >= boundary)
    if not before or not before[-1].samples or np.count_nonzero(end) < 3:
        return None
    if np.any(np.diff(stamps[end]) <= 0):
        return None
    errors = [
        simulated_fit(one, pulses, stamps[end], session.force[end]).error
        for one in (before[-1], session.last)
    ]
    return errors[0], errors[1]
