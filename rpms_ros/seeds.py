# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Seeds of random numbers."""

import numpy as np

from rpms_ros.errors import RpmsError

LARGEST_SEED = 2**53
"""Largest seed: JSON and YAML readers that use doubles hold it exactly."""


def check_seed(seed: object, error: type[RpmsError]) -> None:
    """Raise `error` unless `seed` is one: what NumPy says names neither it nor the range."""
    if not isinstance(seed, int | np.integer) or not 0 <= seed <= LARGEST_SEED:
        raise error(f'expected a seed, a whole number from 0 to 2^53, got {seed!r}')
