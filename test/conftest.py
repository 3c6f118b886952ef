# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What every test needs.  Real rclpy: a domain, a context and an executor for each test."""

import contextlib
import fcntl
import importlib
import importlib.util
import os
import re
import time
from pathlib import Path

import hypothesis
import pytest

# How long an example takes, and making it, is up to the machine and what else it does.
hypothesis.settings.register_profile(
    'untimed', deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile('untimed')
# Jazzy's messages check the types of their fields only if this is set before they are imported.
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
# Numba's threads and BLAS's would fight over the cores with other tests.
os.environ.setdefault('OMP_NUM_THREADS', '1')

# a process that has just made a segment locks it a moment later [s]
_OLD_S = 600.0


def _remove_dead_segments(folder):
    """Remove shared memory of Fast DDS whose process was killed, as processes of tests are.

    Nobody else does, and where it is kept from run to run it fills up in the end.
    """
    for lock in folder.glob('fastrtps_*_el'):
        segment = lock.with_name(lock.name.removesuffix('_el'))
        if not re.fullmatch('fastrtps_[0-9a-f]{16}', segment.name):
            continue
        # whoever uses it holds the lock
        with contextlib.suppress(OSError), lock.open() as held:
            if time.time() - lock.stat().st_mtime > _OLD_S:
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                segment.unlink(missing_ok=True)
                lock.unlink()


def pytest_sessionstart(session):
    """Do once, before the first test, what would happen amid whichever it is.

    Matplotlib looks for the fonts of a machine, and complains on stderr if that takes longer than
    five seconds.
    """
    if not hasattr(session.config, 'workerinput'):
        _remove_dead_segments(Path('/dev/shm'))
        importlib.import_module('matplotlib.font_manager')


def _module_at(path):
    specification = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def _beside(name):
    return _module_at(Path(__file__).with_name(f'{name}.py'))


@pytest.fixture(scope='session')
def module_at():
    """Load a script by its path."""
    return _module_at


@pytest.fixture(scope='session')
def beside():
    """Load a module of this folder by its name."""
    return _beside


@pytest.fixture(scope='session')
def hostile_texts():
    """The module of hostile texts beside this file: `KNOWN`, `hostile_text`, `sendable`."""
    return _beside('hostile_texts')


@pytest.fixture
def patient_file(tmp_path):
    """The patient of the documentation, whose figures hold today, and tomorrow too."""
    from datetime import UTC, datetime, timedelta

    from rpms_ros.stimulation.limits import patient

    today = datetime.now(UTC).date()
    text = str(patient.__doc__).partition('\n\n')[2]
    for key, day in (('set_on', today - timedelta(1)), ('expires', today + timedelta(1))):
        text = re.sub(f'(?m)^{key}:.*', f'{key}: {day}', text)
    path = tmp_path / 'patient.yaml'
    path.write_text(text)
    return path


@pytest.fixture
def specification_file(tmp_path):
    """The specification that comes with the package, of one device."""
    from rpms_ros.stimulation.limits import device_specification

    kind = Path(device_specification.__file__).parent / 'device_specifications/rapid2-240v.yaml'
    path = tmp_path / 'device.yaml'
    path.write_text(f'serial_number: "0815"\n{kind.read_text()}')
    return path


@pytest.fixture
def any_lateness(monkeypatch):
    """Let drivers be told to deliver a pulse that the machine holds up, however late it is.

    Users may allow a tenth of a second at most, and a machine under load stands still for longer.
    """
    from dataclasses import fields

    from rpms_ros.stimulation.driver.states import DriverSettings
    from rpms_ros.stimulation.schedule.fields import Bound

    (lateness,) = (one for one in fields(DriverSettings) if one.name == 'lateness_limit_s')
    monkeypatch.setattr(lateness, 'metadata', {'bound': Bound(0.0, 10.0, 's')})
    monkeypatch.setattr('rpms_ros.stimulation.devices.simulated.KEEP_ALIVE_LIMIT_NS', 10**10)


@pytest.fixture
def patient_supervision(any_lateness, monkeypatch):
    """Drivers of this process that a machine under load may hold up for seconds.

    That the limits themselves stop a device that hangs is tested in test/stimulation.
    """
    del any_lateness
    from dataclasses import replace

    from rpms_ros.nodes import stimulator_driver

    settings_of = stimulator_driver.driver_settings_of

    def patient(settings):
        return replace(
            settings_of(settings),
            executor_timeout_s=5.0,
            open_limit_s=10.0,
            response_limit_s=5.0,
            stuck_limit_s=5.0,
            supervisor_timeout_s=5.0,
            lateness_limit_s=5.0,
        )

    monkeypatch.setattr(stimulator_driver, 'driver_settings_of', patient)
    monkeypatch.setattr(stimulator_driver, 'patience_s', lambda *_: 5.0)


@pytest.fixture(scope='session')
def graphs():
    """The module of graphs beside this file: `Graph`, `private_context`."""
    return _beside('graphs')


@pytest.fixture
def domain(graphs):
    """A DDS domain that nobody else uses on this machine until all of the test has ended."""
    with graphs.private_domain() as private:
        yield private


@pytest.fixture
def context(graphs, domain):
    """A private context in a private domain."""
    with graphs.private_context(domain) as private:
        yield private


@pytest.fixture
def graph(graphs, context):
    """A persistent executor for the nodes of this test, in the private context."""
    with contextlib.closing(graphs.Graph(context)) as running:
        yield running


@pytest.fixture
def wait_for():
    """Wait until a predicate holds, without any executor: for processes and threads."""

    def wait(predicate, timeout=60.0):
        end = time.monotonic() + timeout
        pause = 1e-3
        while not predicate():
            if time.monotonic() > end:
                pytest.fail(f'still waiting after {timeout} s')
            time.sleep(pause)

    return wait


@pytest.fixture
def instrument():
    """Build instruments of the Rapid2 class on pseudo-terminals, see `fake_rapid2.py`."""
    module = _beside('fake_rapid2')
    with contextlib.ExitStack() as running:
        yield lambda **options: running.enter_context(module.FakeRapid2(**options))
