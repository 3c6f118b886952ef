# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""An instrument of the Rapid2 class on a pseudo-terminal: the oracle of the tests of the driver.

Written from what users of the class have published, sharing no code with the package.  It logs
every trigger with its time and intensity, whatever it answers.  Run by itself it prints the name
of its port, and appends its log to a file:

    python test/fake_rapid2.py --log FILE [--wire] [--watchdog 1.0] [--charge 0.02]

Times are those of CLOCK_MONOTONIC in nanoseconds, which all processes of a machine share.
"""

import argparse
import contextlib
import os
import select
import signal
import sys
import threading
import time
from pathlib import Path

STANDBY, ARMED, READY, COIL, REPLACE, ERROR, ERROR_TYPE, REMOTE = (1 << bit for bit in range(8))
LENGTHS = {'@': 5, 'E': 3, 'Q': 3, 'R': 3, 'F': 3, 'N': 3, '\\': 3}
SECOND = 1_000_000_000
# a byte at 9600 baud: start bit, eight data bits, stop bit
BYTE_NS = 10 * SECOND // 9600
# a frame that stays unfinished for so long is forgotten
FORGET_NS = 100_000_000


def check(body):
    return bytes([255 - sum(body) % 256])


class FakeRapid2(threading.Thread):
    """Plays the instrument.  What it does wrong are attributes, to be set at any moment.

    coil, replace, error : its status bits
    acknowledge_only : answers triggers and gives none
    refuse : command -> letter it is refused with
    hang : takes bytes, does nothing until it is false again
    flip : flips a bit of every answer
    cut : cuts every answer to so many bytes
    silent : obeys, answers nothing
    deaf : answers as if it took an intensity, and keeps the one it has
    obey_disarm : whether it obeys when it is told to disarm
    meddle : called with each command after it was answered, and with b'before ' and it before
    """

    def __init__(self, wire=False, watchdog_s=1.0, charge_s=0.02, version='7.1.0', log=None):
        super().__init__(daemon=True)
        self.master, slave = os.openpty()
        self.port = os.ttyname(slave)
        # nobody but the driver has it open: it could not be held exclusively otherwise
        os.close(slave)
        os.set_blocking(self.master, False)
        self.wire, self.version = wire, version
        self.watchdog_ns = round(watchdog_s * SECOND)
        self.charge_ns = round(charge_s * SECOND)
        self.coil, self.replace, self.error = True, False, False
        self.remote = self.armed = False
        # what such an instrument has when it is switched on
        self.percent = 30
        self.temperatures = '253', '251'
        self.acknowledge_only = self.hang = self.flip = self.silent = self.deaf = False
        self.meddle = None
        self.obey_disarm = True
        self.refuse, self.cut = {}, None
        self.triggers, self.commands, self.disarmed = [], [], []
        self._ready_ns = self._heard_ns = self._frame_ns = 0
        self._pending, self._frame = [], b''
        self._hung_ns = 0
        self._in_free_ns = self._out_free_ns = 0
        self._due = []
        self._log = log
        self._wake_out, self._wake_in = os.pipe()
        self._running = True

    # ---- what tests do to it

    @property
    def frames(self):
        return [body for _, body in self.commands]

    def fired(self):
        return [percent for _, percent in self.triggers]

    def self_disarm(self):
        self._disarm('by itself')

    def foreign(self, body, answered=True):
        """A frame of somebody else on the line, obeyed at once."""
        answer = self._obey(body + check(body), time.monotonic_ns())
        if answered:
            self._send(answer, time.monotonic_ns())

    def noise(self, raw):
        self._send(raw, time.monotonic_ns())

    def vanish(self):
        """The cable is pulled: the driver's reads and writes fail from now on."""
        self.close()

    def close(self):
        if self._running:
            self._running = False
            os.write(self._wake_in, b'.')
            if self.is_alive():
                self.join()
            for descriptor in (self.master, self._wake_in, self._wake_out):
                os.close(descriptor)

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.close()

    # ---- the line

    def run(self):
        while self._running:
            now = time.monotonic_ns()
            self._look_at_the_watchdog(now)
            self._do_what_is_due(now)
            soonest = min([when for when, _, _ in self._due], default=now + SECOND)
            pause = 0 if self._pending and not self.hang else min(20_000_000, soonest - now)
            readable = select.select([self.master, self._wake_out], [], [], max(0, pause) / SECOND)
            if self.master in readable[0]:
                try:
                    self._take(os.read(self.master, 4096), time.monotonic_ns())
                except OSError:
                    # nobody has the port open
                    time.sleep(0.001)

    def _take(self, raw, now):
        if not self.wire:
            self._pending += [(now, raw[n : n + 1]) for n in range(len(raw))]
            return
        for byte in raw:
            self._in_free_ns = max(now, self._in_free_ns) + BYTE_NS
            self._due.append((self._in_free_ns, 'in', bytes([byte])))

    def _do_what_is_due(self, now):
        due = [item for item in self._due if item[0] <= now]
        self._due = [item for item in self._due if item[0] > now]
        for when, way, raw in sorted(due):
            if way == 'in':
                self._pending.append((when, raw))
            else:
                self._write(raw)
        if self.hang:
            self._hung_ns = now
        while self._pending and not self.hang:
            when, byte = self._pending.pop(0)
            # when it was on the line, or when the instrument went on
            self._byte(byte, max(when, self._hung_ns))

    def _byte(self, byte, now):
        if self._frame and now - self._frame_ns > FORGET_NS:
            self._frame = b''
        self._frame, self._frame_ns = self._frame + byte, now
        length = LENGTHS.get(chr(self._frame[0]))
        if length is None:
            self._frame = b''
            self._send(b'?', now)
        elif len(self._frame) == length:
            frame, self._frame = self._frame, b''
            if self.meddle:
                self.meddle(b'before ' + frame[:-1])
            self._send(self._obey(frame, now), now)
            if self.meddle:
                self.meddle(frame[:-1])

    def _send(self, answer, now):
        if self.silent or not answer:
            return
        if self.flip:
            answer = bytes([answer[0], answer[1] ^ READY]) + answer[2:]
        answer = answer[: self.cut]
        if self.wire:
            self._out_free_ns = max(now, self._out_free_ns) + BYTE_NS * len(answer)
            self._due.append((self._out_free_ns, 'out', answer))
        else:
            self._write(answer)

    def _write(self, answer):
        # nobody may have the port open
        with contextlib.suppress(OSError):
            os.write(self.master, answer)

    # ---- the instrument

    def _status(self, now):
        if not self.armed:
            state = STANDBY
        elif now >= self._ready_ns:
            state = READY
        else:
            state = ARMED
        flags = [(self.coil, COIL), (self.replace, REPLACE), (self.error, ERROR)]
        flags += [(self.error, ERROR_TYPE), (self.remote, REMOTE)]
        return state | sum(bit for is_set, bit in flags if is_set)

    def _obey(self, frame, now):
        body, letter = frame[:-1], frame[:1]
        self.commands.append((now, body))
        self._note('frame', now, body.decode('latin-1'))
        if check(body) != frame[-1:]:
            return letter + b'?' + check(letter + b'?')
        refusal = self.refuse.get(body) or self.refuse.get(letter)
        if body in (b'Q@', b'R@'):
            self.remote = body == b'Q@'
            if not self.remote:
                self._disarm('remote control given back')
        before, data = self._status(now), b''
        if refusal is None:
            refusal, data = self._act(body, now)
        if refusal is not None:
            return letter + refusal + check(letter + refusal)
        if body == b'ND':
            answer = b'N' + self.version.encode() + b'\0'
            return answer + check(answer)
        if self.armed:
            self._heard_ns = now
        # the status before the command, as published
        answer = letter + bytes([before]) + data
        return answer + check(answer)

    def _act(self, body, now):
        """Obey; return what it is refused with, and the data of the answer."""
        letter = body[:1]
        if body == b'EA':
            if self.obey_disarm:
                self._disarm('was told to')
        elif letter == b'F':
            return None, ''.join(self.temperatures).encode()
        elif letter in b'QR':
            return None, b''
        elif not self.remote:
            return b'S', b''
        elif letter == b'@':
            return self._set(body[1:]), b''
        elif letter == b'\\':
            return None, self._parameters()
        elif letter == b'E':
            return self._arm_or_trigger(body, now), b''
        return None, b''

    def _arm_or_trigger(self, body, now):
        if body == b'EB' and not self.armed:
            self.armed, self._ready_ns, self._heard_ns = True, now + self.charge_ns, now
            return None
        if body == b'EH' and self.armed and now >= self._ready_ns:
            self._trigger(now)
            return None
        return b'S' if body in (b'EB', b'EH') else b'?'

    def _set(self, digits):
        if not digits.isdigit():
            return b'?'
        if int(digits) > 100:
            return b'S'
        if not self.deaf:
            self.percent = int(digits)
        return None

    def _parameters(self):
        major = int(self.version.split('.')[0])
        # mode, intensity, rate, pulses, duration, wait
        widths = (5, 4, 4) if major >= 9 else (4, 3, 4) if major >= 7 else (4, 3, 3)
        pulses, duration, wait = (f'{1:0{width}d}' for width in widths)
        return b'\x38' + f'{self.percent:03d}0010{pulses}{duration}{wait}'.encode()

    def _trigger(self, now):
        if not self.acknowledge_only:
            self.triggers.append((now, self.percent))
            self._note('trigger', now, str(self.percent))

    def _disarm(self, why):
        if self.armed:
            self.armed = False
            now = time.monotonic_ns()
            self.disarmed.append((now, why))
            self._note('disarmed', now, why)

    def _look_at_the_watchdog(self, now):
        if self.armed and now - self._heard_ns > self.watchdog_ns:
            self._disarm('watchdog')
            self.remote = False

    def _note(self, kind, when, text):
        if self._log:
            with self._log.open('a', encoding='utf-8') as file:
                file.write(f'{kind} {when} {text}\n')


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--log', type=Path, required=True)
    parser.add_argument('--wire', action='store_true', help='take the time of 9600 baud')
    parser.add_argument('--watchdog', type=float, default=1.0, help='[s]')
    parser.add_argument('--charge', type=float, default=0.02, help='[s]')
    options = parser.parse_args()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    with FakeRapid2(options.wire, options.watchdog, options.charge, log=options.log) as fake:
        print(fake.port, flush=True)
        ended.wait()


if __name__ == '__main__':
    sys.exit(main())
