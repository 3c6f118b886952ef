# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recruitment by intensity and by rate: Table 3, its limits, and the weight of one pulse."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from rpms_ros.errors import MuscleError
from rpms_ros.muscle import IntensityRecruitment, RateRecruitment, RecruitmentField

EVERY_INTENSITY = np.linspace(0.0, 1.0, 1001)

shapes = st.builds(
    IntensityRecruitment,
    threshold=st.floats(0.05, 0.7),
    saturation=st.floats(0.75, 1.2),
    threshold_slope=st.floats(1.0, 10.0),
    saturation_slope=st.floats(3.0, 50.0),
)


def test_table_3_begins_at_zero_and_ends_at_one() -> None:
    # The table is rounded to three digits.
    np.testing.assert_allclose(IntensityRecruitment()([0.0, 1.0]), [0.0, 1.0], atol=3e-4)


def test_table_3_by_rate() -> None:
    # Four digits, as the expected values are given.
    expected = [-0.0004, 0.7849, 0.9990, 1.3819]
    np.testing.assert_allclose(RateRecruitment()([0.0, 15.0, 20.0, 35.0]), expected, atol=5e-5)


def test_table_3_rises_with_the_intensity() -> None:
    assert IntensityRecruitment().rises
    assert (np.diff(IntensityRecruitment()(EVERY_INTENSITY)) > 0.0).all()


@settings(deadline=None)
@given(shapes)
def test_the_ends_tell_whether_a_curve_rises(shape: IntensityRecruitment) -> None:
    steps = np.diff(shape(EVERY_INTENSITY))
    if shape.rises:
        # Rounding of values of size 1 where the curve is flat.
        assert (steps >= -1e-14).all()
    # The slope has one change of sign at most, in its first or its last part.
    falls = np.flatnonzero(steps < -1e-14)
    if len(falls):
        assert not shape.rises
        assert 0 in falls or len(steps) - 1 in falls


def test_a_curve_may_dip_below_zero() -> None:
    dipping = IntensityRecruitment(0.662, 0.874, 6.0, 3.8).normalised()
    assert not dipping.rises
    assert dipping(0.1) < 0.0


def test_a_curve_may_fall_towards_full_intensity() -> None:
    falling = IntensityRecruitment(0.7, 0.8, 4.5, 17.0).normalised()
    assert not falling.rises
    assert falling(0.9) > 1.0


@settings(deadline=None)
@given(shapes)
def test_normalising_fixes_both_ends(shape: IntensityRecruitment) -> None:
    unit = shape.normalised()
    assert unit(0.0) == 0.0
    # One subtraction of numbers of which the larger is a few times their difference.
    assert unit(1.0) == pytest.approx(1.0, rel=1e-12)


@settings(deadline=None)
@given(shapes, st.floats(0.0, 1.0))
def test_normalising_keeps_the_shape(shape: IntensityRecruitment, intensity: float) -> None:
    low, value, high = shape([0.0, intensity, 1.0])
    # Subtractions, as above.
    assert shape.normalised()(intensity) == pytest.approx(
        (value - low) / (high - low), rel=1e-10, abs=1e-12
    )


@settings(deadline=None)
@given(shapes, st.floats(0.1, 3.0), st.floats(-1.0, 1.0))
def test_gain_and_offset_lie_outside_the_bends(
    shape: IntensityRecruitment, gain: float, offset: float
) -> None:
    plain = IntensityRecruitment(
        shape.threshold, shape.saturation, shape.threshold_slope, shape.saturation_slope, 1.0, 0.0
    )
    moved = IntensityRecruitment(
        shape.threshold,
        shape.saturation,
        shape.threshold_slope,
        shape.saturation_slope,
        gain,
        offset,
    )
    np.testing.assert_array_equal(moved(EVERY_INTENSITY), gain * plain(EVERY_INTENSITY) + offset)


@settings(deadline=None)
@given(st.floats(0.0, 500.0), st.floats(0.0, 500.0))
def test_more_rate_recruits_more(first: float, second: float) -> None:
    slower, faster = RateRecruitment()(sorted((first, second)))
    # Rounding of values up to 2 out of terms up to 30.
    assert faster >= slower - 1e-14


def test_rate_recruitment_levels_off() -> None:
    rate = RateRecruitment()
    # f - (f - f_sat) (1 - 1/(pi gamma (f - f_sat))) = f_sat + 1/(pi gamma), next term of order 1/f
    limit = rate.gain * (rate.saturation + 1.0 / (np.pi * rate.slope)) + rate.offset
    assert rate(1e7) == pytest.approx(limit, abs=1e-5)


def test_a_pulse_weighs_no_more_below_the_lowest_measured_rate() -> None:
    rates = np.array([0.0, 1e-9, 1.0, 14.999, 15.0])
    weights = RateRecruitment().per_pulse(rates)
    np.testing.assert_array_equal(weights, weights[-1])
    assert weights[-1] == RateRecruitment()(15.0) / 15.0


@settings(deadline=None)
@given(st.floats(15.0, 1000.0))
def test_above_it_a_pulse_weighs_its_share(rate_hz: float) -> None:
    rate = RateRecruitment()
    assert rate.per_pulse(rate_hz) == rate(rate_hz) / rate_hz
    assert rate.per_pulse(rate_hz) > 0.0


def test_field_is_the_product() -> None:
    field = RecruitmentField()
    intensity = np.array([0.2, 0.6, 1.0])[:, None]
    rates = np.array([15.0, 20.0, 35.0])
    expected = np.outer(IntensityRecruitment()(intensity[:, 0]), RateRecruitment()(rates))
    np.testing.assert_array_equal(field(intensity, rates), expected)


@settings(deadline=None)
@given(st.sampled_from([(), (1,), (3,), (2, 3), (0,)]))
def test_shapes_are_kept(shape: tuple[int, ...]) -> None:
    values = np.full(shape, 0.5)
    assert IntensityRecruitment()(values).shape == shape
    assert RateRecruitment()(values).shape == shape
    assert RateRecruitment().per_pulse(values).shape == shape


def test_threshold_lies_below_saturation() -> None:
    with pytest.raises(MuscleError, match=r'expected threshold < saturation, got 0\.9 and 0\.5'):
        IntensityRecruitment(threshold=0.9, saturation=0.5)


@pytest.mark.parametrize('slopes', [(0.0, 4.0), (5.0, -1.0)])
def test_bends_have_slopes_above_zero(slopes: tuple[float, float]) -> None:
    with pytest.raises(MuscleError, match='expected slopes above 0, got'):
        IntensityRecruitment(threshold_slope=slopes[0], saturation_slope=slopes[1])


@pytest.mark.parametrize('value', [float('nan'), float('inf')])
@pytest.mark.parametrize(
    'name',
    ['threshold', 'saturation', 'threshold_slope', 'saturation_slope', 'gain', 'offset'],
)
def test_parameters_by_intensity_are_finite(name: str, value: float) -> None:
    with pytest.raises(MuscleError, match='expected finite parameters of rho_u, got'):
        IntensityRecruitment(**{name: value})


@pytest.mark.parametrize('value', [float('nan'), float('inf')])
@pytest.mark.parametrize('name', ['saturation', 'slope', 'gain', 'offset', 'lowest_rate'])
def test_parameters_by_rate_are_finite(name: str, value: float) -> None:
    with pytest.raises(MuscleError, match='expected finite parameters of rho_f, got'):
        RateRecruitment(**{name: value})


def test_a_curve_that_ends_lower_than_it_begins_has_no_unit_gain() -> None:
    with pytest.raises(MuscleError, match=r'expected rho_u\(1\) > rho_u\(0\), got'):
        IntensityRecruitment(0.1, 0.2, 0.1, 50.0).normalised()


@pytest.mark.parametrize('rates', [(0.0, 35.0), (35.0, 15.0), (20.0, 20.0)])
def test_measured_rates_are_in_order(rates: tuple[float, float]) -> None:
    with pytest.raises(MuscleError, match='expected 0 < lowest_rate < highest_rate, got'):
        RateRecruitment(lowest_rate=rates[0], highest_rate=rates[1])


@pytest.mark.parametrize('name', ['slope', 'gain'])
def test_more_rate_never_means_less(name: str) -> None:
    with pytest.raises(MuscleError, match='expected slope and gain above 0, got'):
        RateRecruitment(**{name: -0.05})


def test_every_pulse_pulls() -> None:
    with pytest.raises(MuscleError, match=r'expected rho_f above 0 at 15\.0 Hz, got -0\.89'):
        RateRecruitment(offset=-2.0)
