# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a recording was that of one muscle: the answer that every command goes by.

That the muscle changed is said by the fit of everything, part by part
(`rpms_ros.identification.constancy.parts`), and stands among the doubts of its estimate.  By how
much and when is seen in the force simulated with the estimate
(`rpms_ros.identification.constancy.force_change`), also that of an estimator from outside, which
says nothing of parts.
"""

from dataclasses import replace

from rpms_ros.identification.constancy.force_change import ForceChange
from rpms_ros.identification.constancy.force_change import force_change
from rpms_ros.identification.constancy.parts import is_constant
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.plausibility import NO_CONSTANT_MUSCLE
from rpms_ros.identification.plausibility import REASON
from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.problem import Problem
from rpms_ros.identification.session import IdentifiedSession
from rpms_ros.pulses import PulseTrain

FOLLOWER = 'tracking'
"""The estimator that follows a muscle that changes."""


def examined(estimate: Estimate, problem: Problem, fit: Fit) -> Estimate:
    """Return the estimate of a fit, with a doubt and its reason if the muscle changed.

    Parameters
    ----------
    estimate : Estimate
        Made of the fit.
    problem, fit : Problem, Fit
        Blocks of the recording, and their fit.
    """
    if not estimate.curve_known or is_constant(problem, fit):
        return estimate
    return replace(
        estimate,
        doubts=(*estimate.doubts, NO_CONSTANT_MUSCLE),
        reasons=(*estimate.reasons, REASON[NO_CONSTANT_MUSCLE]),
    )


def is_mixture(estimate: Estimate) -> bool:
    """Return whether an estimate of a whole recording is one of several muscles."""
    return NO_CONSTANT_MUSCLE in estimate.doubts


def change_over(session: IdentifiedSession, pulses: PulseTrain) -> ForceChange | None:
    """Return how the force caused by the pulses changed where one muscle explains a session.

    Parameters
    ----------
    session : IdentifiedSession
        The result.
    pulses : PulseTrain
        The recorded pulses.

    Returns
    -------
    ForceChange or None
        None if there is no significant change, or if the estimates follow changes.
    """
    last = session.last
    if len(session.estimates) > 1 or last.rate_names or not last.curve_known:
        return None
    part = session.in_order
    return force_change(last, pulses, session.stamp_ns[part], session.force[part])
