# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The modified recursive Levenberg-Marquardt algorithm in plain NumPy: to read, and to compare.

Same equations as `rpms_ros.identification.recursion.paper_kernel`, written as in the paper, with
NumPy's linear algebra, not compiled and not optimised.  It is compared in the benchmark and is the
reference of the kernel's test.
"""

import numpy as np

from rpms_ros.identification import PaperSettings
from rpms_ros.identification.model.recruitment import recruitment_curve
from rpms_ros.identification.model.settings import BOUNDS
from rpms_ros.muscle.recruitment import SMALLEST_SEPARATION
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray, IntArray

LARGEST_COVARIANCE = 1e10


class NumpyRecursion:
    """One sample at a time; attributes are named as in the compiled recursion."""

    def __init__(self, settings: PaperSettings, seed: int = 0) -> None:
        functions = settings.basis.functions
        start = np.random.default_rng(seed).uniform(0.0, settings.hessian_scale, (3, 3))
        self.settings = settings
        self.theta = np.array(settings.start)
        self.linear = np.zeros(functions)
        self.covariance = settings.linear_covariance * np.eye(functions)
        self.projection = np.zeros((3, functions))
        self.hessian = 0.5 * (start + start.T)
        self.damping = settings.damping
        self.condition_number = 0.0

    def update(
        self, stamp_ns: int, force: float, onset_ns: IntArray, intensity: FloatArray
    ) -> float:
        """Learn from a sample; return its a-priori prediction [N]."""
        lag = (stamp_ns - onset_ns) / NANOSECONDS_PER_SECOND
        basis = self.settings.basis.evaluate(lag)
        rho, slope = self._recruitment(self.theta, intensity)
        phi = rho @ basis
        prediction = float(phi @ self.linear)
        acting = (lag > 0.0) & (lag <= self.settings.basis.duration)
        if rho[acting].any():
            psi = slope[:, :3].T @ basis @ self.linear
            self._learn(force, force - prediction, phi, psi, basis, intensity)
        return prediction

    def _learn(
        self,
        force: float,
        error: float,
        phi: FloatArray,
        psi: FloatArray,
        basis: FloatArray,
        intensity: FloatArray,
    ) -> None:
        settings, scale = self.settings, self.settings.force_scale
        paused = np.diag(self.covariance).max() >= LARGEST_COVARIANCE
        forgetting = 1.0 if paused else settings.forgetting
        gain = self.covariance @ phi
        denominator = forgetting + phi @ gain
        innovation = psi - self.projection @ phi
        self.linear = self.linear + gain * error / denominator
        self.projection = self.projection + np.outer(innovation, gain) / denominator
        self.covariance = (self.covariance - np.outer(gain, gain) / denominator) / forgetting

        factor = forgetting / denominator if settings.projected else 1.0
        derivative = (innovation if settings.projected else psi) / scale
        residual = factor * error / scale
        outer = factor * np.outer(derivative, derivative)
        self.hessian = settings.forgetting * self.hessian + outer
        step = self._step(derivative * residual)
        candidate = self._bounded(self.theta[:3] + step)

        predicted = derivative @ step * residual - 0.5 * step @ self.hessian @ step
        before = (force - phi @ self.linear) / scale
        after = (force - self._recruitment(candidate, intensity)[0] @ basis @ self.linear) / scale
        self._judge(candidate, 0.5 * (before**2 - after**2), predicted)

    def _step(self, gradient: FloatArray) -> FloatArray:
        damped = self.hessian + self.damping * np.eye(3)
        singular = np.linalg.svd(damped, compute_uv=False)
        self.condition_number = float(singular[0] / singular[-1])
        if self.condition_number > self.settings.condition_limit:
            self.damping += self.settings.damping_increment
            damped = damped + self.settings.damping_increment * np.eye(3)
        if np.linalg.eigvalsh(damped)[0] <= 0.0:
            return np.zeros(3)
        return np.linalg.solve(damped, gradient)

    def _bounded(self, values: FloatArray) -> FloatArray:
        box = np.array(list(BOUNDS.values()))
        held = np.clip(values, box[:, 0], box[:, 1])
        held[1] = max(held[1], held[0] + SMALLEST_SEPARATION)
        return np.append(held, self.theta[3])

    def _judge(self, candidate: FloatArray, actual: float, predicted: float) -> None:
        ratio = actual / predicted if predicted > 0.0 else -1.0
        if ratio < self.settings.gain_ratio_margin:
            self.damping *= self.settings.damping_factor
        elif ratio > 1.0 - self.settings.gain_ratio_margin:
            self.damping /= self.settings.damping_factor
        if ratio >= 0.0:
            self.theta = candidate

    @staticmethod
    def _recruitment(theta: FloatArray, intensity: FloatArray) -> tuple[FloatArray, FloatArray]:
        rho, slopes = recruitment_curve(intensity, theta)
        slopes[:, 2:] /= theta[2:]
        return rho, slopes
