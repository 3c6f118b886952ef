# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Checks of pulses and force before identification: wrong unit, clock, topic or axis."""

from collections.abc import Iterator

import numpy as np

from rpms_ros.axis import QUANTITIES
from rpms_ros.identification.faults import PULSE_INTENSITY_INVALID
from rpms_ros.identification.plausibility import CLOCKS_DIFFER
from rpms_ros.identification.pulse_checks import no_overlap
from rpms_ros.identification.pulse_checks import outside_shares
from rpms_ros.identification.pulse_checks import range_outside
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain

# A twitch rises within 20 to 100 ms: fewer samples a second do not show it.
_LEAST_SAMPLING_HZ = 100.0
# No force sensor of the field is sampled faster.
_MOST_SAMPLING_HZ = 100_000.0
# Stimulators repeat at up to 100 Hz.
_MOST_PULSES_HZ = 200.0


def reasons(
    pulses: PulseTrain,
    forces: ForceTrace,
    expected_force: float,
    least_force: float,
    unit: str = 'N',
) -> Iterator[tuple[str, str]]:
    """Yield grade and sentence for everything that cannot be right.

    Parameters
    ----------
    pulses, forces : PulseTrain, ForceTrace
        The recording.
    expected_force : float
        Largest force that the muscle can have [N].
    least_force : float
        Least range of the force that a force sensor for people resolves [N]; no torque is
        compared with it.
    unit : str
        Unit of the force: ``N``, or ``N m`` for a torque.
    """
    force = forces.force[np.isfinite(forces.force)]
    with np.errstate(over='ignore'):
        span = float(np.ptp(force)) if len(force) else 0.0
    # an intensity of NaN was not recorded: dynamics can be found without it
    wrong = outside_shares(pulses.intensity) & ~np.isnan(pulses.intensity)
    if 2 * np.count_nonzero(wrong) > len(pulses):
        yield 'no', invalid_intensities(pulses)
        return
    if not np.any(pulses.intensity > 0.0) and not np.isnan(pulses.intensity).any():
        yield 'no', 'there is no pulse above intensity 0'
        return
    if (apart := no_overlap(pulses.onset_ns, forces.stamp_ns)) is not None:
        yield 'no', f'{CLOCKS_DIFFER}: {apart}'
        return
    if span == 0.0:
        yield (
            'no',
            (
                'the force never changes: another topic or axis, a dynamometer '
                '(--quantity torque), or a dead sensor'
            ),
        )
        return
    yield from _of_time(pulses, forces)
    if span > expected_force:
        yield (
            'doubtful',
            (
                f'the {QUANTITIES[unit]} spans {span:.4g} {unit}, more than the '
                f'{expected_force:g} {unit} that are expected: are these grams or millinewtons, '
                'or has this muscle a higher --expected-force?'
            ),
        )
    if unit == 'N' and span < least_force:
        yield (
            'doubtful',
            (
                f'the force spans {span:.2g} N, less than the {least_force:g} N that a sensor '
                'for people resolves: is the force in kN?'
            ),
        )


def invalid_intensities(pulses: PulseTrain) -> str:
    """Return how many pulses have an intensity that is no share of the maximum, and which."""
    count = np.count_nonzero(outside_shares(pulses.intensity))
    return (
        f'{PULSE_INTENSITY_INVALID}: the intensity of {count} of {len(pulses)} pulses is outside '
        f'0 to 1 ({range_outside(pulses.intensity)})'
    )


def _of_time(pulses: PulseTrain, forces: ForceTrace) -> Iterator[tuple[str, str]]:
    if rate := _rate(forces.stamp_ns):
        if rate < _LEAST_SAMPLING_HZ:
            yield (
                'no',
                (
                    f'the force has {rate:.3g} samples a second, a twitch needs '
                    f'{_LEAST_SAMPLING_HZ:g}: is the time in another unit, as ms?'
                ),
            )
        elif rate > _MOST_SAMPLING_HZ:
            yield 'no', f'the force has {rate:.3g} samples a second: is the time in another unit?'
    if (rate := _rate(pulses.onset_ns)) > _MOST_PULSES_HZ:
        yield 'doubtful', f'there are {rate:.3g} pulses a second: is the time in another unit?'


def _rate(stamp_ns: IntArray) -> float:
    """Return the rate of stamps (n,) [Hz]; 0 if there are fewer than two."""
    steps = np.diff(np.sort(stamp_ns))
    steps = steps[steps > 0]
    return NANOSECONDS_PER_SECOND / float(np.median(steps)) if len(steps) else 0.0
