# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The whole driver apart from ROS: controller, threads, serial device, guard, instrument."""

from rpms_ros.stimulation import constant
from rpms_ros.stimulation.device_specification import load_device_specification
from rpms_ros.stimulation.states import State


def test_whole_driver_on_the_line(instrument, armed_on_the_line, wait_for):
    fake = instrument(watchdog_s=20.0)
    specification = load_device_specification('rapid2-240v')
    controller, threads, alive = armed_on_the_line(fake, specification)
    fired = []
    controller.on_fired = fired.append
    run = controller.start(constant(0.1, 0.5, 20.0))
    wait_for(lambda: alive() and bool(run.ended))
    assert run.ended == 'completed'
    assert fake.fired() == [10] * 10
    assert {pulse.delivery.intensity for pulse in fired} == {0.1}
    # there is time to read the intensity back only where the machine is quick enough
    told = {pulse.delivery.unverified for pulse in fired}
    assert told <= {frozenset({'delivery'}), frozenset({'delivery', 'intensity'})}
    alive()
    controller.arm()
    alive()
    controller.start(constant(0.1, 5.0, 20.0))
    wait_for(lambda: alive() and len(fake.triggers) > 12)
    controller.stop('test', 'a test')
    wait_for(lambda: not fake.armed)
    assert fake.percent == 0
    stopped = len(fake.triggers)
    controller.cleanup()
    threads.close()
    assert not fake.remote
    assert len(fake.triggers) == stopped
    assert controller.state is State.UNCONFIGURED
