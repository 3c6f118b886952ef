# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a sampled signal is a gate, and what is told of its pulses."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import PulseTrain
from rpms_ros.recording.csv_import import FALLING
from rpms_ros.recording.csv_import import GateSettings
from rpms_ros.recording.csv_import import edge_and_high
from rpms_ros.recording.importing.ambiguous import Ambiguous
from rpms_ros.recording.importing.signals import Signal

_TWO_LEVELS = 0.9
# Shares of the range on either side of its middle, and of the samples that may be on both.
_HALF_WAY = 0.1
_FEW = 0.025
# Stimulators give no pulses at 250 Hz; contacts bounce for a few milliseconds [s].
_BOUNCE = 4e-3


def has_two_levels(signal: Signal) -> bool:
    """Return whether nearly all values are at one of two levels, so that it looks like a gate."""
    values = signal.values[np.isfinite(signal.values)]
    if len(values) < 2 or np.ptp(values) == 0.0:
        return False
    share = (values - values.min()) / np.ptp(values)
    return bool(np.mean((share < 0.1) | (share > 0.9)) > _TWO_LEVELS)


def gate_told(path: Path, signal: Signal, gate: GateSettings, names: Sequence[str]) -> str:
    """Return how a gate is read, for people.

    Parameters
    ----------
    path : Path
        The file.
    signal : Signal
        The gate.
    gate : GateSettings
        What is stated of it.
    names : sequence of str
        Signals that may be the gate.

    Raises
    ------
    Ambiguous
        If many values are half-way between the lowest and the highest, where the threshold is
        that is not stated: noise there, or a rest between pulses to both sides, is no gate.
    """
    edge, high = edge_and_high(signal.values, gate)
    if gate.threshold is None and (half_way := _half_way(signal.values)):
        lowest, highest = float(signal.values.min()), float(signal.values.max())
        raise Ambiguous(
            f'expected a gate with two levels in {path}, got {signal.name!r}, '
            f'{100 * half_way:.0f} % of it half-way between {lowest:.3g} and {highest:.3g}: '
            '--threshold LEVEL or --pulse COL decides',
            '--pulse',
            names,
        )
    if gate.edge is not None:
        return f'{signal.name!r}, {edge} edges (--edge)'
    if edge == FALLING:
        why = f'as it is high {100 * high:.0f} % of the time (--edge decides)'
        return f'{signal.name!r}, falling edges, {why}'
    return repr(signal.name)


def _half_way(values: FloatArray) -> float:
    """Return the share of noise that is half-way between its ends; 0 if a side of that is empty.

    Hum may come close to the middle from below, or from above, but not from both.
    """
    if not (span := np.ptp(values)) > 0.0:
        return 0.0
    place = (values - values.min()) / span - 0.5
    above = float(np.mean((place > 0.0) & (place < _HALF_WAY)))
    below = float(np.mean((place <= 0.0) & (place > -_HALF_WAY)))
    return above + below if min(above, below) > _FEW else 0.0


def bounces(pulses: PulseTrain) -> str | None:
    """Return a warning if pulses follow others more closely than any stimulator gives them."""
    early = int(np.count_nonzero(np.diff(pulses.onset_ns) < 1e9 * _BOUNCE))
    if not early:
        return None
    return (
        f'{early} of {len(pulses)} pulses begin less than {1e3 * _BOUNCE:g} ms after the one '
        'before: does the trigger bounce? Each was taken for a pulse of its own'
    )
