# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's on-line estimator: modified recursive Levenberg-Marquardt, Sec. 3.2.2."""

from collections.abc import Mapping

import numpy as np

from rpms_ros.errors import IdentificationError, check_number
from rpms_ros.identification.estimation.estimate_builder import RESPONSE_STEP
from rpms_ros.identification.model.estimate import (
    CURVE_INTENSITY,
    DEFAULT_RATE,
    SMALLEST_INTENSITY_SPAN,
    Estimate,
)
from rpms_ros.identification.model.settings import TABLE_4, PaperSettings
from rpms_ros.identification.quality.doubts import FACTORISATION_FAILED, PlausibilityCheck
from rpms_ros.identification.recursion.paper_kernel import (
    NONLINEAR,
    SCALARS,
    Recursion,
    RecursionConstants,
    RecursionState,
    process,
    workspace,
)
from rpms_ros.muscle.recruitment import (
    PARAMETER_NAMES,
    RecruitmentParameters,
    identified_recruitment,
)
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray, nanoseconds


class ModifiedRecursiveLM:
    """Modified recursive Levenberg-Marquardt over the separable Hammerstein model.

    Parameters
    ----------
    settings : PaperSettings
        Basis and design parameters; `TABLE_4` by default.
    seed : int
        Seed of the random H[0].
    rate_hz : float
        Repetition rate for which the recruitment curve is stated [Hz].

    Raises
    ------
    IdentificationError
        If the rate is not above zero.
    """

    name = 'recursive'
    on_line = True

    def __init__(
        self, settings: PaperSettings = TABLE_4, seed: int = 0, rate_hz: float = DEFAULT_RATE
    ) -> None:
        check_number(IdentificationError, 'repetition rate', rate_hz, 0, above=True, unit='Hz')
        self.settings, self.rate_hz = settings, rate_hz
        self._constants = _constants(settings)
        self._state = _start(settings, seed)
        self._onset_ns, self._intensity = np.empty(0, dtype=np.int64), np.empty(0)
        self._plausibility = PlausibilityCheck()
        self._response_time = np.arange(0.0, settings.basis.duration, RESPONSE_STEP)
        self._response_basis = settings.basis.evaluate(self._response_time)

    @property
    def memory(self) -> float:
        """Longest time for which a pulse acts on the model's output [s]."""
        return self.settings.basis.duration

    def add_pulses(self, onset_ns: IntArray, intensity: FloatArray) -> None:
        """Add pulses (pulses,), ascending, none before one that was already added [ns, 1]."""
        self._plausibility.add_pulses(onset_ns, intensity)
        self._onset_ns = np.concatenate((self._onset_ns, onset_ns))
        self._intensity = np.concatenate((self._intensity, intensity))

    def forget_pulses(self) -> None:
        """Drop the pulses that still act: the clock has jumped, their lag is unknown."""
        self._onset_ns, self._intensity = np.empty(0, dtype=np.int64), np.empty(0)
        self._state.scalars[['error_energy', 'force_energy']] = 0.0

    def update(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        """Learn from samples (samples,), ascending; return their a-priori prediction [N].

        See `rpms_ros.identification.model.estimate.Estimator.update`.
        """
        if not len(stamp_ns):
            return np.empty(0)
        self._plausibility.add_forces(force, usable)
        prediction = self._process(stamp_ns, force, usable)
        oldest = int(stamp_ns[-1]) - nanoseconds(self.memory + 1e-3)
        if len(self._onset_ns) and self._onset_ns[0] < oldest:
            kept = int(np.searchsorted(self._onset_ns, oldest))
            self._onset_ns = self._onset_ns[kept:]
            self._intensity = self._intensity[kept:]
        return prediction

    def predict(self, stamp_ns: IntArray) -> FloatArray:
        """Return the prediction of the next samples (samples,) [N]."""
        nothing, unused = np.zeros(len(stamp_ns)), np.zeros(len(stamp_ns), dtype=np.bool_)
        return self._process(stamp_ns, nothing, unused)

    def estimate(self, stamp_ns: int, faults: Mapping[str, int]) -> Estimate:
        """Return the present estimate."""
        parameters = RecruitmentParameters(*self._state.theta.tolist())
        linear = self._state.linear.copy()
        scalars = self._state.scalars
        full = identified_recruitment(parameters, 1.0)
        energy = float(scalars['force_energy'][0])
        error = float(np.sqrt(scalars['error_energy'][0] / energy)) if energy > 0.0 else 0.0
        failures = int(scalars['failures'][0])
        if failures:
            faults = {**faults, FACTORISATION_FAILED: failures}
        estimate = Estimate(
            stamp_ns=stamp_ns,
            estimator=self.name,
            nonlinear_names=PARAMETER_NAMES,
            nonlinear=np.array(parameters),
            linear_names=tuple(f'basis_{index + 1}' for index in range(len(linear))),
            linear=linear,
            repetition_rate=self.rate_hz,
            curve_intensity=CURVE_INTENSITY,
            curve_force=self._curve(parameters, linear),
            response_time=self._response_time,
            response_force=self._response_basis @ linear * full,
            output_error=error,
            samples=int(scalars['samples'][0]),
            pulses=self._plausibility.pulses,
            damping=float(scalars['damping'][0]),
            condition_number=float(scalars['condition_number'][0]),
            faults=dict(faults),
        )
        return self._plausibility.examine(estimate)

    def _process(self, stamp_ns: IntArray, force: FloatArray, usable: BoolArray) -> FloatArray:
        work = workspace(self.settings.basis.functions, len(self._onset_ns))
        recursion = Recursion(self._constants, self._state, work)
        return process(stamp_ns, force, usable, self._onset_ns, self._intensity, recursion)

    def _curve(self, parameters: RecruitmentParameters, linear: FloatArray) -> FloatArray:
        """Return K rho(u) [N] (101,), empty if one intensity only has been seen."""
        low, high = self._plausibility.intensity_range
        if not high - low >= SMALLEST_INTENSITY_SPAN:
            return np.empty(0)
        gain = self.rate_hz * float(self.settings.basis.area @ linear)
        return gain * identified_recruitment(parameters, CURVE_INTENSITY)


def _constants(settings: PaperSettings) -> RecursionConstants:
    basis = settings.basis
    return RecursionConstants(
        shape=np.array(
            [basis.tap * NANOSECONDS_PER_SECOND, float(basis.memory_taps), basis.form_factor]
        ),
        mixing=np.ascontiguousarray(basis.mixing),
        **{name: getattr(settings, name) for name in RecursionConstants._fields[2:]},
    )


def _start(settings: PaperSettings, seed: int) -> RecursionState:
    functions = settings.basis.functions
    generator = np.random.default_rng(seed)
    hessian = generator.uniform(0.0, settings.hessian_scale, (NONLINEAR, NONLINEAR))
    scalars = np.zeros(1, dtype=SCALARS)
    scalars['damping'][0] = settings.damping
    return RecursionState(
        theta=np.array(settings.start, dtype=np.float64),
        linear=np.zeros(functions),
        covariance=settings.linear_covariance * np.eye(functions),
        projection=np.zeros((NONLINEAR, functions)),
        hessian=0.5 * (hessian + hessian.T),
        scalars=scalars,
    )
