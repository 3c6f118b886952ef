# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""A muscle of motor units that sum by calcium, which no linear dynamics describe.

Each of `UNITS` has a threshold of its own, such that the steady force follows the subject's
recruitment curve, and the dynamics of Ding, Wexler and Binder-Macleod, Muscle & Nerve 28 (2003),
with the pulses above its threshold,

.. math:: \dot C = \frac{1}{\tau_c} \sum_i R_i e^{-(t - t_i) / \tau_c} - \frac{C}{\tau_c}, \qquad
          \dot F = \frac{C}{K_m + C} - \frac{F}{\tau_1 + \tau_2 C / (K_m + C)}

with ``R_i = 1 + (R_0 - 1) e^{-(t_i - t_{i-1}) / \tau_c}``; the constants are those of a fast
muscle.  It serves to find out what an estimator makes of a muscle that is none of its model.
"""

import numba
import numpy as np
import numpy.typing as npt

from rpms_ros.errors import MuscleError
from rpms_ros.muscle.contraction import Contraction
from rpms_ros.muscle.subject import REFERENCE_RATE, Subject
from rpms_ros.muscle.time_varying import LivingSettings
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray, nanoseconds

UNITS = 200
_TAU_C, _TAU_1, _TAU_2, _HALF, _MORE = 11e-3, 30e-3, 60e-3, 0.3, 0.04
_LONGEST_STEP = 1e-3


@numba.njit(cache=True)
def _contract(
    stamp_ns: IntArray,
    onset_ns: IntArray,
    intensity: FloatArray,
    threshold: FloatArray,
    now_ns: int,
    state: FloatArray,
) -> FloatArray:
    """Return the sum of the units' forces (samples,) from `now_ns` on; advance `state` (4, units).

    Rows of the state: sum of the pulses' transients, C, F and the time of the last pulse [s].
    """
    force = np.empty(len(stamp_ns))
    pulse = 0
    for index in range(len(stamp_ns)):
        while now_ns < stamp_ns[index]:
            until_ns = min(stamp_ns[index], now_ns + int(1e9 * _LONGEST_STEP))
            if pulse < len(onset_ns) and onset_ns[pulse] <= until_ns:
                until_ns = max(onset_ns[pulse], now_ns)
            step, now_ns = 1e-9 * (until_ns - now_ns), until_ns
            decay = np.exp(-step / _TAU_C)
            for unit in range(len(threshold)):
                bound = state[1, unit] / (_HALF + state[1, unit])
                state[2, unit] += step * (bound - state[2, unit] / (_TAU_1 + _TAU_2 * bound))
                state[1, unit] += step * (state[0, unit] - state[1, unit]) / _TAU_C
                state[0, unit] *= decay
            while pulse < len(onset_ns) and onset_ns[pulse] <= now_ns:
                for unit in range(len(threshold)):
                    if intensity[pulse] >= threshold[unit]:
                        since = 1e-9 * now_ns - state[3, unit]
                        state[0, unit] += 1.0 + _MORE * np.exp(-since / _TAU_C)
                        state[3, unit] = 1e-9 * now_ns
                pulse += 1
        force[index] = state[2].sum()
    return force


def _at_rest(units: int) -> FloatArray:
    return np.array([[0.0], [0.0], [0.0], [-1e9]]) * np.ones(units)


class MotorUnits(Contraction):
    """Motor units of a subject: its recruitment curve, latency and force at 20 Hz.

    Nothing of it changes in a session.

    Raises
    ------
    MuscleError
        If the settings want a change, or the recruitment falls.
    """

    def __init__(
        self,
        subject: Subject,
        fixed_rate_hz: float | None = None,
        settings: LivingSettings | None = None,
    ) -> None:
        super().__init__(subject, fixed_rate_hz, settings)
        if settings not in (None, LivingSettings()):
            raise MuscleError('expected motor units that do not change, got a scenario of changes')
        intensity = np.linspace(0.0, 1.0, 1001)
        share = subject.recruitment(intensity) / float(subject.recruitment(1.0))
        if not (np.diff(share) >= 0.0).all():
            raise MuscleError('expected motor units with a recruitment that does not fall')
        self._threshold = np.interp((np.arange(UNITS) + 0.5) / UNITS, share, intensity)
        self._units = _at_rest(UNITS)
        onset_ns = int(NANOSECONDS_PER_SECOND / REFERENCE_RATE) * np.arange(1, 81)
        stamp_ns = 1_000_000 * np.arange(3000, 4000)
        force = _contract(stamp_ns, onset_ns, np.ones(80), np.zeros(1), 0, _at_rest(1))
        # of one unit [N]
        self._scale = subject.maximum_force / (UNITS * float(force.mean()))

    def force(self, stamp_ns: npt.ArrayLike) -> FloatArray:
        """Return the force [N] (samples,) at ascending times [ns] not before those read already.

        A pulse that is added too late acts at once.
        """
        stamps = np.atleast_1d(np.asarray(stamp_ns, dtype=np.int64))
        begin_ns = self._onset_ns + nanoseconds(self.subject.latency)
        if self._reference_ns is None:
            self._reference_ns = int(begin_ns.min(initial=stamps[0]))
        due = int(np.searchsorted(begin_ns, stamps[-1], side='right'))
        acting = begin_ns[:due], self._intensity[:due], self._threshold
        force = _contract(stamps, *acting, self._reference_ns, self._units)
        self._onset_ns, self._intensity = self._onset_ns[due:], self._intensity[due:]
        self._reference_ns = int(stamps[-1])
        return self._scale * force
