# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Cost of the live page at 1 kHz, and losses of a recording made at the same time.

A simulated session as `rpms demo --live` starts it.  Beside it runs a plain rclpy node that hears
the same topics and does nothing, in the quickest executor.  The target is at most 5 % of a core
with a browser that draws every frame, DDS included, and nothing lost.  Processor time on a machine
with other work counts for more than on a free one: the plain node, in the same run, says how much.

python bench/live_page.py [--duration 20]
"""

import argparse
import asyncio
import json
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from tornado.websocket import websocket_connect

from rpms_ros.nodes.simulation_launcher import IDENTIFIER, LIVE_PAGE, PLANT, SimulationLauncher
from rpms_ros.stimulation import paper_random

FORCE_RATE = 1000.0
LARGEST_LOAD = 0.05
LISTENER = """
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rpms_msgs.msg import DriverStatus, MuscleEstimate, Pulse
from rpms_ros.nodes import qos, topics
rclpy.init()
node, executor = Node('listener'), EventsExecutor()
for kind, name in ((WrenchStamped, topics.FORCE), (Pulse, topics.PULSES),
                   (MuscleEstimate, topics.ESTIMATE), (DriverStatus, topics.DRIVER_STATUS)):
    node.create_subscription(kind, name, lambda message: None, qos.VIEW)
executor.add_node(node)
while True:
    executor.spin_once(timeout_sec=0.1)
"""


DDS = 'dds.'


def processor_time(process: int) -> dict[str, float]:
    """Processor time of a process so far, user and system [s]: all of it, and of DDS's threads."""
    spent = {'all': 0.0, DDS: 0.0}
    for task in Path(f'/proc/{process}/task').iterdir():
        name, _, rest = (task / 'stat').read_text().partition('(')[2].rpartition(')')
        fields = rest.split()
        seconds = (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
        spent['all'] += seconds
        spent[DDS] += seconds if name.startswith(DDS) else 0.0
    return spent


class Browser(threading.Thread):
    """A browser that draws at once: takes a frame, asks for the next."""

    def __init__(self, url: str) -> None:
        super().__init__(daemon=True)
        self._url = url
        self.frames: list[float] = []
        self.bytes = 0
        self.curve_at = 0.0
        self.closing = False

    def run(self) -> None:
        asyncio.run(self._draw())

    async def _draw(self) -> None:
        stream = await websocket_connect(self._url)
        while not self.closing:
            text = await stream.read_message()
            if text is None:
                return
            self.frames.append(time.monotonic())
            self.bytes += len(text)
            if not self.curve_at and (json.loads(text).get('estimate') or {}).get('curve'):
                self.curve_at = time.monotonic()
            await stream.write_message('n')
        stream.close()


def never_reads(port: int) -> socket.socket:
    """A connection that never reads its frames."""
    raw = socket.create_connection(('127.0.0.1', port))
    raw.sendall(
        b'GET /stream HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n'
        b'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n'
    )
    return raw


def free_port() -> int:
    """A port that was free a moment ago."""
    with socket.create_server(('127.0.0.1', 0)) as bound:
        port: int = bound.getsockname()[1]
        return port


def cores(launcher: SimulationLauncher, pids: dict[str, int], span: float) -> dict[str, float]:
    """Cores that each process, and DDS in the page, takes over the next `span` seconds."""
    begun = time.monotonic()
    before = {name: processor_time(pid) for name, pid in pids.items()}
    launcher.step(span)
    passed = time.monotonic() - begun
    after = {name: processor_time(pid) for name, pid in pids.items()}
    loads = {name: (after[name]['all'] - before[name]['all']) / passed for name in pids}
    return loads | {DDS: (after['page'][DDS] - before['page'][DDS]) / passed}


def connected(launcher: SimulationLauncher, port: int) -> Browser:
    """The first browser, as soon as the page answers."""
    while True:
        try:
            socket.create_connection(('127.0.0.1', port)).close()
            break
        except ConnectionRefusedError:
            launcher.step(0.05)
    browser = Browser(f'ws://127.0.0.1:{port}/stream')
    browser.start()
    return browser


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--duration', type=float, default=20.0, help='seconds of each part')
    span = parser.parse_args(argv).duration
    port = free_port()
    parameters: dict[str, dict[str, object]] = {
        PLANT: {'rate': FORCE_RATE, 'noise': 0.02, 'publication_delay': 0.05},
        IDENTIFIER: {'estimator': 'tracking'},
        LIVE_PAGE: {'port': port},
    }
    schedule = paper_random(4.0 * span + 30.0)
    begun = time.monotonic()
    with (
        tempfile.TemporaryDirectory() as folder,
        SimulationLauncher(Path(folder) / 'session', parameters, schedule) as launcher,
    ):
        browser = connected(launcher, port)
        while not browser.curve_at:
            launcher.step(0.05)
        first_curve = browser.curve_at - begun
        domain = launcher.monitor.context.get_domain_id()
        environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
        listener = subprocess.Popen([sys.executable, '-c', LISTENER], env=environment)
        pids = {'page': launcher.processes[LIVE_PAGE].pid, 'listener': listener.pid}
        launcher.step(3.0)
        try:
            browser.frames.clear()
            browser.bytes = 0
            drawn = cores(launcher, pids, span)
            count, size = len(browser.frames), browser.bytes
            gaps = [b - a for a, b in zip(browser.frames, browser.frames[1:], strict=False)]
            browser.closing = True
            browser.join()
            alone = cores(launcher, pids, span)
            held = [never_reads(port) for _ in range(10)]
            stuck = cores(launcher, pids, span)
            for one in held:
                one.close()
        finally:
            listener.kill()
            listener.wait()
        launcher.stop()
        counts = launcher.recorder.counts
        lost = launcher.recorder.lost.get('force', 0)
        samples = counts['force']
    print(f'live page, {FORCE_RATE:.0f} Hz, {span:g} s each')
    for name, load in (
        ('one browser', drawn),
        ('no browser', alone),
        ('ten that never read', stuck),
    ):
        print(
            f'  {name:<20} page {load["page"]:6.3f} cores, {load[DDS]:6.3f} of them DDS; '
            f'plain rclpy node {load["listener"]:6.3f} cores'
        )
    print(f'  with a browser {drawn["page"]:.3f} cores (target < {LARGEST_LOAD})')
    print(
        f'  frames {count / span:.1f} a second, {size / span / 1000:.1f} kB/s, '
        f'longest gap {1000 * max(gaps):.0f} ms, median {1000 * statistics.median(gaps):.0f} ms'
    )
    print(f'  first curve after {first_curve:.1f} s (target < 120)')
    print(f'  recording beside it: {samples} samples, lost {lost} (target 0)')
    return 0 if drawn['page'] < LARGEST_LOAD and not lost and first_curve < 120.0 else 1


if __name__ == '__main__':
    sys.exit(main())
