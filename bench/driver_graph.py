# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A live graph for measurements of the driver: processes, load, and a node that watches."""

import contextlib
import multiprocessing
import os
import subprocess
import sys
import time

from rpms_ros.nodes.common.runner import free_domain, use_fast_discovery

START = 'import sys; from rpms_ros.nodes.{} import main; sys.exit(main())'


def burn():
    while True:
        sum(range(10_000))


@contextlib.contextmanager
def load(processes):
    """Keep controllers busy with so many processes."""
    running = [multiprocessing.Process(target=burn, daemon=True) for _ in range(processes)]
    for process in running:
        process.start()
    try:
        yield
    finally:
        for process in running:
            process.terminate()
            process.join()


@contextlib.contextmanager
def graph(nodes, code=''):
    """Start nodes, each a process, in a domain of their own; yield an rclpy context in it.

    ``nodes`` maps a module of rpms_ros.nodes to its parameters; ``code`` is run instead, if given.
    """
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    use_fast_discovery()
    import rclpy

    with free_domain() as domain:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        started = [start(name, parameters, code) for name, parameters in nodes.items()]
        rclpy.init(args=[], domain_id=domain)
        try:
            yield
        finally:
            for process in started:
                process.terminate()
                process.wait(10)
            rclpy.try_shutdown()


def start(name, parameters, code=''):
    """Start a node as a process, by its module or by a program text."""
    values = [f'{key}:={value}' for key, value in parameters.items()]
    arguments = [argument for value in values for argument in ('-p', value)]
    return subprocess.Popen(
        [sys.executable, '-c', code or START.format(name), '--ros-args', *arguments],
        stderr=subprocess.DEVNULL,
    )


def spin_until(executor, predicate, timeout_s):
    """Step until the predicate holds; raise TimeoutError if it does not in time."""
    end = time.monotonic() + timeout_s
    while not predicate():
        if time.monotonic() > end:
            raise TimeoutError(f'expected an event within {timeout_s} s, got none')
        executor.spin_once(timeout_sec=0.005)


def spread(values, unit=1.0):
    """Return median, 99th percentile and maximum in words."""
    ordered = sorted(value * unit for value in values)
    last = len(ordered) - 1
    return ' '.join(
        f'{name} {ordered[round(share * last)]:.2f}'
        for name, share in (('median', 0.5), ('p99', 0.99), ('max', 1.0))
    )
