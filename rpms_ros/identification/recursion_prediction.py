# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Prediction of samples ahead by the recursion of the paper."""

import numba
import numpy as np

from rpms_ros.identification.basis import distorted_sines
from rpms_ros.muscle.identified_form import arctan_recruitment
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray


@numba.njit(cache=True)
def predict(
    stamp_ns: IntArray,
    onset_ns: IntArray,
    intensity: FloatArray,
    theta: FloatArray,
    weights: FloatArray,
    shape: FloatArray,
    expected: FloatArray,
) -> None:
    """Write ``phi^T w`` at ascending stamps (samples,) into `expected` (samples,).

    Parameters
    ----------
    stamp_ns, onset_ns, intensity : ndarray
        Samples, and the pulses of which some may still act, ascending.
    theta : ndarray (4,)
        Parameters.
    weights : ndarray (functions,)
        Linear parameters of the raw functions.
    shape : ndarray (3,)
        Tap [ns], memory [taps], form factor [taps].
    expected : ndarray (samples,)
        Overwritten by the prediction [N].
    """
    span_ns = shape[0] * (shape[1] + 0.5)
    offset = arctan_recruitment(0.0, theta)
    raw = np.empty(len(weights))
    first = 0
    for index in range(len(stamp_ns)):
        stamp = stamp_ns[index]
        while first < len(onset_ns) and stamp - onset_ns[first] > span_ns:
            first += 1
        total = 0.0
        place = first
        while place < len(onset_ns) and onset_ns[place] < stamp:
            tap = (stamp - onset_ns[place]) / shape[0]
            if distorted_sines(tap, shape[1], shape[2], raw):
                response = 0.0
                for function in range(len(raw)):
                    response += weights[function] * raw[function]
                total += (arctan_recruitment(intensity[place], theta) - offset) * response
            place += 1
        expected[index] = total
