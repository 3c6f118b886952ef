# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""CONTRIBUTING.md names the modules that a pulse and a force sample pass, in their order."""

import re
import sys
import threading
from pathlib import Path
from types import FrameType

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from numba.core.dispatcher import Dispatcher
from rclpy.action import ActionClient
from rclpy.node import Node

import rpms_ros
from rpms_msgs.action import RunSchedule
from rpms_msgs.msg import MuscleEstimate, Pulse, Schedule, ScheduleSegment
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.identifier import Identifier
from rpms_ros.nodes.stimulator_driver import StimulatorDriver
from rpms_ros.stimulation.devices.rapid2 import SerialDevice

PACKAGE = f'{Path(rpms_ros.__file__).parent}/'
PAGE = (Path(__file__).parents[2] / 'CONTRIBUTING.md').read_text(encoding='utf-8')
MILLISECOND = 1_000_000


class Rehearsed(SerialDevice):
    """The device on a serial line, of which a driver asks no more than of a simulated one."""

    real = False
    sets_width = True


def name_of(path: str) -> str:
    """Return a module of the package as the page writes it: `stimulation/limits/limiter`."""
    return path.removeprefix(PACKAGE).removesuffix('.py').removesuffix('/__init__')


class Tracer:
    """Notes which modules of the package run, thread by thread.

    A thread counts from the moment in which it enters one of `begins` for as long as it is in it.
    """

    def __init__(self, *begins: str) -> None:
        self.begins = begins
        self.passed: dict[str, list[str]] = {}
        self.calls: set[tuple[str, str]] = set()
        self.inside: dict[str, FrameType | None] = {}
        self.on = False

    def __call__(self, frame, event, _argument) -> None:
        if not self.on or not frame.f_code.co_filename.startswith(PACKAGE):
            return
        thread, name = threading.current_thread().name, name_of(frame.f_code.co_filename)
        if event == 'call':
            if f'{name}:{frame.f_code.co_name}' in self.begins:
                self.inside[thread] = self.inside.get(thread) or frame
            self.note(name, frame.f_back)
        elif event == 'return' and self.inside.get(thread) is frame:
            self.inside[thread] = None

    def note(self, name: str, caller: FrameType | None) -> None:
        thread = threading.current_thread().name
        if self.on and self.inside.get(thread):
            self.passed.setdefault(thread, []).append(name)
            while caller is not None and not caller.f_code.co_filename.startswith(PACKAGE):
                caller = caller.f_back
            if caller is not None:
                self.calls.add((name_of(caller.f_code.co_filename), name))

    def compiled(self, monkeypatch) -> None:
        """Note compiled functions where Python calls them."""
        for module in [m for n, m in sys.modules.items() if n.startswith('rpms_ros')]:
            for name, found in list(vars(module).items()):
                if isinstance(found, Dispatcher):
                    monkeypatch.setattr(module, name, self._noting(found))

    def _noting(self, function):
        name = name_of(function.py_func.__code__.co_filename)

        def call(*arguments):
            self.note(name, sys._getframe(1))
            return function(*arguments)

        return call


@pytest.fixture
def tracing():
    def begin(*begins):
        tracer = Tracer(*begins)
        threading.setprofile(tracer)
        sys.setprofile(tracer)
        return tracer

    yield begin
    sys.setprofile(None)
    threading.setprofile(None)


def compare(title: str, passed: list[str]) -> list[str]:
    """Compare the modules that ran with those of the page: in order, but for values.

    Returns those on the way.
    """
    (text,) = re.findall(rf'^\*\*{title}\*\*(.*?)(?=^\*\*|^## )', PAGE, re.MULTILINE | re.DOTALL)
    way, values = (
        re.findall(r'`([\w/]+)`', part) for part in re.split('^Values', text, flags=re.MULTILINE)
    )
    # the others are names of estimators, actions and the like
    way = [name for name in way if '/' in name or Path(PACKAGE, f'{name}.py').exists()]
    found = list(dict.fromkeys(passed))
    passed = [name for name in found if name not in values]
    assert passed == way, f'CONTRIBUTING.md, expected {passed}, got {way}'
    unused = set(values) - set(found)
    assert not unused, f'CONTRIBUTING.md, expected no value that is not used, got {unused}'
    return way


def test_a_force_sample(graph, tracing, monkeypatch):
    graph.add(Identifier)
    other = graph.add(lambda **options: Node('other', **options))
    forces = other.create_publisher(WrenchStamped, topics.FORCE, qos.FORCE)
    pulses = other.create_publisher(Pulse, topics.PULSES, qos.PULSES)
    estimates = []
    other.create_subscription(MuscleEstimate, topics.ESTIMATE, estimates.append, qos.ESTIMATE_KEPT)
    graph.wait_for(lambda: forces.get_subscription_count() and pulses.get_subscription_count())

    def send(first, last):
        for number in range(first, last):
            stamp = {'sec': number // 1000, 'nanosec': number % 1000 * MILLISECOND}
            if number % 50 == 0:
                pulse = Pulse(intensity=0.2 + number % 7 / 10, sequence=number // 50, width=1e-4)
                pulse.header.stamp.sec, pulse.header.stamp.nanosec = stamp.values()
                pulses.publish(pulse)
            force = WrenchStamped()
            force.header.stamp.sec, force.header.stamp.nanosec = stamp.values()
            force.wrench.force.z = 1.0 + float(np.sin(number / 30))
            forces.publish(force)

    # to the middle of a cell, so that what comes next is learnt from before it is in an estimate
    send(0, 3050)
    stamp = Time(sec=2, nanosec=799 * MILLISECOND)
    graph.wait_for(lambda: estimates and estimates[-1].header.stamp == stamp)
    tracer = tracing('nodes/identifier:_process')
    tracer.compiled(monkeypatch)
    before = len(estimates)
    tracer.on = True
    send(3050, 3250)
    graph.wait_for(lambda: len(estimates) > before)
    tracer.on = False
    way = compare('A force sample', tracer.passed['MainThread'])
    inside = [call for call in tracer.calls if set(call) <= set(way)]
    back = [call for call in inside if way.index(call[1]) < way.index(call[0])]
    assert back == [('identification/recursion/recursive', 'identification/quality/doubts')]


def test_a_pulse(graph, tracing, instrument, monkeypatch, tmp_path, patient_supervision):
    del patient_supervision
    fake = instrument(watchdog_s=20.0)

    def build(_options):
        return Rehearsed(fake.port, 1.0, timeout_s=5.0, beat_limit_s=20.0)

    monkeypatch.setattr('rpms_ros.stimulation.devices.simulated.build', build)
    tracer = tracing(
        'nodes/driver/goals:_on_accepted',
        'stimulation/driver/controller:step',
        'stimulation/driver/controller:reserve',
    )
    graph.add(
        StimulatorDriver,
        require_operator=False,
        require_stop_button=False,
        lateness_limit=0.1,
        ledger_folder=str(tmp_path / 'ledger'),
        audit_log=str(tmp_path / 'audit.jsonl'),
    )
    other = graph.add(lambda **options: Node('other', **options))
    changes = other.create_client(ChangeState, 'stimulator_driver/change_state')
    client = ActionClient(other, RunSchedule, topics.RUN_SCHEDULE)
    told = []
    other.create_subscription(Pulse, topics.PULSES, told.append, qos.PULSES)
    graph.wait_for(lambda: changes.service_is_ready() and client.server_is_ready())
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        future = changes.call_async(ChangeState.Request(transition=Transition(id=transition)))
        graph.wait_for(future.done)
        assert future.result().success
    single = ScheduleSegment(kind=ScheduleSegment.SINGLE, intensity=0.05, duration_s=1.0)
    goal = RunSchedule.Goal(typed_schedule=Schedule(name='one', segments=[single]))
    tracer.on = True
    client.send_goal_async(goal)
    # also what the owner of the device does once it has published the pulse
    graph.wait_for(lambda: told and not tracer.inside['owner_thread'])
    tracer.on = False
    assert len(fake.triggers) == 1
    threads = ('MainThread', 'owner_thread', 'ledger_thread')
    compare('A pulse', [name for thread in threads for name in tracer.passed[thread]])
