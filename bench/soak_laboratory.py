# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The simulated hour of bench/soak.py: a laboratory whose sensor, stimulator and clock go wrong.

A plant follows /clock, which is moved on by half a second as soon as everybody has heard all of
the half second before: as fast as the nodes are.  Between plant and identifier stands a link that
drops, doubles, holds back and damages messages, lets their clock jump, and lets a second sensor
speak.
"""

import math
import random
import struct
from collections import Counter
from pathlib import Path

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from rpms_msgs.msg import Pulse as PulseMessage
from rpms_ros import messages
from rpms_ros.nodes.common import qos
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.plant_simulator import PlantSimulator
from rpms_ros.nodes.recorder import Recorder
from rpms_ros.pulses import Pulse

STEP_NS = 500_000_000
START_NS = 1_800_000_000_000_000_000
PULSE_PERIOD_NS = 50_000_000
SECOND_SENSOR = 'second sensor'
FAULTS = (
    'dropped',
    'doubled',
    'held back',
    'not a number',
    'clock ahead',
    'clock back',
    SECOND_SENSOR,
    'pulse dropped',
    'pulse doubled',
    'pulse held back',
)
_SHARE = 0.1
_HELD_STEPS = 3


class Counting:
    """A publisher that counts."""

    def __init__(self, publisher):
        self._publisher = publisher
        self.count = 0

    def publish(self, message):
        self._publisher.publish(message)
        self.count += 1


class CountingIdentifier(Identifier):
    """An identifier that counts messages and estimates."""

    def __init__(self, **options):
        super().__init__(**options)
        self.heard = Counter()
        self.said = 0
        stream = self.stream
        self._counted(stream, 'add_pulses', 'pulses')
        self._counted(stream, 'add_forces', 'force')
        advance = stream.advance

        def counting():
            estimates = advance()
            self.said += len(estimates)
            return estimates

        stream.advance = counting

    def _counted(self, stream, method, name):
        take = getattr(stream, method)

        def counting(values):
            take(values)
            self.heard[name] += len(values)

        setattr(stream, method, counting)


class CountingPlant(PlantSimulator):
    """A plant that counts received pulses."""

    def __init__(self, **options):
        self.heard = 0
        super().__init__(**options)

    def _on_pulse(self, message):
        super()._on_pulse(message)
        self.heard += 1


class Link(Node):
    """Relays messages of plant and stimulator, with the present fault."""

    def __init__(self, generator, **options):
        super().__init__('link', **options)
        self.generator = generator
        self.fault = ''
        self.sent = Counter()
        self.injected = Counter()
        self.given = 0
        self.newest_ns = 0
        self.offset_ns = 0
        self._held, self._held_pulses = [], []
        self._force = self._pulses = self._given = None
        self._steps_held = 0
        self.speak()
        self.give_anew()
        self._clock = self.create_publisher(Clock, '/clock', 1)
        self.create_subscription(WrenchStamped, 'force_true', self._on_force, qos.FORCE, raw=True)

    def speak(self):
        """Begin to publish, with a new publisher if there was one before.

        Subscriptions that were made in this process after a publisher had sent thousands of
        messages did not receive from it in most runs of this bench; the cause was not found.
        """
        for publisher in filter(None, (self._force, self._pulses)):
            self.destroy_publisher(publisher)
        self._force = self.create_publisher(WrenchStamped, 'force', qos.FORCE)
        self._pulses = self.create_publisher(PulseMessage, 'pulses', qos.PULSES)

    def give_anew(self):
        """Begin to publish the pulses of the muscle, with a new publisher for the same reason."""
        if self._given is not None:
            self.destroy_publisher(self._given)
        self._given = self.create_publisher(PulseMessage, 'pulses_given', qos.PULSES)

    def begin_step(self, fault):
        """Introduce a fault until the next step."""
        self.fault = fault
        if fault:
            self.injected[fault] += 1
        self.offset_ns += {'clock ahead': 30, 'clock back': -3}.get(fault, 0) * 10**9
        held, self._held = self._held, []
        for data in held:
            self._send(data)
        self._steps_held += 1
        if self._steps_held > _HELD_STEPS:
            late, self._held_pulses = self._held_pulses, []
            for pulse in late:
                self._send_pulse(pulse)

    def tell_time(self, now_ns):
        self._clock.publish(Clock(clock=messages.time_message(now_ns, MESSAGE_TYPES)))

    def give(self, pulse):
        """Give a pulse to the muscle, and tell the others of it."""
        self._given.publish(messages.pulse_message(pulse, MESSAGE_TYPES))
        self.given += 1
        shifted = Pulse(pulse.onset_ns + self.offset_ns, pulse.intensity, pulse.sequence)
        fault, hit = self.fault, self.generator.random() < _SHARE
        if fault == 'pulse held back' and hit:
            self._held_pulses.append(shifted)
            self._steps_held = 0
        elif not (fault == 'pulse dropped' and hit):
            self._send_pulse(shifted)
            if fault == 'pulse doubled' and hit:
                self._send_pulse(shifted)

    def _send_pulse(self, pulse):
        self._pulses.publish(messages.pulse_message(pulse, MESSAGE_TYPES))
        self.sent['pulses'] += 1

    def _on_force(self, data):
        self.newest_ns = messages.stamp_of_bytes(data)
        data = stamped(data, self.newest_ns + self.offset_ns)
        fault, hit = self.fault, self.generator.random() < _SHARE
        if fault == 'dropped' and hit:
            return
        if fault == 'held back' and hit:
            self._held.append(data)
            return
        self._send(damaged(data) if fault == 'not a number' and hit else data)
        if fault == 'doubled' and hit:
            self._send(data)

    def _send(self, data):
        self._force.publish(data)
        self.sent['force'] += 1


class SecondSensor(Node):
    """Publishes another force for some time."""

    def __init__(self, **options):
        super().__init__('second_sensor', **options)
        self._force = self.create_publisher(WrenchStamped, 'force', qos.FORCE)

    @property
    def listeners(self):
        return self._force.get_subscription_count()

    def speak(self, first_ns, count):
        axis = messages.AXES['z']
        for index in range(count):
            stamp_ns = first_ns + index * 2_000_000 + 500_000
            force = -20.0 + 0.1 * index
            self._force.publish(
                messages.force_message(stamp_ns, force, axis, MESSAGE_TYPES, 'force_sensor')
            )


def stamped(data, stamp_ns):
    """The bytes of a message with another stamp; rclpy writes them little-endian."""
    return data[:4] + struct.pack('<iI', *divmod(stamp_ns, 10**9)) + data[12:]


def damaged(data):
    """The bytes of a WrenchStamped whose force is not a number: six numbers stand at its end."""
    return data[:-32] + struct.pack('<d', math.nan) + data[-24:]


def subscriptions_of(node):
    """Subscriptions of a node, and of the one that hears for it, if there is one."""
    listener = getattr(node, '_listener', None)
    return [*node.subscriptions, *(listener.subscriptions if listener else ())]


class Laboratory:
    """Plant, link, identifier and recorder on the executor of `graph`, in simulated time."""

    def __init__(self, graph, folder: Path, rate, estimator, seed):
        self.graph, self.folder, self.rate, self.estimator = graph, folder, rate, estimator
        self.generator = random.Random(seed)
        self.now_ns, self.sequence = START_NS, 0
        self.restarts, self.recordings, self.named = Counter(), [], Counter()
        self.totals = Counter()
        self.link = graph.add(lambda **options: Link(self.generator, **options))
        self.link.tell_time(self.now_ns)
        self.plant = None
        self.start_plant()
        self.start_recording()

    def start_plant(self):
        """Start the plant, anew if there was one: its muscle is at rest again."""
        if self.plant is not None:
            self.graph.remove(self.plant)
            # What is gone must not pass for what comes: it would be sent to nobody.
            self.graph.wait_for(lambda: not self.link._given.get_subscription_count())
            self.link.give_anew()
            self.restarts['plant'] += 1
        arguments = ['--ros-args', '-r', 'force:=force_true', '-r', 'pulses:=pulses_given']
        self.plant = self.graph.add(
            lambda **options: CountingPlant(cli_args=arguments, **options),
            use_sim_time=True,
            rate=self.rate,
            noise=0.05,
            publication_delay=0.0,
            minimum_subscribers=1,
        )
        self._plant_given = self.link.given
        self.graph.wait_for(lambda: self.link._given.get_subscription_count() == 1)
        self.graph.wait_for(lambda: self._repeated(lambda: self.plant._begun))

    def start_recording(self):
        """Start identifier and recorder, whose lives are the same: replay begins with both."""
        self.sent_before = Counter(self.link.sent)
        path = self.folder / f'session_{len(self.recordings)}'
        self.recordings.append(path)
        self.identifier = self.graph.add(CountingIdentifier, estimator=self.estimator)
        self.recorder = self.graph.add(Recorder, path=str(path))
        self.graph.wait_for(lambda: self.link._force.get_subscription_count() == 2)
        # A publisher that knows of a subscription is not yet known to it.
        for node in (self.identifier, self.recorder):
            for one in subscriptions_of(node):
                self.graph.wait_for(lambda one=one: one.get_publisher_count() > 0)
        self.graph.wait_for(lambda: self.link._pulses.get_subscription_count() == 2)
        self.graph.wait_for(lambda: self.identifier._estimate.get_subscription_count() > 0)

    def end_recording(self):
        """Let both end; count what went through them."""
        counts = self.recorder.counts
        self.graph.wait_for(lambda: counts['estimate'] == self.identifier.said)
        for name in ('pulses', 'force'):
            self.totals[f'{name} sent'] += self.sent()[name]
            self.totals[f'{name} heard'] += self.identifier.heard[name]
        self.totals['estimates said'] += self.identifier.said
        self.named.update(self.identifier.stream.fault_counts)
        self.graph.remove(self.recorder)
        self.graph.remove(self.identifier)
        for publisher in (self.link._force, self.link._pulses):
            self.graph.wait_for(lambda one=publisher: not one.get_subscription_count())
        self.link.speak()

    def restart_recording(self):
        self.end_recording()
        self.start_recording()
        self.restarts['identifier and recorder'] += 1

    def sent(self):
        return self.link.sent - self.sent_before

    def step(self, fault):
        """Simulate half a second, with a fault or without."""
        self.link.begin_step(fault)
        # What was held back comes before what follows, whichever topic it is on.
        self.graph.wait_for(self._everything_heard)
        end_ns = self.now_ns + STEP_NS
        for onset_ns in range(self.now_ns, end_ns, PULSE_PERIOD_NS):
            self.link.give(Pulse(onset_ns, self.generator.random(), self.sequence))
            self.sequence += 1
        self.graph.wait_for(self._everything_heard)
        self.now_ns = end_ns
        self.graph.wait_for(lambda: self._repeated(lambda: self.link.newest_ns >= end_ns))
        self.graph.wait_for(self._everything_heard)
        if fault == SECOND_SENSOR:
            self._second_sensor()

    def _second_sensor(self):
        second = self.graph.add(SecondSensor)
        self.graph.wait_for(lambda: second.listeners == 2)
        second.speak(self.now_ns + self.link.offset_ns - STEP_NS, 100)
        self.link.sent['force'] += 100
        self.graph.wait_for(self._everything_heard)
        self.graph.remove(second)

    def _repeated(self, predicate):
        """Tell the time again, which is sent best effort, and look."""
        self.link.tell_time(self.now_ns)
        return predicate()

    def _everything_heard(self):
        sent, counts = self.sent(), self.recorder.counts
        return (
            self.plant.heard == self.link.given - self._plant_given
            and all(self.identifier.heard[name] == sent[name] for name in ('pulses', 'force'))
            and all(counts[name] == sent[name] for name in ('pulses', 'force'))
        )
