# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The fit of the end of the recording, from which the estimator did not learn."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rpms_ros.errors import ReportError
from rpms_ros.identification import Estimate
from rpms_ros.identification import Estimator
from rpms_ros.identification import IdentifiedSession
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.schema import internal

HELD_OUT_SHARE = 0.2


class FrozenFrom:
    """An estimator that learns nothing from samples at or after a stamp, but predicts them.

    Parameters
    ----------
    estimator : Estimator
        Fresh estimator.
    stamp_ns : int
        First stamp that is held out [ns].
    """

    def __init__(self, estimator: Estimator, stamp_ns: int) -> None:
        self._estimator = estimator
        self._stamp_ns = stamp_ns

    @property
    def name(self) -> str:
        """Name of the algorithm, as in `Estimate.estimator`."""
        return self._estimator.name

    @property
    def on_line(self) -> bool:
        """Whether the cost of an estimate does not grow with the length of the session."""
        return self._estimator.on_line

    @property
    def memory(self) -> float:
        """Longest time for which a pulse acts on the model's output [s]."""
        return self._estimator.memory

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending [ns, 1]."""
        self._estimator.add_pulses(onset_ns, intensity)

    def forget_pulses(self) -> None:
        """Drop the pulses that still act."""
        self._estimator.forget_pulses()

    def update(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        """Learn from the samples (samples,) before the held-out part; predict all [N]."""
        return self._estimator.update(stamp_ns, force, usable & (stamp_ns < self._stamp_ns))

    def estimate(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Return the present estimate."""
        return self._estimator.estimate(stamp_ns, faults)


@dataclass(frozen=True)
class HeldOutFit:
    """How well the end of a session is predicted from its beginning.

    Attributes
    ----------
    learnt_s, held_out_s : float
        Lengths of the two parts [s].
    samples : int
        Samples of the held-out part, without those that lost pulses affect.
    error_n, error_of_range : float
        Root mean square of the residual [N], and as a share of the range of the whole session's
        force.
    relative_error : float
        L2 norm of the residual over that of the force.
    explained_variance : float
        1 - var(residual) / var(force).
    fit_percent : float
        ``100 (1 - |residual| / |force - mean force|)`` [%].
    stamp_ns, force, prediction : ndarray (samples,)
        The held-out part [ns], [N], [N].
    """

    learnt_s: float
    held_out_s: float
    samples: int
    error_n: float
    error_of_range: float
    relative_error: float
    explained_variance: float
    fit_percent: float
    stamp_ns: IntArray = internal()
    force: FloatArray = internal()
    prediction: FloatArray = internal()


def boundary(stamp_ns: IntArray, share: float) -> int:
    """Return the first held-out stamp [ns] if the last `share` of the time is held out.

    Raises
    ------
    ReportError
        If the share does not lie between 0 and 1.
    """
    if not 0.0 < share < 1.0:
        raise ReportError(f'expected to hold out a share between 0 and 1, got {share}')
    first, last = int(stamp_ns.min()), int(stamp_ns.max())
    return last - round(share * (last - first))


def held_out_fit(session: IdentifiedSession, first_ns: int) -> HeldOutFit | None:
    """Return the fit from `first_ns` on of a session run with `FrozenFrom`.

    None if nothing is left there, or the force does not change.
    """
    kept = (session.stamp_ns >= first_ns) & session.usable
    force, prediction = session.force[kept], session.prediction[kept]
    # the variance of a change below 1e-154 N is zero, too
    if len(force) < 2 or force.var() == 0.0:
        return None
    residual = force - prediction
    error = float(np.sqrt(np.mean(residual**2)))
    spread = float(np.linalg.norm(force - force.mean()))
    return HeldOutFit(
        learnt_s=float(first_ns - session.stamp_ns[0]) * 1e-9,
        held_out_s=float(session.stamp_ns[-1] - first_ns) * 1e-9,
        samples=len(force),
        error_n=error,
        error_of_range=error / float(np.ptp(session.force[session.usable])),
        relative_error=float(np.linalg.norm(residual) / np.linalg.norm(force)),
        explained_variance=float(1.0 - residual.var() / force.var()),
        fit_percent=float(100.0 * (1.0 - np.linalg.norm(residual) / spread)),
        stamp_ns=session.stamp_ns[kept],
        force=force,
        prediction=prediction,
    )
