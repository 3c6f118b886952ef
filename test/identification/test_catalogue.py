# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimators by name, one from outside of the package; their settings and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import (
    TABLE_4,
    TABLE_5,
    BatchEstimator,
    FixedSizeRecursion,
    ModifiedRecursiveLM,
    RecruitmentBounds,
    settings_by_name,
)
from rpms_ros.identification.catalogue import EstimatorOptions, estimator_by_name, estimator_names
from rpms_ros.identification.session import identify
from rpms_ros.muscle.recruitment import RecruitmentParameters
from rpms_ros.pulses import ForceTrace, PulseTrain

MODULE = '''
import numpy as np

from rpms_ros.identification import CURVE_INTENSITY
from rpms_ros.identification import Estimate


class MeanForce:
    """Predicts the mean of the force so far; knows nothing of pulses."""

    name = 'mean_force'
    memory = 0.5
    on_line = True

    def __init__(self, options):
        self.options = options
        self.total, self.count = 0.0, 0

    def add_pulses(self, onset_ns, intensity):
        pass

    def forget_pulses(self):
        pass

    def update(self, stamp_ns, force, usable):
        prediction = np.empty(len(force))
        for index, value in enumerate(force):
            prediction[index] = self.total / max(self.count, 1)
            if usable[index]:
                self.total += value
                self.count += 1
        return prediction

    def estimate(self, stamp_ns, faults):
        empty = np.empty(0)
        return Estimate(
            stamp_ns=stamp_ns, estimator=self.name, nonlinear_names=(), nonlinear=empty,
            linear_names=('mean',), linear=np.array([self.total / max(self.count, 1)]),
            repetition_rate=self.options.rate_hz, curve_intensity=CURVE_INTENSITY,
            curve_force=empty, response_time=empty, response_force=empty, output_error=0.0,
            samples=self.count, pulses=0, faults=dict(faults),
        )


def nothing(options):
    return 7


not_callable = 7
'''


@pytest.fixture(name='install')
def install_fixture(tmp_path, monkeypatch):
    """Put a distribution with these entry points on the path."""

    def install(entry_points, name='acme_estimators'):
        folder = tmp_path / name
        metadata = folder / f'{name}-1.0.dist-info'
        metadata.mkdir(parents=True)
        (folder / f'{name}.py').write_text(MODULE)
        (metadata / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n')
        text = f'[rpms_ros.estimators]\n{entry_points}\n'
        (metadata / 'entry_points.txt').write_text(text)
        monkeypatch.syspath_prepend(folder)

    return install


def test_an_estimator_from_outside_of_the_package_runs_a_session(install):
    install('mean_force = acme_estimators:MeanForce')
    assert estimator_names() == ('recursive', 'batch', 'tracking', 'mean_force')
    estimator = estimator_by_name('mean_force', rate_hz=25.0)
    stamp = np.arange(2000, dtype=np.int64) * 1_000_000
    session = identify(
        estimator, PulseTrain.regular([0.5], 20.0), ForceTrace(stamp, stamp * 0.0 + 3.0)
    )
    assert session.last.estimator == 'mean_force'
    assert session.last.repetition_rate == 25.0
    assert session.last.linear[0] == 3.0
    assert len(session.prediction) == 2000


def test_other_names_are_refused():
    with pytest.raises(IdentificationError, match=r"expected an estimator of recursive.*'oracle'"):
        estimator_by_name('oracle')


def test_one_name_is_one_estimator(install):
    install('tracking = acme_estimators:MeanForce')
    message = r"expected one estimator of the name 'tracking', got acme_estimators:MeanForce and"
    with pytest.raises(IdentificationError, match=message):
        estimator_by_name('tracking')


@pytest.mark.parametrize(
    ('target', 'message'),
    [
        ('acme_estimators:nothing', "expected add_pulses, estimate, .* in the estimator 'broken'"),
        ('acme_estimators:not_callable', 'got TypeError'),
        ('acme_estimators:absent', 'got AttributeError'),
        ('not_installed:Estimator', 'got ModuleNotFoundError'),
    ],
)
def test_what_is_no_estimator_is_refused(install, target, message):
    install(f'broken = {target}')
    with pytest.raises(IdentificationError, match=message):
        estimator_by_name('broken')


@pytest.mark.parametrize(
    ('preset', 'start', 'latency'),
    [('paper_table_4', TABLE_4, 0.0), ('paper_table_5', TABLE_5, 8e-3)],
)
def test_tracking_with_a_preset_has_its_start_and_keeps_its_functions(preset, start, latency):
    settings = estimator_by_name('tracking', preset).settings
    assert (settings.start, settings.basis.latency) == (start.start, latency)
    assert (settings.choose_basis, settings.find_changes) == (False, True)
    assert estimator_by_name('tracking').settings.choose_basis


@pytest.mark.parametrize('rate', [0.0, 0.09, 1e6, float('nan'), '20'])
def test_a_rate_is_one_at_which_people_are_stimulated(rate):
    message = f'expected a repetition rate from 0.1 to 1000 Hz, got {rate!r}'
    with pytest.raises(IdentificationError, match=message):
        estimator_by_name('batch', rate_hz=rate)


@pytest.mark.parametrize('build', [BatchEstimator, FixedSizeRecursion, ModifiedRecursiveLM])
@pytest.mark.parametrize('rate', [0.0, -1.0, math.nan, math.inf])
def test_an_estimator_refuses_a_rate_of_nothing(build, rate):
    with pytest.raises(IdentificationError, match='expected a repetition rate above 0 Hz, got'):
        build(rate_hz=rate)


@pytest.mark.parametrize('seed', [-1, 1.5, '1', 2**53 + 1])
def test_a_seed_is_a_whole_number_from_0_on(seed):
    with pytest.raises(IdentificationError, match=f'expected a seed, .*, got {seed!r}'):
        EstimatorOptions(seed=seed)


def test_presets_by_name():
    assert settings_by_name('paper_table_4') is TABLE_4
    assert settings_by_name('paper_table_5') is TABLE_5
    with pytest.raises(IdentificationError, match=r"expected a preset of people, .* got 'x'"):
        settings_by_name('x')


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'forgetting': 0.0}, r'expected 0 < forgetting <= 1, got 0\.0'),
        ({'forgetting': 1.1}, r'expected 0 < forgetting <= 1, got 1\.1'),
        ({'gain_ratio_margin': 0.5}, r'expected 0 <= gain ratio margin < 0\.5, got 0\.5'),
        ({'damping_factor': 1.0}, r'expected a damping factor > 1, got 1\.0'),
        ({'condition_limit': 1.0}, r'expected a condition limit > 1, got 1\.0'),
        ({'damping': 0.0}, r'expected damping above 0, got 0\.0'),
        ({'force_scale': math.nan}, 'expected force_scale above 0, got nan'),
        ({'linear_covariance': math.inf}, 'expected linear_covariance above 0, got inf'),
        ({'start': RecruitmentParameters(0.9, 0.4, 3.0)}, 'expected a start within the bounds'),
        ({'start': RecruitmentParameters(math.nan, 0.4, 3.0)}, 'expected a start within'),
        (
            {'start': RecruitmentParameters(0.4, 0.9, 3.0, math.nan)},
            'expected alpha_thr above 0, got nan',
        ),
    ],
)
def test_impossible_settings_are_refused(values, message):
    with pytest.raises(IdentificationError, match=message):
        replace(TABLE_4, **values)


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'u_thr': (0.5, 0.5)}, r'expected bounds of u_thr in order, got 0\.5, 0\.5'),
        ({'u_sat': (math.nan, 1.0)}, 'expected bounds of u_sat in order, got nan'),
        ({'alpha_sat': (1.0, math.inf)}, 'expected bounds of alpha_sat in order'),
        ({'separation': 0.0}, r'expected a separation above 0, got 0\.0'),
        ({'u_sat': (0.1, 1.0)}, 'expected room for the separation'),
    ],
)
def test_impossible_bounds_are_refused(values, message):
    with pytest.raises(IdentificationError, match=message):
        RecruitmentBounds(**values)
