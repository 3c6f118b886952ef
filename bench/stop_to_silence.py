# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Time from the cause of a stop to the last pulse: real node, simulated device, under load.

A trial arms the driver as an operator, starts a train at 50 Hz, and at a random moment does one of

button        a stop button says that it is pressed
cancel        the operator's client cancels the goal
enable        the operator lets go of the enable
client        SIGKILL of the operator's process, which has the goal as well
signal        SIGTERM to the driver
stopped       SIGSTOP of the driver for 2.5 s
blocked       the driver's executor is busy for 2.5 s when the button is pressed

and looks at the stamp of the last pulse that was delivered.  None may be later than one repetition
period plus 20 ms.  Prints one line a cause; exit code 1 if the bound is broken.  What guard and
instrument do when the driver is killed, stopped or hangs is measured by bench/guard.py.
"""

import argparse
import contextlib
import os
import random
import signal
import subprocess
import sys
import time

from driver_graph import graph, load, spin_until, start

RATE_HZ = 50.0
MARGIN_S = 0.020
# much longer than the bound: later pulses are not expected
SILENCE_S = 0.3
# longer than a simulated device bears
BLOCKED_S = 2.5
CAUSES = ('button', 'cancel', 'enable', 'client', 'signal', 'stopped', 'blocked')
# after these the driver is started again
ENDS_DRIVER = ('signal',)
PARAMETERS = {'maximum_rate': RATE_HZ, 'lateness_limit': 0.01}
# a driver whose executor is blocked by a service that sleeps
BLOCKING = f"""
import sys, time
from rpms_ros.nodes import stimulator_driver
from rpms_ros.nodes.common.runner import run
from std_srvs.srv import Trigger
class Driver(stimulator_driver.StimulatorDriver):
    def __init__(self, **options):
        super().__init__(**options)
        self.create_service(Trigger, 'block', self.block)
    def block(self, request, response):
        time.sleep({BLOCKED_S})
        return response
sys.exit(run(Driver))
"""
# the operator in a process of their own, told by lines what to do
CLIENT = """
import sys, threading
import rclpy
from lifecycle_msgs.srv import ChangeState
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rpms_ros.nodes.common.runner import use_fast_discovery
from rpms_ros.nodes.common.operator import OperatorClient
from rpms_ros.stimulation import constant
use_fast_discovery()
rclpy.init()
node, executor = Node('client'), EventsExecutor()
executor.add_node(node)
ada = OperatorClient(node, 'ada')
changes = node.create_client(ChangeState, 'stimulator_driver/change_state')
told = []
def lines():
    for line in iter(sys.stdin.readline, ''):
        told.append(line.strip())
threading.Thread(target=lines, daemon=True).start()
def until(done):
    while not done():
        executor.spin_once(timeout_sec=0.01)
def ask(call):
    future = call()
    until(future.done)
    return future.result()
until(lambda: ada.ready and changes.service_is_ready())
configure = ChangeState.Request()
configure.transition.id = 1
while True:
    until(lambda: bool(told))
    told.clear()
    ada.enable = True
    ask(lambda: changes.call_async(configure))
    while not ask(ada.request).success:
        pass
    until(lambda: ada.token)
    while not ask(ada.confirm).success:
        if not ada.token:
            break
    handle = ask(lambda: ada.start(constant(0.3, 60.0, 50.0)))
    print('started', flush=True)
    until(lambda: bool(told))
    word = told.pop(0)
    if word == 'cancel':
        handle.cancel_goal_async()
    elif word == 'enable':
        ada.enable = False
        ada.beat()
    ask(handle.get_result_async)
    ada.enable = False
    print('ended', flush=True)
"""


class Trials:
    """The driver, the operator and a node that presses, listens and resets."""

    def __init__(self, node, executor):
        from std_srvs.srv import Trigger

        from rpms_msgs.msg import DriverStatus, Pulse
        from rpms_ros.messages import nanoseconds
        from rpms_ros.nodes.common import qos, topics
        from rpms_ros.nodes.common.operator import ButtonPublisher

        self.node, self.executor = node, executor
        self.onsets, self.reason = [], ''
        node.create_subscription(
            Pulse,
            topics.PULSES,
            lambda message: self.onsets.append(nanoseconds(message.header.stamp)),
            qos.PULSES,
        )
        node.create_subscription(DriverStatus, topics.DRIVER_STATUS, self.on_status, qos.STATUS)
        self.button = ButtonPublisher(node)
        self.reset = node.create_client(Trigger, topics.RESET_EMERGENCY_STOP)
        self.block = node.create_client(Trigger, 'block')
        self.request = Trigger.Request()
        self.driver = self.client = None

    def on_status(self, message):
        self.reason = message.reason

    def wait(self, predicate, timeout_s=60.0):
        try:
            spin_until(self.executor, predicate, timeout_s)
        except TimeoutError as error:
            raise TimeoutError(f'{error}; the driver says: {self.reason}') from error

    def wait_for(self, seconds):
        end = time.monotonic() + seconds
        self.wait(lambda: time.monotonic() >= end)

    def begin(self):
        """Begin a train; a driver that a loaded machine has stopped before is started again."""
        for _ in range(5):
            try:
                self.start_train()
            except TimeoutError:
                self.close()
            else:
                return
        raise TimeoutError(f'expected a train, got none; the driver says: {self.reason}')

    def start_train(self):
        """Bring up what is missing, arm, and wait for a random moment of the train."""
        if self.driver is None:
            self.driver = start('stimulator_driver', PARAMETERS, BLOCKING)
            self.wait(self.reset.service_is_ready)
        if self.client is None:
            self.client = subprocess.Popen(
                [sys.executable, '-c', CLIENT],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                bufsize=0,
            )
            os.set_blocking(self.client.stdout.fileno(), False)
        self.onsets.clear()
        self.tell('go')
        self.wait(lambda: len(self.onsets) > 5, 20.0)
        self.wait_for(random.uniform(0.0, 1.0 / RATE_HZ))

    def tell(self, word):
        self.client.stdin.write(f'{word}\n'.encode())

    def one(self, cause):
        """Return how long after its cause the last pulse was [s]; negative if before."""
        self.begin()
        if cause == 'blocked':
            self.block.call_async(self.request)
            self.wait_for(0.05)
        began_ns = time.time_ns()
        self.do(cause)
        self.wait_for(SILENCE_S)
        if cause in ('stopped', 'blocked'):
            if cause == 'stopped':
                self.wait_for(BLOCKED_S - SILENCE_S)
                self.driver.send_signal(signal.SIGCONT)
            self.wait_for(BLOCKED_S + SILENCE_S)
        last_ns = self.onsets[-1]
        self.end(cause)
        return (last_ns - began_ns) / 1e9

    def do(self, cause):
        if cause in ('button', 'blocked'):
            self.button.set(True)
        elif cause in ('cancel', 'enable'):
            self.tell(cause)
        elif cause == 'client':
            self.client.kill()
        else:
            numbers = {'signal': signal.SIGTERM, 'stopped': signal.SIGSTOP}
            self.driver.send_signal(numbers[cause])

    def end(self, cause):
        self.button.set(False)
        if cause in ENDS_DRIVER:
            self.driver.wait(30)
            self.driver = None
        if cause == 'client' or cause in ENDS_DRIVER:
            self.close_client()
        if self.client is not None:
            # ends a trial whose cause was not the client
            if cause not in ('cancel', 'enable'):
                self.tell('over')
            self.wait(lambda: b'ended' in (self.client.stdout.read(1000) or b''))
        if self.driver is not None:
            self.wait(self.resets)

    def resets(self):
        future = self.reset.call_async(self.request)
        self.wait(future.done)
        return future.result().success

    def close_client(self):
        self.client.kill()
        self.client.communicate()
        self.client = None

    def close(self):
        if self.client is not None:
            self.close_client()
        if self.driver is not None:
            self.driver.terminate()
            self.driver.wait(30)
            self.driver = None


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('causes', nargs='*', default=CAUSES, metavar='CAUSE')
    parser.add_argument('--trials', type=int, default=200)
    parser.add_argument('--load', type=int, default=2, help='busy processes beside the graph')
    arguments = parser.parse_args(argv)
    random.seed(1)
    bound = 1.0 / RATE_HZ + MARGIN_S
    broken = 0
    print(f'{RATE_HZ:g} Hz, {arguments.load} busy processes, bound {1e3 * bound:.0f} ms')
    print(f'{"cause":10} trials  median     p99     max  over  [ms]')
    with load(arguments.load), graph({}):
        from rclpy.experimental.events_executor import EventsExecutor
        from rclpy.node import Node

        node, executor = Node('bench'), EventsExecutor()
        executor.add_node(node)
        with contextlib.closing(Trials(node, executor)) as trials:
            for cause in arguments.causes:
                late = sorted(trials.one(cause) for _ in range(arguments.trials))
                over = sum(each > bound for each in late)
                broken += over
                picked = [late[round(share * (len(late) - 1))] for share in (0.5, 0.99, 1.0)]
                shown = ' '.join(f'{1e3 * each:7.1f}' for each in picked)
                print(f'{cause:10} {len(late):6} {shown} {over:5}', flush=True)
        executor.remove_node(node)
        node.destroy_node()
    return 1 if broken else 0


if __name__ == '__main__':
    sys.exit(main())
