"""From the emergency-stop message to the last pulse: a live graph of three nodes under load.

A trial starts a 50 Hz train, presses the button at a random moment, and looks at the stamp of the
last pulse that was delivered.  None may be later than one repetition period plus 20 ms after the
message.  Prints one line of figures; exit code 1 if the bound is broken.
"""

import argparse
import random
import sys
import time

from driver_graph import graph
from driver_graph import load
from driver_graph import spin_until
from driver_graph import spread

RATE_HZ = 50.0
MARGIN_S = 0.020
SCHEDULE = 'segments: [{kind: constant, rate_hz: 50.0, duration_s: 20.0, intensity: 0.3}]'
# longer than the bound by far: what has not come by then never comes
SILENCE_S = 0.3
NODES = {
    'stimulator_driver': {
        'require_operator': 'false',
        'require_stop_button': 'false',
        'executor_timeout': 5.0,
        'maximum_rate': RATE_HZ,
    },
    'plant_simulator': {'minimum_subscribers': 1},
    'identifier': {},
}


class Trials:
    def __init__(self, node, executor):
        from lifecycle_msgs.srv import ChangeState
        from rclpy.action import ActionClient
        from std_msgs.msg import Bool
        from std_srvs.srv import Trigger

        from rpms_msgs.action import RunSchedule
        from rpms_msgs.msg import DriverStatus
        from rpms_msgs.msg import Pulse
        from rpms_ros.messages import nanoseconds
        from rpms_ros.nodes import qos
        from rpms_ros.nodes import topics

        self.node, self.executor = node, executor
        self.onsets, self.reason = [], ''
        node.create_subscription(
            Pulse,
            topics.PULSES,
            lambda message: self.onsets.append(nanoseconds(message.header.stamp)),
            qos.PULSES,
        )
        node.create_subscription(DriverStatus, topics.DRIVER_STATUS, self.on_status, qos.STATUS)
        self.button = node.create_publisher(Bool, topics.EMERGENCY_STOP, qos.STOP)
        self.reset = node.create_client(Trigger, topics.RESET_EMERGENCY_STOP)
        self.changes = node.create_client(ChangeState, 'stimulator_driver/change_state')
        self.goals = ActionClient(node, RunSchedule, topics.RUN_SCHEDULE)
        self.trigger, self.change_state = Trigger.Request(), ChangeState.Request
        self.goal, self.bool = RunSchedule.Goal(schedule=SCHEDULE), Bool
        for ready in (
            self.reset.service_is_ready,
            self.changes.service_is_ready,
            self.goals.server_is_ready,
            lambda: self.button.get_subscription_count() == 1,
        ):
            self.wait(ready)

    def on_status(self, message):
        self.reason = message.reason

    def wait(self, predicate, timeout_s=30.0):
        try:
            spin_until(self.executor, predicate, timeout_s)
        except TimeoutError as error:
            raise TimeoutError(f'{error}; the driver says: {self.reason}') from error

    def done(self, future):
        self.wait(future.done)
        return future.result()

    def change(self, transition):
        request = self.change_state()
        request.transition.id = transition
        return self.done(self.changes.call_async(request)).success

    def one(self):
        """Return how long after the stop message the last pulse was [s]; negative if before."""
        from lifecycle_msgs.msg import Transition

        self.wait(lambda: self.change(Transition.TRANSITION_ACTIVATE))
        self.onsets.clear()
        if not self.done(self.goals.send_goal_async(self.goal)).accepted:
            raise RuntimeError('expected an accepted goal, got a refused one')
        self.wait(lambda: len(self.onsets) > 5)
        pressed = time.monotonic() + random.uniform(0.0, 1.0 / RATE_HZ)
        self.wait(lambda: time.monotonic() >= pressed)
        sent_ns = time.time_ns()
        self.button.publish(self.bool(data=True))
        silent = time.monotonic() + SILENCE_S
        self.wait(lambda: time.monotonic() >= silent)
        last_ns = self.onsets[-1]
        self.button.publish(self.bool(data=False))
        self.wait(lambda: self.done(self.reset.call_async(self.trigger)).success)
        return (last_ns - sent_ns) / 1e9


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--trials', type=int, default=200)
    parser.add_argument('--load', type=int, default=2, help='busy processes beside the graph')
    arguments = parser.parse_args(argv)
    random.seed(1)
    with load(arguments.load), graph(NODES):
        from lifecycle_msgs.msg import Transition
        from rclpy.experimental.events_executor import EventsExecutor
        from rclpy.node import Node

        node, executor = Node('bench'), EventsExecutor()
        executor.add_node(node)
        trials = Trials(node, executor)
        trials.change(Transition.TRANSITION_CONFIGURE)
        last = [trials.one() for _ in range(arguments.trials)]
        executor.remove_node(node)
        node.destroy_node()
    bound = 1.0 / RATE_HZ + MARGIN_S
    print(
        f'stop to last pulse, {arguments.trials} trials at {RATE_HZ:g} Hz, '
        f'{arguments.load} busy processes: {spread(last, 1e3)} ms, bound {1e3 * bound:.0f} ms'
    )
    return 0 if max(last) <= bound else 1


if __name__ == '__main__':
    sys.exit(main())
