# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables of a laboratory as pulses and forces: one row a sample, a column with the gate.

The gate is the stimulator's trigger as the data acquisition sampled it.  A pulse begins where it
rises through the upper threshold and ends where it falls through the lower one: noise between the
two does not count.  A gate that rests at its high level is read the other way round.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rpms_ros.errors import RecordingError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain

BoolArray = npt.NDArray[np.bool_]

# 5 % of the threshold's distance to the rest, either way: far above the noise of a converter.
HYSTERESIS = 0.05
RISING, FALLING = 'rising', 'falling'
# Pulses last a few milliseconds: a gate that is high for longer than this share rests there.
_RESTS_HIGH = 0.9


@dataclass(frozen=True)
class GateSettings:
    """How a sampled gate becomes pulses.

    Attributes
    ----------
    threshold : float or None
        Level of the gate between rest and pulse, in its own unit; None for half of its range.
    intensity : float
        Share of the stimulator's maximum that every pulse gets, 0..1: a gate does not tell it.
    edge : str or None
        ``rising`` or ``falling``, with which a pulse begins; None for falling if the gate is high
        more than 90 % of the time, else rising.
    """

    threshold: float | None = None
    intensity: float = 1.0
    edge: str | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.intensity <= 1:
            raise RecordingError(f'expected an intensity from 0 to 1, got {self.intensity}')
        if self.threshold is not None and not np.isfinite(self.threshold):
            raise RecordingError(f'expected a finite threshold, got {self.threshold}')
        if self.edge not in (None, RISING, FALLING):
            raise RecordingError(f'expected an edge rising or falling, got {self.edge!r}')


def read_csv(
    path: Path | str,
    time: str,
    force: str,
    pulse: str,
    settings: GateSettings | None = None,
) -> tuple[PulseTrain, ForceTrace]:
    """Return pulses and forces of a table.

    Parameters
    ----------
    path : Path or str
        Table of text; separators, decimal sign, encoding and header are told from it.
    time, force, pulse : str
        Names of the columns: time [s], force [N] and gate [any unit].
    settings : GateSettings, optional
        How the gate is read.

    Returns
    -------
    pulses : PulseTrain
        Onsets at the first sample above the threshold, widths as sampled.
    forces : ForceTrace
        One sample a row.

    Raises
    ------
    RecordingError
        If the file or a column is missing, a cell of the time or gate is no finite number, or
        the time does not rise.
    """
    columns = _columns(Path(path), [time, force, pulse])
    seconds, gate = columns[time], columns[pulse]
    for name, values in ((time, seconds), (pulse, gate)):
        if not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values))[0])
            raise RecordingError(
                f'expected finite numbers in column {name!r} of {path}, '
                f'got {values[row]} in row {row + 1}'
            )
    if (late := np.flatnonzero(seconds[1:] <= seconds[:-1])).size:
        raise RecordingError(
            f'expected rising times in column {time!r} of {path}, '
            f'got {seconds[late[0]]} and then {seconds[late[0] + 1]}'
        )
    stamp_ns = np.rint(seconds * NANOSECONDS_PER_SECOND).astype(np.int64)
    pulses = gate_pulses(stamp_ns, gate, settings or GateSettings())
    return pulses, ForceTrace(stamp_ns, columns[force])


def gate_pulses(stamp_ns: IntArray, gate: FloatArray, settings: GateSettings) -> PulseTrain:
    """Return the pulses of a sampled gate.

    Parameters
    ----------
    stamp_ns : ndarray of int64, shape (samples,)
        Ascending times [ns].
    gate : ndarray, shape (samples,)
        Level of the gate.
    settings : GateSettings
        Threshold, intensity and edge.

    Raises
    ------
    RecordingError
        If the gate never rises through the threshold, or falls if it rests high.
    """
    low, top = float(gate.min()), float(gate.max())
    threshold = _threshold(gate, settings)
    band = HYSTERESIS * (top - low)
    above, below = gate > threshold + band, gate < threshold - band
    falling = edge_and_high(gate, settings)[0] == FALLING
    rises, falls = _edges(below, above) if falling else _edges(above, below)
    if not len(rises):
        raise RecordingError(
            f'expected a gate that {"falls" if falling else "rises"} through {threshold:g}, '
            f'got levels {low:g} to {top:g}'
        )
    onset = stamp_ns[rises]
    # A gate that is still up at the end is as wide as it was seen.
    end = np.append(stamp_ns[falls], stamp_ns[-1])[: len(onset)]
    width = (end - onset) / NANOSECONDS_PER_SECOND
    intensity = np.full(len(onset), settings.intensity, dtype=np.float64)
    return PulseTrain(onset, intensity, np.arange(len(onset), dtype=np.int64), width)


def edge_and_high(gate: FloatArray, settings: GateSettings) -> tuple[str, float]:
    """Return the edge with which pulses of a gate begin, and the share of time it is high."""
    high = float(np.mean(gate > _threshold(gate, settings))) if len(gate) else 0.0
    return settings.edge or (FALLING if high > _RESTS_HIGH else RISING), high


def _threshold(gate: FloatArray, settings: GateSettings) -> float:
    if settings.threshold is not None:
        return settings.threshold
    return (float(gate.min()) + float(gate.max())) / 2


def _edges(high: BoolArray, low: BoolArray) -> tuple[IntArray, IntArray]:
    """Return the samples at which the gate rises, and those at which it falls after a rise.

    A gate that is up from the beginning has no onset: it is no pulse.
    """
    marks = np.flatnonzero(high | low)
    states = high[marks]
    changes = np.flatnonzero(states[1:] != states[:-1]) + 1
    rises = marks[changes[states[changes]]]
    falls = marks[changes[~states[changes]]]
    return rises, falls[falls > rises[0]] if len(rises) else falls


def _columns(path: Path, names: Sequence[str]) -> dict[str, FloatArray]:
    # what follows needs the gate of this module
    from rpms_ros.recording.importing.text import read_table

    table = {signal.name: signal.values for signal in read_table(path).signals}
    for name in names:
        if name not in table:
            columns = ', '.join(map(repr, table)) or 'no columns'
            raise RecordingError(f'expected column {name!r} in {path}, got {columns}')
    return {name: table[name] for name in names}
