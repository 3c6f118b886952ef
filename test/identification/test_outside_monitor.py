# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A monitor from another package: one module and one entry point."""

import sys

import numpy as np
import pytest

from rpms_ros.errors import IdentificationError
from rpms_ros.identification import ModifiedRecursiveLM, StreamSettings, identify
from rpms_ros.identification.stream.sensor_checks import monitors_by_name

MODULE = '''
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
def package(tmp_path, monkeypatch) -> None:
    """An installed package with three entry points."""
    (tmp_path / 'rig_monitors.py').write_text(MODULE)
    information = tmp_path / 'rig_monitors-1.0.dist-info'
    information.mkdir()
    (information / 'METADATA').write_text('Metadata-Version: 2.1\nName: rig-monitors\n')
    (information / 'entry_points.txt').write_text(
        '[rpms_ros.monitors]\n'
        'push = rig_monitors:Push\n'
        'careless = rig_monitors:Careless\n'
        'none = rig_monitors:no_monitor\n'
    )
    monkeypatch.syspath_prepend(str(tmp_path))
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
