# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A driver without a controller: opens a port, arms, fires until something is wrong.

    python test/guarded_train.py PORT RATE_HZ BEAT_LIMIT_S ANSWER_LIMIT_S

It prints the process of its guard when it has fired for the first time, then what was wrong.
"""

import signal
import sys
import time

from rpms_ros.stimulation.devices.rapid2 import SerialDevice
from rpms_ros.stimulation.devices.registry import DeviceError, TooLate

SECOND = 1_000_000_000
INTENSITY = 0.4


def train(port, rate_hz, beat_limit_s, say, answer_limit_s=0.15):
    """Fire until the device says that something is wrong."""
    device = SerialDevice(port, timeout_s=answer_limit_s, beat_limit_s=beat_limit_s)
    try:
        device.open()
        device.arm()
        period = round(SECOND / rate_hz)
        due = time.monotonic_ns() + period
        told = False
        while True:
            device.prepare(INTENSITY, (due - time.monotonic_ns()) / SECOND - device.trigger_s)
            while (left := due - time.monotonic_ns()) > 0:
                device.beat()
                time.sleep(min(0.01, left / SECOND))
            try:
                device.fire(INTENSITY, 100e-6, due + period // 2)
            except TooLate:
                due = time.monotonic_ns()
            if not told:
                say(f'guard {device._line._guard.pid}')
                told = True
            due += period
    except DeviceError as error:
        device.silence()
        say(f'fault {time.monotonic_ns()} {error}')
    finally:
        device.close()


if __name__ == '__main__':
    # a shell in whose background the tests run has them ignore the first two, nohup the third
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGQUIT, signal.SIG_DFL)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    rate, beat_limit, answer_limit = map(float, sys.argv[2:])
    train(sys.argv[1], rate, beat_limit, lambda text: print(text, flush=True), answer_limit)
