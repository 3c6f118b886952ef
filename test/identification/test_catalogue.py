# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimators by name; estimators and monitors from outside of the package."""

import sys

import numpy as np
import pytest

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import TABLE_4, TABLE_5, ModifiedRecursiveLM, StreamSettings, identify
from rpms_ros.identification.catalogue import estimator_by_name, estimator_names
from rpms_ros.identification.stream.sensor_checks import monitors_by_name
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

    def install(entry_points, name='acme_estimators', kind='estimators', module=MODULE):
        folder = tmp_path / name
        metadata = folder / f'{name}-1.0.dist-info'
        metadata.mkdir(parents=True)
        (folder / f'{name}.py').write_text(module)
        (metadata / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n')
        text = f'[rpms_ros.{kind}]\n{entry_points}\n'
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


MONITORS = '''
"""Names force below zero, which no muscle on this rig gives."""

from rpms_ros.identification.stream.monitors import Monitor


class Push(Monitor):
    """Names `push`."""

    faults = {'push': 'force samples below -5 N; not learnt from'}
    doubtful = {'push': 0.1}
    seen = []

    def examine(self, window):
        cell = window.force[window.first : window.last]
        return {'push': cell < -5.0}

    def processed(self, samples):
        self.seen.append(len(samples.prediction))
        return {}

    def estimated(self, estimate):
        self.seen.append(estimate.stamp_ns)


class Careless(Monitor):
    """Fails."""

    def examine(self, window):
        raise RuntimeError('no')


def no_monitor():
    return 3
'''


@pytest.fixture
def package(install, monkeypatch):
    """An installed package with three monitors."""
    found = {'push': 'Push', 'careless': 'Careless', 'none': 'no_monitor'}
    points = '\n'.join(f'{name} = rig_monitors:{one}' for name, one in found.items())
    install(points, 'rig_monitors', 'monitors', MONITORS)
    monkeypatch.delitem(sys.modules, 'rig_monitors', raising=False)


@pytest.mark.usefixtures('package')
def test_a_monitor_of_another_package_examines_and_hears_everything(record):
    pulses, forces = record(np.random.default_rng(7).uniform(size=60))
    forces.force[2000:2400] = -6.0
    chosen = StreamSettings(monitors=('push',))
    session = identify(ModifiedRecursiveLM(), pulses, forces, chosen)
    # the pulse in between neither was nor is unknown: these samples alone are left out
    assert session.last.faults == {'push': 400, 'samples_excluded': 400}
    assert session.last.doubts[0] == 'push'
    assert not session.usable[2000:2400].any()
    import rig_monitors

    seen = rig_monitors.Push.seen
    assert sum(number for number in seen if number <= 100) == 3000
    assert seen[-1] == session.last.stamp_ns


@pytest.mark.usefixtures('package')
def test_a_monitor_that_fails_is_taken_out_and_named(record):
    pulses, forces = record(np.random.default_rng(7).uniform(size=20))
    chosen = StreamSettings(monitors=('careless', 'spikes'))
    session = identify(ModifiedRecursiveLM(), pulses, forces, chosen)
    assert session.last.faults == {'monitor_failed': 1}
    assert session.usable.all()


@pytest.mark.usefixtures('package')
def test_what_is_no_monitor_is_refused():
    with pytest.raises(IdentificationError, match=r'expected a Monitor behind .* none, got int'):
        monitors_by_name(['none'])
    with pytest.raises(IdentificationError, match=r'expected monitors of .*push.*, got .pish.'):
        monitors_by_name(['pish'])
