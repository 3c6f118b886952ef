"""The two threads in real time: pulses when they are due, an end of a thread that is a stop."""

import pytest

from rpms_ros.stimulation import constant
from rpms_ros.stimulation.controller import StimulationController
from rpms_ros.stimulation.device_specification import load_device_specification
from rpms_ros.stimulation.devices import DeviceError
from rpms_ros.stimulation.devices import SimulatedDevice
from rpms_ros.stimulation.devices import SimulatedFaults
from rpms_ros.stimulation.safety_monitor import EXECUTOR
from rpms_ros.stimulation.settings import DriverSettings
from rpms_ros.stimulation.states import State
from rpms_ros.stimulation.threads import PulseThread
from rpms_ros.stimulation.threads import SupervisorThread


@pytest.fixture
def running():
    """A driver with its threads, armed; a machine under load may be slow."""
    settings = DriverSettings(
        heartbeat_timeout_s=0.0,
        executor_timeout_s=10.0,
        supervisor_timeout_s=10.0,
        lateness_limit_s=0.1,
        response_limit_s=1.0,
    )
    controller = StimulationController(
        SimulatedDevice(), load_device_specification('simulated'), settings
    )
    fired = []
    threads = [PulseThread(controller, fired.append), SupervisorThread(controller)]
    controller.configure()
    controller.supervise()
    controller.seen(EXECUTOR)
    for thread in threads:
        thread.start()
    controller.arm()
    yield controller, fired, threads
    for thread in threads:
        thread.close()
        assert not thread.is_alive()


def test_pulses_come_when_they_are_due_never_before(running, wait_for):
    controller, fired, _ = running
    run = controller.start(constant(0.5, 0.5, 50.0))
    wait_for(lambda: bool(run.ended))
    assert run.ended == 'completed'
    assert len(fired) == 25
    assert all(pulse.delivery.time_ns >= pulse.due_ns for pulse in fired)
    assert [pulse.sequence for pulse in fired] == list(range(25))


def test_hanging_device_is_silenced_by_the_supervisor(running, wait_for):
    controller, _, _ = running
    controller.device.faults = SimulatedFaults(stuck_s=60.0)
    controller.start(constant(0.5, 10.0, 50.0))
    wait_for(lambda: controller.state is State.FAULT)
    assert controller.fault_counts() == {'stuck': 1}
    assert not controller.device.armed
    assert not controller.device.fired


@pytest.mark.filterwarnings('ignore::pytest.PytestUnhandledThreadExceptionWarning')
def test_end_of_the_supervisor_is_a_fault(running, wait_for):
    controller, fired, threads = running
    controller.start(constant(0.5, 10.0, 50.0))
    wait_for(lambda: bool(fired))
    controller.device.keep_alive = None
    wait_for(lambda: controller.state is State.FAULT)
    assert controller.reason == 'supervisor_thread: expected to run on, got an exception'
    wait_for(lambda: not threads[1].is_alive())
    assert not controller.device.armed


@pytest.mark.filterwarnings('ignore::pytest.PytestUnhandledThreadExceptionWarning')
def test_end_of_the_pulse_thread_is_a_fault(running, wait_for):
    controller, fired, threads = running

    controller.device.fire = None
    controller.start(constant(0.5, 10.0, 50.0))
    wait_for(lambda: controller.state is State.FAULT)
    wait_for(lambda: not threads[0].is_alive())
    assert controller.reason == 'pulse_thread: expected to run on, got an exception'
    assert not controller.device.armed
    assert fired == []


def test_simulated_device_refuses_what_a_real_one_would():
    now = [0]
    device = SimulatedDevice(clock=lambda: now[0])
    with pytest.raises(DeviceError, match='expected an open device to arm, got a closed one'):
        device.arm()
    device.open()
    assert device.fire(0.5, 1e-4) is None
    device.arm()
    device.prepare(0.5)
    assert device.fire(0.5, 1e-4).intensity == 0.5
    # nobody kept it alive
    now[0] += 1_200_000_000
    assert device.fire(0.5, 1e-4) is None
    assert not device.armed
    device.arm()
    device.close()
    assert not device.opened
    assert not device.armed
