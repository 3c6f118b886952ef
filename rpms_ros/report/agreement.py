# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Comparison of two runs of an estimator."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from rpms_ros.identification import Estimate


@dataclass(frozen=True)
class Agreement:
    """Estimates of a live run against those of the replay of its recording.

    Attributes
    ----------
    compared : int
        Estimates with a partner of the same stamp.
    missing : int
        Live estimates without one.
    differing : mapping of str to int
        Names of the fields that differ in any bit, and how often.
    """

    compared: int
    missing: int
    differing: Mapping[str, int]

    @property
    def exact(self) -> bool:
        """Whether there were estimates and all of them agree in every bit."""
        return self.compared > 0 and not self.missing and not self.differing


def compare(live: Sequence[Estimate], replayed: Sequence[Estimate]) -> Agreement:
    """Return whether each live estimate is the replayed one of its stamp, bit for bit."""
    partners = {estimate.stamp_ns: estimate for estimate in replayed}
    differing: dict[str, int] = {}
    missing = 0
    for estimate in live:
        partner = partners.get(estimate.stamp_ns)
        if partner is None:
            missing += 1
            continue
        for name in differences(estimate, partner):
            differing[name] = differing.get(name, 0) + 1
    return Agreement(len(live) - missing, missing, differing)


def differences(first: Estimate, second: Estimate) -> list[str]:
    """Return the names of the fields that differ in any bit."""
    return [
        field.name
        for field in fields(Estimate)
        if not _same(getattr(first, field.name), getattr(second, field.name))
    ]


def _same(first: Any, second: Any) -> bool:
    if isinstance(first, float | np.ndarray):
        left, right = np.asarray(first, np.float64), np.asarray(second, np.float64)
        return left.shape == right.shape and left.tobytes() == right.tobytes()
    return bool(first == second)
