# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Reasons of refusals: one sentence for each limit, for single pulses and for a plan."""

from typing import NamedTuple

from rpms_ros.printable import counted, told_apart
from rpms_ros.stimulation.limits.limits import Limits


class Refusal(NamedTuple):
    """Why a pulse may not be fired.

    Attributes
    ----------
    limit : str
        Name of the limit, as in `Limits` or in a device specification.
    reason : str
        What was expected and what came, in plain words.
    """

    limit: str
    reason: str


TIMING_LIMITS = ('maximum_rate_hz', 'rate_limits_hz')
"""Limits that a pulse can break by the jitter of the one before it alone."""


def too_strong(limits: Limits, intensity: float) -> Refusal:
    """Return what a pulse above the highest intensity (share) is told."""
    return Refusal(
        'maximum_intensity',
        f'expected an intensity in [0, {limits.maximum_intensity:g}], got {intensity:g}',
    )


def wrong_width(limits: Limits, width_s: float) -> Refusal:
    """Return what a pulse that is too long or too short [s] is told."""
    which = 'minimum_width_s' if width_s < limits.minimum_width_s else 'maximum_width_s'
    return Refusal(
        which,
        f'expected a width in [{limits.minimum_width_s:g}, {limits.maximum_width_s:g}] s, '
        f'got {width_s:g} s',
    )


def too_steep(limits: Limits, before: float, intensity: float) -> Refusal:
    """Return what a pulse is told that differs too much from the one before (shares)."""
    return Refusal(
        'maximum_intensity_step',
        f'expected a step of at most {limits.maximum_intensity_step:g} from {before:g}, '
        f'got {intensity:g}',
    )


def too_new(limits: Limits, known: float, intensity: float) -> Refusal:
    """Return what a pulse is told that is far above what the subject knows (shares)."""
    return Refusal(
        'maximum_intensity_rise',
        f'expected at most {limits.maximum_intensity_rise:g} more than {known:g}, the '
        f'strongest of the {limits.rise_window_s:g} s before, got {intensity:g}',
    )


def too_soon(limits: Limits, rate_hz: float, strongest: float, gap_s: float) -> Refusal:
    """Return what a pulse is told that comes sooner than ``rate_hz`` allows."""
    which = 'maximum_rate_hz' if rate_hz == limits.maximum_rate_hz else 'rate_limits_hz'
    return Refusal(
        which,
        f'expected at most {rate_hz:g} Hz at intensity {strongest:.3g}, '
        f'got {gap_s:.4g} s after the pulse before',
    )


def too_many_in_a_train(limits: Limits) -> Refusal:
    """Return what the first pulse too many of a train is told."""
    return Refusal(
        'maximum_train_pulses',
        f'expected a pause of {limits.minimum_pause_s:g} s after at most '
        f'{limits.maximum_train_pulses} pulses, got one pulse more',
    )


def too_short_a_wait(wait_s: float, pulses: int, energy_j: float, gap_s: float) -> Refusal:
    """Return what a pulse is told that follows a train of so many pulses too soon."""
    wait, gap = told_apart(wait_s, gap_s)
    return Refusal(
        'wait',
        f'expected a wait of {wait} s after a train of {counted(pulses, "pulse")} '
        f'and {energy_j:.4g} J, got {gap} s',
    )


def too_much_power(limits: Limits, energy_j: float) -> Refusal:
    """Return what a pulse is told with which the window holds too much energy [J]."""
    return Refusal(
        'continuous_power_w',
        f'expected at most {limits.window_energy_j:.4g} J in {limits.energy_window_s:g} s '
        f'({limits.continuous_power_w:g} W), got {energy_j:.4g} J',
    )


def too_many(limits: Limits) -> Refusal:
    """Return what the first pulse too many of a session is told."""
    return Refusal(
        'session_pulses',
        f'expected at most {limits.session_pulses} pulses a session, got one more',
    )


def too_much_energy(limits: Limits, energy_j: float) -> Refusal:
    """Return what a pulse is told with which a session holds too much energy [J]."""
    return Refusal(
        'session_energy_j',
        f'expected at most {limits.session_energy_j:g} J a session, got {energy_j:.6g} J',
    )


def too_quiet(limits: Limits, silence_s: float) -> Refusal:
    """Return what a pulse, or the end, is told that comes after too long a silence [s]."""
    return Refusal(
        'idle_disarm_s',
        f'expected at most {limits.idle_disarm_s:g} s without a pulse, got {silence_s:.4g} s',
    )
