# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the recursion of `rpms_ros.identification.recursion_kernel` remembers and works with."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

# u_thr, u_sat and alpha_sat are identified; alpha_thr is the fourth parameter, fixed.
NONLINEAR = 3
RecordArray = npt.NDArray[np.void]


# delta; condition number of R before delta_s was added; sums of squares of the a-priori error and
# of the force, decaying [N^2]; number of samples that were learnt from, and of those whose R could
# not be factorised; stamp of the newest usable sample [ns].
SCALARS = np.dtype(
    [
        ('damping', np.float64),
        ('condition_number', np.float64),
        ('error_energy', np.float64),
        ('force_energy', np.float64),
        ('samples', np.int64),
        ('failures', np.int64),
        ('previous_ns', np.int64),
    ]
)


class RecursionState(NamedTuple):
    """State of the recursion, updated in place.

    Attributes
    ----------
    theta : ndarray (4,)
        u_thr, u_sat, alpha_sat, and the fixed alpha_thr.
    linear : ndarray (n,)
        w.
    covariance : ndarray (n, n)
        P.
    projection : ndarray (3, n)
        W^T, regression of the derivatives on the linear regressors.
    hessian : ndarray (3, 3)
        H.
    scalars : structured ndarray (1,)
        The fields of `SCALARS`, in one array because each argument of a compiled call takes time.
    """

    theta: FloatArray
    linear: FloatArray
    covariance: FloatArray
    projection: FloatArray
    hessian: FloatArray
    scalars: RecordArray


class SavedRecursion(NamedTuple):
    """A `RecursionState` as it is saved: each field of its scalars is one array."""

    theta: FloatArray
    linear: FloatArray
    covariance: FloatArray
    projection: FloatArray
    hessian: FloatArray
    damping: FloatArray
    condition_number: FloatArray
    error_energy: FloatArray
    force_energy: FloatArray
    samples: IntArray
    failures: IntArray
    previous_ns: IntArray


def saved_of(state: RecursionState) -> SavedRecursion:
    """Return a state in the form in which it is saved."""
    names = SCALARS.names or ()
    return SavedRecursion(*state[:-1], *(state.scalars[name] for name in names))


def state_of(saved: SavedRecursion) -> RecursionState:
    """Return a state that was saved."""
    scalars = np.zeros(1, dtype=SCALARS)
    for name in SCALARS.names or ():
        scalars[name] = getattr(saved, name)
    return RecursionState(*saved[:5], scalars=scalars)


class RecursionConstants(NamedTuple):
    """Constants: the basis and the design parameters of Tables 4 and 5."""

    shape: FloatArray
    mixing: FloatArray
    force_scale: float
    forgetting: float
    damping_factor: float
    gain_ratio_margin: float
    condition_limit: float
    damping_increment: float
    projected: bool
    lower: FloatArray
    upper: FloatArray
    separation: float


class Workspace(NamedTuple):
    """Arrays that every sample overwrites, allocated once."""

    basis: FloatArray
    raw: FloatArray
    raw_gradient: FloatArray
    regressor: FloatArray
    gain: FloatArray
    scratch: FloatArray
    derivative: FloatArray
    damped: FloatArray
    rotated: FloatArray
    step: FloatArray
    candidate: FloatArray


class Recursion(NamedTuple):
    """One recursion: its constants, its state and the arrays that it overwrites."""

    constants: RecursionConstants
    state: RecursionState
    work: Workspace


def workspace(functions: int, acting_pulses: int) -> Workspace:
    """Return arrays for a basis of `functions` functions and so many pulses acting at once."""
    return Workspace(
        basis=np.zeros((acting_pulses, functions)),
        raw=np.zeros(functions),
        raw_gradient=np.zeros((NONLINEAR, functions)),
        regressor=np.zeros(functions),
        gain=np.zeros(functions),
        scratch=np.zeros((2, 4)),
        derivative=np.zeros(NONLINEAR),
        damped=np.zeros((NONLINEAR, NONLINEAR)),
        rotated=np.zeros((NONLINEAR, NONLINEAR)),
        step=np.zeros(NONLINEAR),
        candidate=np.zeros(4),
    )
