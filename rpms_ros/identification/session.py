"""Identification of a whole recording with the estimator that also runs on line."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rpms_ros.errors import IdentificationError
from rpms_ros.identification.estimate import Estimate
from rpms_ros.identification.estimate import Estimator
from rpms_ros.identification.stream import IdentificationStream
from rpms_ros.identification.stream import StreamSettings
from rpms_ros.pulses import BoolArray
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import ForceTrace
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import PulseTrain

BLOCK = 10_000


@dataclass(frozen=True)
class IdentifiedSession:
    """What an estimator made of a recording.

    Attributes
    ----------
    estimates : list of Estimate
        One an estimate period, and a last one after the last sample.
    stamp_ns, force, prediction : ndarray (samples,)
        What was processed, and its a-priori prediction [ns], [N], [N].
    usable : ndarray of bool (samples,)
        Whether the sample was learnt from.
    """

    estimates: list[Estimate]
    stamp_ns: IntArray
    force: FloatArray
    prediction: FloatArray
    usable: BoolArray

    @property
    def last(self) -> Estimate:
        """The estimate after the last sample."""
        return self.estimates[-1]

    def relative_output_error(self, share: float = 0.2) -> float:
        """Return the a-priori error over the last `share` of the time, L2, relative to the force.

        Not a number if there is no force at all in it.
        """
        span = int(self.stamp_ns[-1] - self.stamp_ns[0])
        kept = (self.stamp_ns >= self.stamp_ns[-1] - round(share * span)) & self.usable
        energy = float(np.linalg.norm(self.force[kept]))
        if energy == 0.0:
            return float('nan')
        return float(np.linalg.norm(self.force[kept] - self.prediction[kept])) / energy


def identify(
    estimator: Estimator,
    pulses: PulseTrain,
    forces: ForceTrace,
    settings: StreamSettings | None = None,
    progress: Callable[[int], object] | None = None,
) -> IdentifiedSession:
    """Run an estimator over a recording, as it would have run on line.

    Parameters
    ----------
    estimator : Estimator
        Fresh estimator.
    pulses, forces : PulseTrain, ForceTrace
        The recording, in the order in which it was recorded.
    settings : StreamSettings or None
        Waiting times and cadence; those of the node give its estimates bit for bit.
    progress : callable or None
        Called with the number of samples that were taken since the last call.

    Returns
    -------
    IdentifiedSession
        Estimates and traces.

    Raises
    ------
    IdentificationError
        If there is no usable force sample.
    """
    blocks: list[tuple[IntArray, FloatArray, FloatArray, BoolArray]] = []
    stream = IdentificationStream(estimator, settings, lambda *block: blocks.append(block))
    stream.add_pulses(pulses)
    estimates: list[Estimate] = []
    for start in range(0, len(forces), BLOCK):
        part = slice(start, start + BLOCK)
        stream.add_forces(ForceTrace(forces.stamp_ns[part], forces.force[part]))
        estimates += stream.advance()
        if progress is not None:
            progress(min(BLOCK, len(forces) - start))
    estimates += stream.finish()
    if not blocks:
        raise IdentificationError(
            f'expected at least one finite force sample, got none among {len(forces)}'
        )
    stamp, force, prediction, usable = (
        np.concatenate(column) for column in zip(*blocks, strict=True)
    )
    return IdentifiedSession(estimates, stamp, force, prediction, usable)
