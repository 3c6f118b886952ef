# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Checks of an estimate: sign, shape, the force it explains, its doubts and intervals."""

from collections.abc import Iterator

import numpy as np

from rpms_ros.axis import QUANTITIES
from rpms_ros.identification.estimate import NOT_INFORMED
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.faults import FORCE_UNEXPLAINED
from rpms_ros.identification.faults import PULSE_INTENSITY_INVALID
from rpms_ros.identification.faults import SAMPLES_EXCLUDED
from rpms_ros.identification.plausibility import OF_TIME
from rpms_ros.identification.plausibility import stated_doubt
from rpms_ros.identification.session import IdentifiedSession
from rpms_ros.identification.simulated_fit import SimulatedFit
from rpms_ros.identification.verdict_of_data import invalid_intensities
from rpms_ros.identification.verdict_settings import DOUBTFUL
from rpms_ros.identification.verdict_settings import NO
from rpms_ros.identification.verdict_settings import Reason
from rpms_ros.identification.verdict_settings import VerdictSettings
from rpms_ros.printable import percent_explained
from rpms_ros.pulses import PulseTrain


def of_the_estimate(
    last: Estimate, found: SimulatedFit, span: float, settings: VerdictSettings
) -> Iterator[Reason]:
    """Yield what is wrong with an estimate, compared with the force.

    Parameters
    ----------
    last : Estimate
        The estimate that is judged.
    found : SimulatedFit
        Comparison of the force simulated with it and the measured one.
    span : float
        Range of the measured force, in the unit of the estimate.
    settings : VerdictSettings
        Thresholds.
    """
    if found.signal < 1.5 * found.noise:
        yield NO, 'the force holds noise only: the pulses leave no trace in it (topic, axis?)'
        return
    response = last.response_force
    extreme = float(response[int(np.argmax(np.abs(response)))]) if len(response) else 0.0
    full = float(last.curve_force[-1]) if last.curve_known else extreme
    if abs(extreme) < 1e-9 * found.signal:
        yield NO, 'no force comes out: the estimator has learnt nothing (topic, axis?)'
        return
    if full < 0.0 or extreme < 0.0:
        worst = full if full < 0.0 else extreme
        why = 'sign or axis of the sensor is wrong (--sign, --axis)'
        if found.explained < settings.least_explained:
            why = 'the estimator has not converged'
        yield NO, f'the force comes out negative, {worst:.3g} {last.unit}: {why}'
        return
    yield from _of_the_explanation(found, span, settings, last.unit)
    swing = -float(response.min()) / extreme
    if swing > settings.deepest_swing:
        grade = NO if swing > settings.worst_swing else DOUBTFUL
        yield (
            grade,
            (
                f'the response to a pulse swings to {response.min():.3g} {last.unit}: a muscle '
                'only pulls'
            ),
        )
    if len(last.curve_lower) and not last.curve_lower[-1] > 0.0:
        yield NO, 'the force at full intensity cannot be told from nothing'


def _of_the_explanation(
    found: SimulatedFit, span: float, settings: VerdictSettings, unit: str
) -> Iterator[Reason]:
    """Yield a reason if the simulated force differs too much from the measured one."""
    missed = max(found.error**2 - found.noise**2, 0.0) ** 0.5
    if found.explained_straight < settings.least_explained:
        grade = NO
    elif found.explained < settings.good_explained or missed > settings.largest_error * span:
        grade = DOUBTFUL
    else:
        return
    share = percent_explained(max(found.explained, 0.0))
    text = (
        f'the identified muscle explains {share} % of the {QUANTITIES[unit]}, its '
        f'error is {missed:.2g} {unit}, {100 * missed / span:.2g} % of the range'
    )
    if 0.0 < found.gain < 0.8 or found.gain > 1.25:
        text += f'; its force would fit best {found.gain:.2g} times as large'
    yield grade, text


def of_the_estimator(
    session: IdentifiedSession, pulses: PulseTrain, settings: VerdictSettings, explained: bool
) -> Iterator[Reason]:
    """Yield reasons from doubts, parameters and intervals of the estimate.

    Parameters
    ----------
    session : IdentifiedSession
        What was identified.
    pulses : PulseTrain
        The recorded pulses.
    settings : VerdictSettings
        Thresholds.
    explained : bool
        Whether the estimate, as it stands, explains the force of the last seconds.
    """
    last, first = session.last, session.estimates[0]
    for name in (one for one in last.doubts if one not in OF_TIME):
        # One that follows changes and efforts names them; what counts is the muscle of the end.
        if name == FORCE_UNEXPLAINED and last.rate_names and explained:
            continue
        if name == SAMPLES_EXCLUDED and last.faults.get(PULSE_INTENSITY_INVALID):
            # its cause says what to correct
            cause = invalid_intensities(pulses)
            yield DOUBTFUL, f'{cause}; where these act nothing is learnt ({SAMPLES_EXCLUDED})'
            continue
        yield DOUBTFUL, stated_doubt(last, name)
    if not last.curve_known:
        return
    if first is not last and first.samples and np.array_equal(first.nonlinear, last.nonlinear):
        yield NO, 'the parameters of the recruitment curve are still those of the start'
    flags = dict(zip(last.nonlinear_names, last.nonlinear_identifiability.tolist(), strict=False))
    unknown = [name for name, flag in flags.items() if flag == NOT_INFORMED]
    if flags and len(unknown) == len(flags):
        yield NO, 'the data tell nothing about the recruitment curve: no parameter is informed'
    elif 'u_thr' in unknown:
        why = '; '.join(last.reasons)
        yield DOUBTFUL, 'the data do not determine the threshold' + (f': {why}' if why else '')
    if len(last.curve_upper):
        applied = pulses.intensity[np.isfinite(pulses.intensity)]
        top = float(np.clip(applied.max(initial=0.0), 0.0, 1.0))
        lower, force, upper = (
            float(np.interp(top, last.curve_intensity, values))
            for values in (last.curve_lower, last.curve_force, last.curve_upper)
        )
        if 0.5 * (upper - lower) > settings.widest_interval * abs(force):
            yield (
                DOUBTFUL,
                (
                    f'the force at intensity {top:.2g} is known only as {lower:.3g} to '
                    f'{upper:.3g} {last.unit}'
                ),
            )
