# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Schedule and dose of a session, read off its pulses."""

from dataclasses import dataclass

import numpy as np

from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, PulseTrain
from rpms_ros.schema import internal

TRAIN_GAP = 1.0
"""A pause longer than this [s] ends a train."""


@dataclass(frozen=True)
class Dose:
    """Schedule and dose of a session.

    Attributes
    ----------
    pulses : int
        Pulses of valid intensity.
    trains : int
        Runs of pulses without a pause longer than `TRAIN_GAP`.
    stimulated_s : float
        Time within trains [s].
    rate_hz : dict of str to float, or None
        ``lowest``, ``median`` and ``highest`` rate within trains [Hz]; None without two pulses in
        a train.
    intensity : dict of str to float, or None
        ``lowest``, ``mean`` and ``highest`` share of the maximum; None without pulses.
    pulse_width_s : tuple of float
        Widths that occur, without those that are no number [s].
    full_intensity_pulses : float
        Sum of squared intensities: the energy in units of a pulse at full intensity.
    onset_s, intensities : ndarray (pulses,)
        Onsets after the start of the session, ascending [s], and shares of the maximum.
    """

    pulses: int
    trains: int
    stimulated_s: float
    rate_hz: dict[str, float] | None
    intensity: dict[str, float] | None
    pulse_width_s: tuple[float, ...]
    full_intensity_pulses: float
    onset_s: FloatArray = internal()
    intensities: FloatArray = internal()


def dose_of(pulses: PulseTrain, start_ns: int) -> Dose:
    """Return schedule and dose of the pulses of a session.

    Parameters
    ----------
    pulses : PulseTrain
        As recorded; those whose intensity is not within 0..1 are not counted.
    start_ns : int
        Start of the session [ns].
    """
    # a pulse that was recorded twice was given once
    both = np.column_stack((pulses.onset_ns, pulses.sequence))
    pulses = pulses[np.unique(both, axis=0, return_index=True)[1]]
    pulses = pulses[(pulses.intensity >= 0.0) & (pulses.intensity <= 1.0)]
    onset, intensity, width = pulses.onset_ns, pulses.intensity, pulses.width
    steps = np.diff(onset) / NANOSECONDS_PER_SECOND
    within = (steps <= TRAIN_GAP) & (steps > 0)
    return Dose(
        pulses=len(onset),
        trains=int(np.count_nonzero(steps > TRAIN_GAP)) + bool(len(onset)),
        stimulated_s=float(steps[within].sum()),
        rate_hz=_spread(1.0 / steps[within], 'median'),
        intensity=_spread(intensity, 'mean'),
        pulse_width_s=tuple(np.unique(width[np.isfinite(width)]).tolist()),
        full_intensity_pulses=float(np.sum(intensity**2)),
        onset_s=(onset - start_ns) / NANOSECONDS_PER_SECOND,
        intensities=intensity,
    )


def _spread(values: FloatArray, middle: str) -> dict[str, float] | None:
    if not len(values):
        return None
    low, high = float(values.min()), float(values.max())
    return {'lowest': low, middle: float(getattr(np, middle)(values)), 'highest': high}
