# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Schedules fitted to a device and a patient pass the forecast, whatever was asked for."""

import dataclasses
from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import example, given, settings, strategies as st

from rpms_ros.errors import StimulationError
from rpms_ros.stimulation import (
    Constant,
    Doublet,
    Pause,
    PulseBurst,
    Repeat,
    Schedule,
    Single,
    Staircase,
    UniformRandom,
)
from rpms_ros.stimulation.limits.device_specification import load_device_specification
from rpms_ros.stimulation.limits.fitting import fitted, forecast_within, scaled, strongest
from rpms_ros.stimulation.limits.limits import DoseLimits
from rpms_ros.stimulation.limits.patient import Patient, Rest, for_session

RAPID = load_device_specification('rapid2-240v')
# midnight may come between the import and a test
TODAY, DAY = datetime.now(UTC).date(), timedelta(1)
PATIENT = Patient(
    'P01', 'rapid2-240v', 0.3, 0.5,
    dose=DoseLimits(2000, 100_000.0, 24.0), rest=Rest(1000, 2.0), set_by='A', set_on=TODAY - DAY,
    expires=TODAY + DAY,
)  # fmt: skip
SHARE = st.floats(0.0, 1.0)
SEGMENTS = st.one_of(
    st.builds(Pause, duration_s=st.floats(0.1, 40.0)),
    st.builds(Single, intensity=SHARE, duration_s=st.floats(0.1, 3.0)),
    st.builds(Doublet, intensity=SHARE, interval_s=st.floats(0.005, 0.1)),
    st.builds(PulseBurst, intensity=SHARE, interval_s=st.floats(0.005, 0.1)),
    st.builds(
        Constant, rate_hz=st.floats(1.0, 60.0), duration_s=st.floats(0.5, 60.0), intensity=SHARE
    ),
    st.builds(
        UniformRandom,
        rate_hz=st.floats(1.0, 60.0),
        final_rate_hz=st.none() | st.floats(1.0, 60.0),
        duration_s=st.floats(0.5, 60.0),
        high=SHARE,
    ),
    st.builds(
        Staircase,
        rate_hz=st.floats(1.0, 60.0),
        duration_s=st.floats(0.5, 60.0),
        levels=st.lists(SHARE, min_size=1, max_size=4).map(tuple),
    ),
)


@settings(max_examples=40, deadline=None)
@example([Single(0.0625), Doublet(0.0, interval_s=1 / 64)], None)
@given(st.lists(SEGMENTS, min_size=1, max_size=5), st.sampled_from([None, PATIENT]))
def test_what_is_fitted_passes(segments, patient):
    schedule = Schedule(tuple(segments))
    specification = RAPID if patient is None else for_session(RAPID, patient)
    highest = max(strongest(segment) for segment in segments)
    if highest < 0.01 or (patient is not None and highest <= 2 * patient.motor_threshold):
        # silence, or below the threshold whatever is done
        try:
            found = fitted(schedule, RAPID, patient)
        except StimulationError:
            return
    found = fitted(schedule, RAPID, patient)
    dose = None if patient is None else patient.dose
    assert forecast_within(found.schedule, specification, dose).violations == ()
    assert found.schedule.name == schedule.name
    assert found.changes or [
        item for item in segments if not isinstance(item, Pause)
    ] == [item for item in found.schedule.segments if not isinstance(item, Pause)]  # fmt: skip


def test_every_change_is_said():
    schedule = Schedule(
        (
            Constant(35.0, 2.0, intensity=1.0),
            Repeat((Single(1.0, 0.5),), 3),
            Constant(15.0, 90.0, intensity=0.7),
        )
    )
    changes = ' / '.join(fitted(schedule, RAPID).changes)
    for text in ('every intensity times 0.7', '1 segment made slower', 'of pauses put in', 'ramp'):
        assert text in changes


def test_a_dose_ends_a_schedule():
    long = Schedule((Repeat((Constant(10.0, 60.0, intensity=0.5), Pause(2.0)), 10),))
    found = fitted(long, RAPID, PATIENT)
    assert found.schedule.pulse_count <= 2000
    assert any('left out' in change for change in found.changes)


def test_what_stays_below_the_threshold_is_refused():
    weak = dataclasses.replace(PATIENT, motor_threshold=0.5)
    with pytest.raises(StimulationError, match=r'above the motor threshold 0\.5 of patient P01'):
        fitted(Schedule((Single(1.0),)), RAPID, weak)
    with pytest.raises(StimulationError, match='can deliver something, got'):
        fitted(Schedule((Pause(1.0),)), RAPID)
    with pytest.raises(StimulationError, match='expected at most 1000 segments to fit, got 1001'):
        fitted(Schedule((Repeat((Single(0.1, 0.1),), 100_000),)), RAPID)


def test_scaling_rounds_downwards():
    assert strongest(scaled(Single(1.0), 0.5555)) == 0.555
    assert scaled(Staircase(10.0, 1.0, levels=(0.3, 1.0)), 0.7).levels == (0.21, 0.7)
    assert strongest(Pause(1.0)) == 0.0
