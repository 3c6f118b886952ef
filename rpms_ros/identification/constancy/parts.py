# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether one muscle explains a whole recording.

A fit over everything takes the muscle as constant.  Whether it was is seen part by part: for each
part of some seconds the response and the recruitment that would explain it best, next to the
recording's own, follow from sums that the fit has anyway.  Where the muscle was the same all the
time they gain no more than noise does; where it tired, where the coil moved or where the patient
tensed it, they gain percents of the force.
"""

import numpy as np

from rpms_ros.identification.projection.fit import Fit
from rpms_ros.identification.projection.problem import PARAMETERS
from rpms_ros.identification.projection.problem import Problem
from rpms_ros.identification.tracking.intervals import condensed
from rpms_ros.identification.tracking.intervals import no_change
from rpms_ros.pulses import FloatArray

_PART_NS = 5_000_000_000
_LEAST_SAMPLES = 200.0
# What a part's own muscle explains better, as a share of the force (root mean square).  A steady
# muscle with 0.5 % noise has 0.5 % at the most, a move of the coil 13 %.
_SHARE = 0.01
# The same as a multiple of the variance that noise alone would give, 11 in the mean.
_SIGNIFICANT = 100.0
_ROUNDING = 1e-9


def is_constant(problem: Problem, fit: Fit) -> bool:
    """Return whether no part of a recording asks for a muscle of its own.

    Parameters
    ----------
    problem, fit : Problem, Fit
        Blocks of the recording, and their fit.
    """
    return not any(
        share > _SHARE and gain > _SIGNIFICANT for share, gain in unexplained(problem, fit)
    )


def unexplained(problem: Problem, fit: Fit) -> FloatArray:
    """Return for each part what its own muscle would explain better.

    Parameters
    ----------
    problem, fit : Problem, Fit
        Blocks of the recording, and their fit.

    Returns
    -------
    ndarray (parts, 2)
        Root mean square as a share of that of the muscle's force; squared, as a multiple of the
        variance of what the part's own muscle leaves.  Empty if the clock has jumped back.
    """
    blocks = problem.blocks
    order = (int(blocks.head[0]) + np.arange(int(blocks.size[0]))) % len(blocks.start_ns)
    start_ns = blocks.start_ns[order]
    if not len(start_ns) or (np.diff(start_ns) < 0).any():
        return np.empty((0, 2))
    still = no_change(len(fit.linear))
    parts = condensed(problem, fit.theta, fit.linear, int(start_ns[0]), _PART_NS, still)
    found = [
        _gain(gram, right, energy, samples, fit.linear)
        for gram, right, energy, samples in zip(
            parts.gram, parts.right, parts.energy, parts.samples, strict=True
        )
        if samples > _LEAST_SAMPLES
    ]
    return np.array(found).reshape(-1, 2)


def _gain(
    gram: FloatArray, right: FloatArray, energy: float, samples: float, linear: FloatArray
) -> tuple[float, float]:
    """Return what the own muscle of a part explains better; see `unexplained`.

    A baseline of its own comes first: a sensor that drifts is no other muscle.
    """
    joint = PARAMETERS + len(linear)
    muscle = np.zeros(joint + 2)
    muscle[PARAMETERS:joint] = linear
    force = gram @ muscle
    power = float(muscle @ force)
    if not power > 0.0:
        return 0.0, 0.0
    rest = right - force
    squares = energy - float(muscle @ (right + rest))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), np.finfo(np.float64).tiny))
    matrix = gram * np.outer(scale, scale) + _ROUNDING * np.eye(joint + 2)
    rest = rest * scale
    level = float(rest[joint:] @ np.linalg.solve(matrix[joint:, joint:], rest[joint:]))
    both = float(rest @ np.linalg.solve(matrix, rest))
    gained = max(both - level, 0.0)
    left = max(squares - both, _ROUNDING * energy) / max(samples - joint - 2, 1.0)
    return float(np.sqrt(gained / power)), gained / left
