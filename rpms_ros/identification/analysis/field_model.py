# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
r"""The recruitment field in the parameters of a fit (Eqs. 8 to 10).

.. math:: F(u, f) = A \, \frac{n(u) - n(0)}{n(1) - n(0)} \cdot \frac{m(f) + d}{m(20) + d}
   + A c

A is the steady force at full intensity and 20 Hz; n is the bend of Eq. (9) and m that of
Eq. (10), each without its gain and offset, which follow from A, c and d.  The parameters are not
redundant: seven of the shape, one force, one offset.
"""

import numpy as np

from rpms_ros.muscle import IntensityRecruitment
from rpms_ros.muscle import RateRecruitment
from rpms_ros.pulses import FloatArray

REFERENCE_RATE = 20.0
NAMES = (
    'threshold',
    'saturation',
    'threshold_slope',
    'saturation_slope',
    'rate_saturation',
    'rate_slope',
    'rate_offset',
    'zero_offset',
)
CENTRE = np.array([0.48, 0.98, np.log(5.0), np.log(4.0), 25.0, np.log(0.05), -0.321 / 0.0597, 0.0])
# Standard deviations of a prior: the spread among people (Table 6), or wider than data resolve.
SPREAD = np.array([0.15, 0.15, 0.5, 0.8, 8.0, 0.8, 5.0, 0.05])
LOWEST = np.array([0.0, 0.3, np.log(0.5), np.log(0.5), 5.0, np.log(0.003), -12.0, -0.3])
HIGHEST = np.array([1.0, 1.8, np.log(60.0), np.log(60.0), 60.0, np.log(1.0), 40.0, 0.3])


def intensity_factor(theta: FloatArray, intensity: FloatArray) -> FloatArray:
    """Return rho_u, 0 at no and 1 at full intensity, plus the offset; shape (...)."""
    threshold, saturation = theta[0], theta[1]
    low, high = np.exp(theta[2]), np.exp(theta[3])

    def bend(u: FloatArray) -> FloatArray:
        above, beyond = u - threshold, u - saturation
        value: FloatArray = above * np.arctan(low * above) - beyond * np.arctan(high * beyond)
        return value

    zero, full = bend(np.array([0.0, 1.0]))
    share: FloatArray = (bend(np.asarray(intensity)) - zero) / (full - zero) + theta[7]
    return share


def rate_factor(theta: FloatArray, rate_hz: FloatArray) -> FloatArray:
    """Return rho_f, 1 at 20 Hz; shape (...)."""
    rate = np.asarray(rate_hz, dtype=np.float64)
    slope = np.exp(theta[5])

    def bend(f: FloatArray) -> FloatArray:
        excess = f - theta[4]
        value: FloatArray = f - excess * (np.arctan(slope * excess) / np.pi + 0.5)
        return value

    factor: FloatArray = (bend(rate) + theta[6]) / (bend(np.array(REFERENCE_RATE)) + theta[6])
    return factor


def as_recruitment(theta: FloatArray) -> tuple[IntensityRecruitment, RateRecruitment]:
    """Return Eqs. (9) and (10) with these parameters (8,), gains and offsets included."""
    plain = IntensityRecruitment(
        float(theta[0]), float(theta[1]), float(np.exp(theta[2])), float(np.exp(theta[3]))
    ).normalised()
    by_intensity = IntensityRecruitment(
        plain.threshold,
        plain.saturation,
        plain.threshold_slope,
        plain.saturation_slope,
        plain.gain,
        plain.offset + float(theta[7]),
    )
    unit = RateRecruitment(float(theta[4]), float(np.exp(theta[5])), 1.0, 0.0)
    gain = 1.0 / (float(unit(REFERENCE_RATE)) + float(theta[6]))
    by_rate = RateRecruitment(
        float(theta[4]), float(np.exp(theta[5])), gain, gain * float(theta[6])
    )
    return by_intensity, by_rate
