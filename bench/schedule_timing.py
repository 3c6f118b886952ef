# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How late pulses are against their schedule: 20 Hz for 60 s, live, on a loaded machine.

The simulated device takes the time that its frames would take on a serial line.  Prints the
distribution of lateness and of the intervals, what was dropped, and the drift over the whole run;
exit code 1 if a pulse is later than the limit, or missing and not counted as dropped.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from driver_graph import graph, load, spin_until, spread

from rpms_ros.stimulation import constant, schedule_to_text

LATENESS_LIMIT_S = 10e-3
TESTS = str(Path(__file__).resolve().parents[1] / 'test')
# bytes of ten bits: setting and its answer 8, status 6, trigger 3 before the pulse, 3 after it
START = """
import sys
sys.path.insert(0, {tests!r})
from faulty_device import FaultyDevice, WireTimes
from rpms_ros.stimulation.devices import simulated
from rpms_ros.nodes.stimulator_driver import main
wire = WireTimes(*(10 * count / {baud} for count in (8, 6, 3, 3)))
simulated.build = lambda options: FaultyDevice(wire=wire, steps=100)
sys.exit(main())
"""


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=60.0, help='[s]')
    parser.add_argument('--load', type=int, default=2, help='busy processes beside the driver')
    parser.add_argument('--rate', type=float, default=20.0, help='[Hz]')
    parser.add_argument('--baud', type=float, default=9600.0, help='of the line')
    arguments = parser.parse_args(argv)
    schedule = str(Path(tempfile.mkdtemp()) / 'train.yaml')
    train = constant(0.3, arguments.duration, arguments.rate)
    Path(schedule).write_text(schedule_to_text(train))
    driver = {
        'require_operator': 'false',
        'require_stop_button': 'false',
        'lateness_limit': LATENESS_LIMIT_S,
        'autostart': 'true',
        'schedule_file': schedule,
        # twice the rate: the lateness is measured, not the rate limit
        'maximum_rate': 2 * arguments.rate,
    }
    asked, given, status = [], [], []
    start = START.format(baud=arguments.baud, tests=TESTS)
    with load(arguments.load), graph({'stimulator_driver': driver}, start):
        from rclpy.experimental.events_executor import EventsExecutor
        from rclpy.node import Node

        from rpms_msgs.msg import DriverStatus, Pulse
        from rpms_ros.nodes.common import qos, topics

        node, executor = Node('bench'), EventsExecutor()
        listen = node.create_subscription
        listen(Pulse, topics.PULSES_COMMANDED, asked.append, qos.PULSES)
        listen(DriverStatus, topics.DRIVER_STATUS, status.append, qos.STATUS)
        listen(Pulse, topics.PULSES, given.append, qos.PULSES)
        executor.add_node(node)

        def ended():
            reason = status[-1].reason if status else ''
            stopped = status and status[-1].state in (DriverStatus.STOPPED, DriverStatus.FAULT)
            return reason == 'completed' or reason.startswith('ended') or stopped

        spin_until(executor, ended, arguments.duration + 60.0)
        spin_until(executor, lambda: len(given) >= status[-1].pulses_delivered, 10.0)
        executor.remove_node(node)
        node.destroy_node()
    return report(asked, given, status[-1], arguments)


def report(asked, given, status, arguments):
    from rpms_ros.messages import nanoseconds

    rate = arguments.rate
    due = np.array([nanoseconds(pulse.header.stamp) for pulse in asked])
    onset = np.array([nanoseconds(pulse.header.stamp) for pulse in given])
    lateness = (onset - due) / 1e9
    pulse = np.rint((due - due[0]) * rate / 1e9)
    off = (onset - onset[0]) / 1e9 - pulse / rate
    # the slope of a line through all of them, over the length of the run
    drift = np.polyfit(pulse / rate, off, 1)[0] * arguments.duration
    total = round(rate * arguments.duration)
    print(
        f'{rate:g} Hz for {arguments.duration:g} s at {arguments.baud:g} baud, '
        f'{arguments.load} busy processes, '
        f'load average {os.getloadavg()[0]:.1f}: '
        f'{len(given)} of {total} pulses delivered, {status.pulses_dropped} dropped as late'
    )
    print(f'  the driver says: {status.reason}')
    late = int(np.sum(lateness > LATENESS_LIMIT_S))
    print(f'  lateness {spread(lateness, 1e3)} ms, {late} above {1e3 * LATENESS_LIMIT_S:g} ms')
    uneven = np.abs(np.diff(onset) / 1e9 - np.diff(pulse) / rate)
    print(f'  interval - period {spread(uneven, 1e3)} ms')
    print(f'  drift over the run {1e3 * drift:.3f} ms')
    return 0 if late == 0 and len(given) + status.pulses_dropped == total else 1


if __name__ == '__main__':
    sys.exit(main())
