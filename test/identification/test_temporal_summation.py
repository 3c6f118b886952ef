# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses weighted by those before them: the force of the history law, pulse by pulse."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import estimator_by_name
from rpms_ros.identification.analysis.trains import fit_scaled, fit_train, pulse_twitches
from rpms_ros.identification.estimation.blocks import PulseDelayLine
from rpms_ros.identification.model.history_law import PulseHistory, TemporalSummation
from rpms_ros.muscle import twitch
from rpms_ros.pulses import PulseTrain

MILLISECOND = 1_000_000
FOLDER = Path(os.environ.get('RPMS_RECORDINGS', Path(__file__).parents[2] / '../shared/data'))
TRIALS = sorted((FOLDER / 'rat_gastrocnemius').glob('*.csv'))
# docs/analysis.md: learned on the trains of 4 and 7 pulses; T_a of equal pulses is 9 ms.
RAT = TemporalSummation(3.2, 1.26, 1.36, 0.156, 0.65 * 9e-3)


def test_a_steady_train_of_the_stated_rate_weighs_one():
    steady = PulseTrain.regular(np.ones(100), 20.0)
    for law in (TemporalSummation(), RAT):
        weights = PulseHistory(law, 20.0).weights(steady.onset_ns, steady.intensity)
        assert weights[-1] == pytest.approx(1.0, abs=1e-6)


def test_the_weighted_twitches_meet_the_law_at_every_peak():
    onset_ns = np.array([0, 10, 20, 45, 50, 130], dtype=np.int64) * MILLISECOND
    history = PulseHistory(RAT, 20.0)
    weights = history.weights(onset_ns, np.ones(6)) * history._unit
    onset = 1e-9 * onset_ns
    gains = [
        1.0 + RAT.facilitation * np.exp((onset[:q] - onset[q]) / RAT.facilitation_decay).sum()
        for q in range(6)
    ]
    for place in range(6):
        peak = onset[place] + 2 * RAT.time_constant
        shape = twitch(peak - onset[: place + 1], RAT.time_constant)
        expected = RAT.saturated(float(np.array(gains[: place + 1]) @ shape))
        # Nothing but rounding lies between them.
        assert weights[: place + 1] @ shape == pytest.approx(expected, rel=1e-12)


def test_weights_do_not_depend_on_how_pulses_are_cut():
    train = PulseTrain.regular(np.random.default_rng(1).uniform(size=60), 70.0)
    whole = PulseDelayLine(0.0, None, 20.0, RAT)
    whole.add(train.onset_ns, train.intensity)
    single = PulseDelayLine(0.0, None, 20.0, RAT)
    for place in range(60):
        single.add(train.onset_ns[place : place + 1], train.intensity[place : place + 1])
    assert whole.weight.tobytes() == single.weight.tobytes()


def test_a_pulse_of_no_intensity_does_nothing_to_the_next():
    onset_ns = np.array([0, 10, 20], dtype=np.int64) * MILLISECOND
    with_gap = PulseHistory(RAT, 20.0).weights(onset_ns, np.array([1.0, 0.0, 1.0]))
    without = PulseHistory(RAT, 20.0).weights(onset_ns[[0, 2]], np.ones(2))
    assert with_gap[2] == without[1]


def test_the_numbers_come_from_an_analysis_or_a_file(tmp_path):
    path = tmp_path / 'analysis.json'
    law = {
        'half_level': 3.2, 'cooperation': 1.26, 'facilitation': 1.36, 'facilitation_decay': 0.156,
        'series_lag': 0.011,
    }  # fmt: skip
    summation = {'order': 3, 'time_constant': 9e-3, 'law': law}
    path.write_text(json.dumps({'summation': summation}))
    assert TemporalSummation.of_file(path) == RAT
    path.write_text('{"facilitation": 0.5, "order": 2}')
    assert TemporalSummation.of_file(path) == TemporalSummation(facilitation=0.5, order=2)
    estimator = estimator_by_name('tracking', history=RAT)
    assert estimator.settings.history == RAT


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('[]', 'expected a JSON object'),
        ('{"summation": null}', 'expected an analysis with a history law'),
        ('{"summation": {"law": null}}', 'expected an analysis with a history law'),
        ('{"halflevel": 1}', "expected .*half_level.* of a history law, got 'halflevel'"),
        ('{"half_level": "3"}', "expected a number for half_level, got '3'"),
        ('{"half_level": -1}', 'expected a finite half_level above 0, got -1'),
        ('{"half_level": NaN}', 'expected a finite half_level above 0, got nan'),
        ('{"order": 2.5}', 'expected a whole order, got 2.5'),
        ('{"order": NaN}', 'expected a whole order, got nan'),
        ('{"order": 1e400}', r'expected order below 1e\+09, got inf'),
        (f'{{"order": {"9" * 400}}}', r'expected order below 1e\+09, got 9999'),
        ('{"order": 1}', 'expected a finite order of at least 2, got 1'),
        ('{"facilitation": -0.1}', 'expected a finite facilitation of at least 0'),
        ('{', 'expected a JSON file'),
    ],
)
def test_bad_numbers_are_refused(tmp_path, text, message):
    (tmp_path / 'law.json').write_text(text)
    with pytest.raises(IdentificationError, match=message):
        TemporalSummation.of_file(tmp_path / 'law.json')


def test_the_recursion_has_no_law():
    with pytest.raises(IdentificationError, match='batch or tracking, got recursive'):
        estimator_by_name('recursive', history=RAT)


@pytest.mark.skipif(not TRIALS, reason=f'no recordings in {FOLDER} (set RPMS_RECORDINGS)')
def test_long_trains_of_a_rat_are_explained_better(rat_train):
    equal, weighted = [], []
    for train in [rat_train(path, 4) for path in TRIALS[::3]]:
        if len(train.onset) < 7:
            continue
        onset_ns = np.rint(1e9 * train.onset).astype(np.int64)
        weights = PulseHistory(RAT, 20.0).weights(onset_ns, np.ones(len(onset_ns)))

        def shape(latency, constant, train=train, weights=weights):
            return pulse_twitches(train, 3, latency, constant) @ weights

        equal.append(fit_train(train, 3).fit)
        weighted.append(fit_scaled(train, shape).fit)
    # bench/temporal_summation.py prints all trains; trains of 4 pulses gain nothing.
    assert np.mean(weighted) > np.mean(equal) + 2.0
