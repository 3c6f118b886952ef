"""How late pulses are against their schedule: 50 Hz for 60 s, live, on a loaded machine.

Prints the distribution of lateness and of the intervals, what was dropped, and the drift over the
whole run; exit code 1 if a pulse is missing that was not counted as dropped.
"""

import argparse
import os
import sys

import numpy as np
from driver_graph import graph
from driver_graph import load
from driver_graph import spin_until
from driver_graph import spread

RATE_HZ = 50.0


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=60.0, help='[s]')
    parser.add_argument('--load', type=int, default=2, help='busy processes beside the driver')
    parser.add_argument('--priority', type=int, default=0, help='real-time priority to ask for')
    arguments = parser.parse_args(argv)
    driver = {
        'require_operator': 'false',
        'require_stop_button': 'false',
        'executor_timeout': 5.0,
        'autostart': 'true',
        'realtime_priority': arguments.priority,
        'schedule': 'constant',
        'high': 0.3,
        # twice the rate: what is measured is the clock, not the rate limit
        'maximum_rate': 2 * RATE_HZ,
        'rate': RATE_HZ,
        'duration': arguments.duration,
    }
    asked, given, status = [], [], []
    with load(arguments.load), graph({'stimulator_driver': driver}):
        from rclpy.experimental.events_executor import EventsExecutor
        from rclpy.node import Node

        from rpms_msgs.msg import DriverStatus
        from rpms_msgs.msg import Pulse
        from rpms_ros.nodes import qos
        from rpms_ros.nodes import topics

        node, executor = Node('bench'), EventsExecutor()
        listen = node.create_subscription
        listen(Pulse, topics.PULSES_COMMANDED, asked.append, qos.PULSES)
        listen(DriverStatus, topics.DRIVER_STATUS, status.append, qos.STATUS)
        listen(Pulse, topics.PULSES, given.append, qos.PULSES)
        executor.add_node(node)

        def ended():
            reason = status[-1].reason if status else ''
            return reason == 'completed' or reason.startswith('ended')

        spin_until(executor, ended, arguments.duration + 60.0)
        spin_until(executor, lambda: len(given) >= status[-1].pulses_delivered, 10.0)
        executor.remove_node(node)
        node.destroy_node()
    return report(asked, given, status[-1], arguments)


def report(asked, given, status, arguments):
    from rpms_ros.messages import nanoseconds

    due = np.array([nanoseconds(pulse.header.stamp) for pulse in asked])
    onset = np.array([nanoseconds(pulse.header.stamp) for pulse in given])
    lateness = (onset - due) / 1e9
    pulse = np.rint((due - due[0]) * RATE_HZ / 1e9)
    off = (onset - onset[0]) / 1e9 - pulse / RATE_HZ
    # the slope of a line through all of them, over the length of the run
    drift = np.polyfit(pulse / RATE_HZ, off, 1)[0] * arguments.duration
    total = round(RATE_HZ * arguments.duration)
    print(
        f'{RATE_HZ:g} Hz for {arguments.duration:g} s, {arguments.load} busy processes, '
        f'load average {os.getloadavg()[0]:.1f}, priority {arguments.priority}: '
        f'{len(given)} of {total} pulses delivered, {status.pulses_dropped} dropped as late'
    )
    print(f'  lateness {spread(lateness, 1e3)} ms')
    uneven = np.abs(np.diff(onset) / 1e9 - np.diff(pulse) / RATE_HZ)
    print(f'  interval - period {spread(uneven, 1e3)} ms')
    print(f'  drift over the run {1e3 * drift:.3f} ms')
    return 0 if len(given) + status.pulses_dropped == total else 1


if __name__ == '__main__':
    sys.exit(main())
