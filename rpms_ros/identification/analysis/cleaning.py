# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Preparation of a force: ascending samples that can be forces, rate, saturation, noise."""

from dataclasses import dataclass

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.stream_settings import LARGEST_FORCE
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray

# Noise never repeats its extreme value so often in a row; a sensor at the end of its range does.
SATURATED_RUN = 5
RATE_CHANGE = 0.1
RATE_BLOCK = 100


@dataclass(frozen=True)
class CleanTrace:
    """Force samples in order, with properties of the sensor.

    Attributes
    ----------
    stamp_ns : ndarray of int64, shape (samples,)
        Ascending times [ns].
    force : ndarray, shape (samples,)
        Finite forces [N].
    saturated : ndarray of bool, shape (samples,)
        Samples at an end of the range of the sensor.
    sample_period : float
        Median time between samples [s].
    noise : float
        Standard deviation of the white part of the noise [N].
    findings : tuple of str
        Irregularities, a sentence each; without a unit, since a force may be a torque.
    """

    stamp_ns: IntArray
    force: FloatArray
    saturated: BoolArray
    sample_period: float
    noise: float
    findings: tuple[str, ...]

    def between(self, first_ns: int, last_ns: int) -> slice:
        """Return the samples from `first_ns` up to, not including, `last_ns`."""
        first, last = np.searchsorted(self.stamp_ns, [first_ns, last_ns])
        return slice(int(first), int(last))


def clean(trace: ForceTrace) -> CleanTrace:
    """Return the trace in order, without samples that are not finite or beyond `LARGEST_FORCE`.

    Parameters
    ----------
    trace : ForceTrace
        Samples in any order.

    Raises
    ------
    IdentificationError
        If fewer than 100 samples are left: nothing can be analysed then.
    """
    findings = []
    finite = np.isfinite(trace.force)
    if not finite.all():
        count = int((~finite).sum())
        findings.append(f'{count} force samples are NaN or infinite; they are not used')
    believed = finite & (np.abs(trace.force) <= LARGEST_FORCE)
    used = int(believed.sum())
    if used < finite.sum():
        findings.append(
            f'{int(finite.sum()) - used} force samples are beyond {LARGEST_FORCE:g}; they are '
            'not used'
        )
    stamps, first = np.unique(trace.stamp_ns[believed], return_index=True)
    force = trace.force[believed][first]
    if len(stamps) < used:
        findings.append(
            f'{used - len(stamps)} force samples have the stamp of another; '
            'the first of each is kept'
        )
    if len(stamps) < RATE_BLOCK:
        raise IdentificationError(f'expected at least {RATE_BLOCK} samples, got {len(stamps)}')
    saturated = _saturated(force)
    if saturated.any():
        findings.append(
            f'the sensor is saturated in {int(saturated.sum())} samples '
            f'(at {_end_values(force, saturated)}); responses with such samples are not used'
        )
    period = float(np.median(np.diff(stamps))) / NANOSECONDS_PER_SECOND
    findings += _rate_findings(stamps)
    return CleanTrace(stamps, force, saturated, period, _noise(force), tuple(findings))


def _noise(force: FloatArray) -> float:
    """Return the white noise [N], from the median of third differences: robust against artifacts.

    The third difference of white noise has 20 times its variance; the median of the absolute
    value of a normal variable is 0.6745 standard deviations.
    """
    return float(np.median(np.abs(np.diff(force, 3))) / 0.6745 / np.sqrt(20.0))


def _saturated(force: FloatArray) -> BoolArray:
    """Return the samples (samples,) in runs of the greatest or the least value."""
    result = np.zeros(len(force), dtype=np.bool_)
    if force.max() == force.min():
        return result
    for end in (force.max(), force.min()):
        at_end = force == end
        edges = np.flatnonzero(np.diff(np.concatenate(([0], at_end.astype(np.int8), [0]))))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            result[first:last] |= last - first >= SATURATED_RUN
    return result


def _end_values(force: FloatArray, saturated: BoolArray) -> str:
    return ' and '.join(f'{value:.4g}' for value in np.unique(force[saturated]))


def _rate_findings(stamps: IntArray) -> list[str]:
    """Return a sentence for each change of the sample rate."""
    interval = np.diff(stamps) / NANOSECONDS_PER_SECOND
    whole = len(interval) // RATE_BLOCK * RATE_BLOCK
    local = np.median(interval[:whole].reshape(-1, RATE_BLOCK), axis=1)
    if not len(local):
        return []
    findings = []
    current = local[0]
    for block, value in enumerate(local):
        steady = block + 1 == len(local) or abs(local[block + 1] / value - 1.0) < RATE_CHANGE
        if abs(value / current - 1.0) > RATE_CHANGE and steady:
            moment = (stamps[block * RATE_BLOCK] - stamps[0]) / NANOSECONDS_PER_SECOND
            findings.append(
                f'the sample rate changes from {1 / current:.0f} to {1 / value:.0f} Hz at '
                f'{moment:.1f} s; fits use the true time of every sample'
            )
            current = value
    return findings
