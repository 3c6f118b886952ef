# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from rpms_ros.errors import StimulationError
from rpms_ros.identification.analysis.responses import Kind, groups_of
from rpms_ros.stimulation import schedule_from_text, schedule_to_text
from rpms_ros.stimulation.schedule.protocols import (
    FIELD_LEVELS,
    FIELD_RATES_HZ,
    TRAIN_RATES_HZ,
    TWITCH_INTENSITIES,
    muscle,
    recruitment,
    trains,
    twitches,
)

REST = 0.4


def kinds(schedule):
    return [group.kind for group in groups_of(schedule.pulses())]


def test_twitches_come_at_every_intensity_equally_often_and_shuffled():
    schedule = twitches(repetitions=4)
    intensity = schedule.pulses().intensity
    values, counts = np.unique(intensity, return_counts=True)
    assert values.tolist() == sorted(TWITCH_INTENSITIES)
    assert set(counts) == {4}
    assert (np.diff(intensity) < 0).any()
    assert kinds(schedule) == [Kind.SINGLE] * 24


def test_the_order_of_twitches_is_that_of_the_seed():
    assert twitches(seed=3) == twitches(seed=3)
    assert twitches(seed=3) != twitches(seed=4)


def test_trains_have_their_rates():
    groups = groups_of(trains().pulses())
    rates = [round(group.levels[0].rate_hz) for group in groups if group.count > 4]
    assert rates == [round(rate) for rate in TRAIN_RATES_HZ]
    assert [group.kind for group in groups[:3]] == [Kind.SINGLE] * 3


def test_the_staircase_has_the_number_of_data_sets_of_the_paper():
    groups = groups_of(recruitment().pulses())
    assert [group.kind for group in groups] == [Kind.STAIRCASE] * len(FIELD_RATES_HZ)
    levels = [level for group in groups for level in group.levels]
    # 882 data sets of 7 subjects
    assert len(levels) == 126
    assert [level.intensity for level in levels[:21]] == list(FIELD_LEVELS)


@pytest.mark.parametrize('build', [twitches, trains, recruitment, muscle])
def test_protocols_survive_their_file(build):
    schedule = build()
    again = schedule_from_text(schedule_to_text(schedule))
    assert np.array_equal(again.pulses().onset_ns, schedule.pulses().onset_ns)
    assert np.array_equal(again.pulses().intensity, schedule.pulses().intensity)


def test_nothing_to_give_is_refused():
    with pytest.raises(StimulationError, match='intensities and repetitions, got 0 and 10'):
        twitches(intensities=())


def test_twitches_that_would_overlap_are_refused():
    with pytest.raises(StimulationError, match=r'an interval of at least 0\.5 s, got 0\.3'):
        twitches(interval_s=0.3)
