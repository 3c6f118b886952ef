# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the muscle analysis."""

import math
from dataclasses import dataclass

from rpms_ros.errors import IdentificationError


@dataclass(frozen=True)
class AnalysisSettings:
    """Spans and thresholds of the analysis.

    Attributes
    ----------
    orders : tuple of int
        Orders of the twitch that are compared (Eq. 2).
    rest : float
        Silence that separates one response from the next [s].
    before, after : float
        How much force before the first and after the last pulse belongs to a response [s].
    filter_span : float
        Length of the moving average before the derivative [s]: 9 samples at 1 kHz (Sec. 2.1).
    blanking : float
        Time after a pulse that is not fitted if the recording shows artifacts [s].
    artifact_search : float
        Largest distance of an artifact from the stamp of its pulse [s].
    least_response : float
        Smallest peak of a twitch that is analysed, in standard deviations of the noise.
    longest_latency : float
        A twitch with a longer latency is not a response to its pulse [s].
    least_fit : float
        Smallest fit of a twitch that is accepted, ``1 - |residual| / |force - mean|``, 0..1.
    settling : float
        Time after a change of the stimulation until the force counts as steady [s].
    left_over : float
        Share of a response that may be left when the next one begins.

    Raises
    ------
    IdentificationError
        If a value is not possible.
    """

    orders: tuple[int, ...] = (2, 3, 4)
    rest: float = 0.4
    before: float = 0.05
    after: float = 0.5
    filter_span: float = 9e-3
    blanking: float = 4e-3
    artifact_search: float = 20e-3
    least_response: float = 8.0
    longest_latency: float = 60e-3
    least_fit: float = 0.5
    settling: float = 0.5
    left_over: float = 0.05

    def __post_init__(self) -> None:
        if not self.orders or any(order < 2 for order in self.orders):
            raise IdentificationError(f'expected orders of at least 2, got {self.orders}')
        for name in ('rest', 'before', 'after', 'filter_span', 'longest_latency', 'settling'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise IdentificationError(f'expected a {name} above 0 s, got {value}')
        for name in ('blanking', 'artifact_search', 'least_response', 'least_fit', 'left_over'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise IdentificationError(f'expected a {name} of at least 0, got {value}')
