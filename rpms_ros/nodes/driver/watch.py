# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The thread that receives, without any executor, what has to stop a driver.

An executor that is busy hears nothing, and its queue holds a few messages only.  Here a node that
is in no executor is read by a thread of its own every few milliseconds: stop buttons, the service
`emergency_stop` (std_srvs/Trigger), which latches a stop, the operator's heartbeat, the end of the
operator's process, and the graph.  Its own life is a sign of life that every pulse asks for.

Other drivers on the graph, and the publishers of a topic.
"""

import contextlib
import ctypes
import threading
import time
from collections.abc import Callable
from typing import NamedTuple

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from rpms_msgs.msg import OperatorHeartbeat
from rpms_ros import messages
from rpms_ros.errors import NodeError
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.runner import complete_or_gone
from rpms_ros.nodes.common.subscriptions import queued_subscription, second_node
from rpms_ros.nodes.driver.goals import UNIQUE, WATCH
from rpms_ros.stimulation.driver.authority import Authority, Beat, ProcessLife
from rpms_ros.stimulation.driver.controller import StimulationController
from rpms_ros.stimulation.driver.safety_monitor import EMERGENCY_STOP, HEARTBEAT, HOLD_SHARE
from rpms_ros.stimulation.driver.states import POSSIBLE
from rpms_ros.stimulation.driver.stop_buttons import StopButtons

# A button says true or false and no name: that one of two is silent, or that one is still pressed
# while the other says that it is released, shows only by who said it.  rcl tells, rclpy does not.
_OK, _NOTHING = 0, 401


class _Allocator(ctypes.Structure):
    """rcutils_allocator_t."""

    _fields_ = (('functions', ctypes.c_void_p * 5),)


class _Bytes(ctypes.Structure):
    """rcutils_uint8_array_t."""

    _fields_ = (
        ('buffer', ctypes.c_void_p),
        ('length', ctypes.c_size_t),
        ('capacity', ctypes.c_size_t),
        ('allocator', _Allocator),
    )


class _Information(ctypes.Structure):
    """rmw_message_info_t."""

    _fields_ = (
        ('sent_ns', ctypes.c_int64),
        ('received_ns', ctypes.c_int64),
        ('sequence', ctypes.c_uint64),
        ('reception', ctypes.c_uint64),
        ('implementation', ctypes.c_char_p),
        ('identity', ctypes.c_uint8 * 16),
        ('within_process', ctypes.c_bool),
    )


class Taken(NamedTuple):
    """One message.

    Attributes
    ----------
    data : bytes
        The message, serialised.
    identity : bytes
        Identity of its publisher.
    sequence : int
        Number of the message, counted by its publisher.
    """

    data: bytes
    identity: bytes
    sequence: int


class Taker:
    """Takes from one subscription of a node that is in no executor, with the publisher.

    Parameters
    ----------
    subscription : Subscription
        Subscription of a node that is in no executor.

    Raises
    ------
    NodeError
        If rcl is missing, or is not that of Jazzy.
    """

    def __init__(self, subscription: Subscription) -> None:
        self._subscription = subscription
        try:
            rcl, rcutils = ctypes.CDLL('librcl.so'), ctypes.CDLL('librcutils.so')
            self._take = rcl.rcl_take_serialized_message
            self._forget_error = rcutils.rcutils_reset_error
            allocator = rcutils.rcutils_get_default_allocator
            self._free = rcutils.rcutils_uint8_array_fini
        except (OSError, AttributeError) as error:
            raise NodeError(f'expected rcl of ROS 2 Jazzy, got {error}') from error
        self._take.argtypes = (ctypes.c_void_p,) * 4
        allocator.restype = _Allocator
        self._free.argtypes = (ctypes.POINTER(_Bytes),)
        # empty: rcl makes room for a message as it takes it
        self._bytes, self._information = _Bytes(allocator=allocator()), _Information()
        self._places = ctypes.addressof(self._bytes), ctypes.addressof(self._information)

    def take(self) -> Taken | None:
        """Return the next message, None if there is none."""
        handle = self._subscription.handle
        with handle:
            answer = self._take(handle.pointer, *self._places, None)
        if answer == _NOTHING:
            return None
        if answer != _OK:
            self._forget_error()
            topic = self._subscription.topic
            raise NodeError(f'expected a message of {topic}, got error {answer}')
        data = ctypes.string_at(self._bytes.buffer, self._bytes.length)
        return Taken(data, bytes(self._information.identity), int(self._information.sequence))

    def close(self) -> None:
        """Free the memory."""
        self._free(ctypes.byref(self._bytes))


def publishers_of(node: Node, topic: str) -> dict[bytes, str]:
    """Return the node of every publisher of a topic, by the identity of the publisher."""
    return {
        bytes(publisher.endpoint_gid): _joined(publisher.node_namespace, publisher.node_name)
        for publisher in node.get_publishers_info_by_topic(topic)
    }


_SEND_GOAL = '/_action/send_goal'
SENSORS = 'force_publishers'


def others_of_this_name(node: Node) -> str:
    """Return why this driver is not the only one of its name, empty if it is.

    A driver is known by its node, and by the action that it serves: of two, both would run a goal.
    """
    name, namespace = node.get_name(), node.get_namespace()
    nodes = node.get_node_names_and_namespaces().count((name, namespace))
    if nodes > 1:
        return f'expected one driver {_joined(namespace, name)}, got {nodes} nodes of this name'
    # ROS applies no rule of remapping for the name of an action to its services
    goals = node.resolve_service_name(f'{topics.RUN_SCHEDULE}{_SEND_GOAL}')
    if (servers := node.count_services(goals)) > 1:
        return f'expected one driver that serves {goals.removesuffix(_SEND_GOAL)}, got {servers}'
    return ''


def _joined(namespace: str, name: str) -> str:
    return f'{namespace.rstrip("/")}/{name}'


WATCH_TIMEOUT_S = 0.1
"""Longest silence of the thread that hears buttons and heartbeat, while armed."""

_LOOK_S = 0.005
_GRAPH_PERIOD_NS = 100_000_000
# the state of a button stands behind four bytes of encapsulation; the last of these may say how
# many bytes follow it that fill up a word
_HEADER, _FILLED, _TWO_WORDS = 4, 3, 8


class DriverWatch:
    """Receives what stops a driver.

    Parameters
    ----------
    node : Node
        The driver's.
    controller : StimulationController
        What is stopped.
    buttons : StopButtons
        Takes what buttons say.
    authority : Authority
        Takes what the operator's heartbeat says.
    timeout_s : float
        Longest silence of this thread while a pulse is possible [s].
    refused : callable
        Told why a heartbeat was refused.
    """

    def __init__(
        self,
        node: Node,
        controller: StimulationController,
        buttons: StopButtons,
        authority: Authority,
        timeout_s: float,
        refused: Callable[[str], None],
    ) -> None:
        self._driver, self._controller, self._buttons = node, controller, buttons
        self._authority, self._refused = authority, refused
        # the process of the operator, and for which token it is watched
        self._client = ProcessLife('', 0)
        self._watched_for = -1
        self._next_graph_ns = 0
        self._pressed = False
        self._twice = {UNIQUE: '', SENSORS: ''}
        self._lock = threading.Lock()
        self._closing = False
        self._node = second_node(node, '_watch')
        with complete_or_gone(self._node):
            self._live = self._taker(Bool, topics.EMERGENCY_STOP, qos.STOP_LIVE)
            self._kept = self._taker(Bool, topics.EMERGENCY_STOP, qos.STOP_KEPT)
            self._beats = self._taker(OperatorHeartbeat, topics.HEARTBEAT, qos.STOP_LIVE)
            # taken by `_answer_stops`: no executor calls anything for it
            name = node.resolve_service_name(topics.EMERGENCY_STOP)
            self._stops = self._node.create_service(Trigger, name, lambda _, response: response)
        # pulses are held back before the stop is latched
        controller.interlocks.require(WATCH, timeout_s, hold_s=HOLD_SHARE * timeout_s)
        self._thread = threading.Thread(target=self._run, name='driver_watch', daemon=True)
        self._thread.start()

    def look(self) -> None:
        """Take everything that has come, and stop the driver if that is needed."""
        with self._lock:
            if self._closing:
                return
            self._answer_stops()
            now_ns = time.monotonic_ns()
            self._hear(now_ns)
            if now_ns >= self._next_graph_ns:
                self._next_graph_ns = now_ns + _GRAPH_PERIOD_NS
                self._look_at_graph()
            self._judge_buttons(time.monotonic_ns())
            self._judge_operator(time.monotonic_ns())
            self._controller.seen(WATCH)

    def forget_gone(self) -> None:
        """Forget buttons that have left the graph; part of a reset."""
        with self._lock:
            self._look_at_graph()
            self._buttons.forget_gone()
        self.look()

    def close(self) -> None:
        """End the thread and the second node."""
        with self._lock:
            self._closing = True
        if self._thread is not threading.current_thread():
            self._thread.join()
        for taker in (self._live, self._kept, self._beats):
            taker.close()
        self._client.close()
        self._node.destroy_node()

    def _taker(self, kind: type, topic: str, profile: QoSProfile) -> Taker:
        whole = self._driver.resolve_topic_name(topic)
        return Taker(queued_subscription(self._node, kind, whole, profile))

    def _run(self) -> None:
        try:
            while not self._closing:
                self.look()
                time.sleep(_LOOK_S)
        except Exception as error:  # noqa: BLE001
            # whatever it is: without this thread nothing stops the driver
            if not self._closing and self._driver.context.ok():
                self._controller.fail(WATCH, f'{WATCH}: expected to run on, got {error!r}')

    def _answer_stops(self) -> None:
        """Stop if the service was called, and say so; what is not taken here comes next time."""
        answer = Trigger.Response(success=True, message='stopped; reset_emergency_stop resets it')
        for _ in range(qos.STOP_DEPTH):
            with self._stops.handle:
                taken = self._stops.handle.service_take_request(Trigger.Request)
            if taken is None or taken[0] is None:
                return
            self._controller.stop(EMERGENCY_STOP, 'emergency stop by service')
            # who has asked may be gone
            with contextlib.suppress(rclpy_implementation.RCLError):
                self._stops.send_response(answer, taken[1])

    def _hear(self, now_ns: int) -> None:
        for taker, kept in ((self._kept, True), (self._live, False)):
            for taken in self._drained(taker):
                pressed = not says_released(taken.data)
                self._buttons.heard(taken.identity, taken.sequence, pressed, now_ns, kept)
        for taken in self._drained(self._beats):
            self._take_beat(taken, now_ns)

    def _drained(self, taker: Taker) -> list[Taken]:
        """Return what has come; if the queue was full, something may have been lost."""
        found: list[Taken] = []
        while (taken := taker.take()) is not None:
            found.append(taken)
            if len(found) >= qos.STOP_DEPTH:
                self._buttons.overrun(
                    f'expected at most {qos.STOP_DEPTH} messages in a look at buttons and '
                    'heartbeat, got more: some may be lost'
                )
                break
        return found

    def _take_beat(self, taken: Taken, now_ns: int) -> None:
        try:
            message = deserialize_message(taken.data, OperatorHeartbeat)
            stamp_ns = messages.nanoseconds(message.header.stamp)
            beat = Beat(message.token, stamp_ns, bool(message.enable), taken.identity)
        except Exception as error:  # noqa: BLE001
            self._refused(f'expected a heartbeat that can be read, got {error!r}')
            return
        # a token that is given meanwhile is another one: this process is not watched for it
        generation = self._authority.generation
        refusal = self._authority.beat(beat, now_ns)
        if refusal is not None:
            self._controller.count('heartbeat_refused')
            if self._authority.operator:
                self._refused(refusal)
        elif not self._client.known or generation != self._watched_for:
            self._client.close()
            self._client = ProcessLife(message.host, int(message.process))
            self._watched_for = generation

    def _look_at_graph(self) -> None:
        topic = self._driver.resolve_topic_name(topics.EMERGENCY_STOP)
        self._buttons.present(publishers_of(self._node, topic))
        before, sensors = self._twice, self._other_sensors()
        self._twice = {UNIQUE: others_of_this_name(self._driver), SENSORS: sensors}
        for name, problem in self._twice.items():
            if not problem:
                self._controller.interlocks.close(name)
            elif before[name]:
                self._controller.open(name, problem)
            elif self._controller.state not in POSSIBLE:
                # arming is refused at once, a train is stopped when it is seen again
                self._controller.interlocks.open(name, problem)

    def _other_sensors(self) -> str:
        """Return why a limited force may fall silent unnoticed, empty if it may not."""
        if not self._controller.settings.force_limit_n > 0.0:
            return ''
        force = self._driver.resolve_topic_name(topics.FORCE)
        names = sorted(publishers_of(self._node, force).values())
        return f'expected one publisher of {force}, got {", ".join(names)}' if names[1:] else ''

    def _judge_buttons(self, now_ns: int) -> None:
        problem, pressed = self._buttons.problem(now_ns), self._buttons.pressed
        first, self._pressed = pressed and not self._pressed, pressed
        if problem is None:
            self._controller.interlocks.close(EMERGENCY_STOP)
        else:
            self._controller.open(EMERGENCY_STOP, problem)
        press = self._buttons.taken_press()
        # pressed counts in every state, also if it is released again by now
        if press or (first and self._controller.state not in POSSIBLE):
            self._controller.stop(EMERGENCY_STOP, press or str(problem))

    def _judge_operator(self, now_ns: int) -> None:
        if self._authority.generation != self._watched_for:
            # of an operator before this one
            self._client.close()
        if not self._authority.confirmed:
            return
        problem = self._authority.problem(now_ns)
        # before the state: who releases an operator has disarmed
        released = self._authority.released_enable(now_ns)
        if self._client.ended:
            problem = f'expected the process of {self._authority.operator} to run, got its end'
        if problem is None or self._controller.state not in POSSIBLE:
            return
        if released:
            self._controller.disarm(problem)
        else:
            self._controller.stop(HEARTBEAT, problem)


def says_released(data: bytes) -> bool:
    """Return whether a serialized state of a button is one zero byte, alone or in a word.

    Between processes Fast DDS fills up a word without saying so.
    """
    if len(data) <= _HEADER:
        return False
    whole = _HEADER + 1 + (data[_HEADER - 1] & _FILLED)
    return len(data) in (whole, _TWO_WORDS) and data[_HEADER] == 0
