# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One hash of everything in a session that an estimator is fed with."""

import hashlib

import numpy as np
import numpy.typing as npt

from rpms_ros.recording.reading import Recording

_NAME = b'rpms_ros session 1'


def session_hash(recording: Recording) -> str:
    """Return the SHA-256 of a session as hexadecimal digits.

    It covers stamps, intensities, numbers and widths of all pulses, stamps and forces of all
    samples, and the order in which they were received among each other.  It depends neither on
    the storage nor on names, frames and times of reception: a copy in another format has the
    same.  A result with this hash was made from these numbers.

    Parameters
    ----------
    recording : Recording
        The session, as it was read: along one axis, with one sign.
    """
    pulses, forces = recording.pulses, recording.forces
    columns: tuple[tuple[npt.NDArray[np.generic], str], ...] = (
        (pulses.onset_ns, '<i8'),
        (pulses.intensity, '<f8'),
        (pulses.sequence, '<i8'),
        (pulses.width, '<f8'),
        (forces.stamp_ns, '<i8'),
        (forces.force, '<f8'),
        (recording.samples_before_pulse, '<i8'),
    )
    digest = hashlib.sha256(_NAME)
    for column, kind in columns:
        digest.update(len(column).to_bytes(8, 'little'))
        digest.update(np.ascontiguousarray(column, kind).tobytes())
    return digest.hexdigest()
