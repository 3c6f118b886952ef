"""A stimulator of the Rapid2 class on a serial line.

The frames are those that users of these devices have published: a command letter, its data and a
check byte, the complement of the sum of the bytes before it; the device echoes the letter, adds
its status and its data, and a check byte.  9600 baud, 8 data bits, no parity.

This has been tested against a simulated instrument on a pseudo-terminal only.  It has not met
hardware: hold it against the manual of your device before a coil is connected.
"""

import math
import threading
import time
from collections.abc import Callable

import serial

from rpms_ros.stimulation.devices.interface import Delivery
from rpms_ros.stimulation.devices.interface import DeviceError
from rpms_ros.stimulation.devices.interface import DeviceStatus
from rpms_ros.stimulation.devices.interface import Shares
from rpms_ros.stimulation.devices.interface import TooLate
from rpms_ros.stimulation.devices.interface import quantized_down

BAUD = 9600
_TIMEOUT_S = 0.15
# three bytes of ten bits each
_FRAME_NS = round(3 * 10 / BAUD * 1e9)
_STATUS_BYTES, _TEMPERATURE_BYTES = 3, 9

# bits of the status byte
ARMED = 0x02
READY = 0x04
COIL_PRESENT = 0x08
REPLACE_COIL = 0x10
ERROR = 0x20
REMOTE = 0x80

ENABLE, DISABLE = b'Q@', b'R@'
DISARM, ARM, FIRE = b'EA', b'EB', b'EH'
TEMPERATURE = b'F@'


def framed(body: bytes) -> bytes:
    """Return a frame: the body and its check byte."""
    return body + bytes([~sum(body) & 0xFF])


def power(intensity: float) -> bytes:
    """Return the command that sets an intensity (share 0..1), in whole percent downwards."""
    return b'@%03d' % round(100 * quantized_down(intensity, 100))


class SerialDevice:
    """One stimulator on one serial line.

    The device knows whole percents: an intensity is rounded downwards.

    Parameters
    ----------
    port : str
        Name of the serial port, e.g. ``/dev/ttyUSB0``.
    clock : callable
        Monotonic time [ns].
    timeout_s : float
        How long an answer may take [s].
    """

    def __init__(
        self,
        port: str,
        clock: Callable[[], int] = time.monotonic_ns,
        timeout_s: float = _TIMEOUT_S,
    ) -> None:
        self._port = port
        self._timeout_s = timeout_s
        self._owed = 0
        self._clock = clock
        self._line: serial.Serial | None = None
        self._percent = -1
        # held for one exchange; disarming does not wait for it
        self._exchange = threading.Lock()
        self._count = threading.Lock()
        self._silenced = threading.Event()

    @property
    def real(self) -> bool:
        """True: a coil hangs on it."""
        return True

    @property
    def arm_s(self) -> float:
        """Longest time that the exchanges of arming may take [s]."""
        return 2 * self._timeout_s

    @property
    def prepare_s(self) -> float:
        """Longest time of an exchange [s]."""
        return self._timeout_s

    @property
    def trigger_s(self) -> float:
        """Time that the frame of a trigger takes on the line [s]."""
        return _FRAME_NS / 1e9

    def quantized(self, intensity: Shares) -> Shares:
        """Return the largest whole percents that are not above ``intensity`` (share)."""
        return quantized_down(intensity, 100)

    def open(self) -> None:
        """Connect, take remote control, intensity zero."""
        try:
            self._line = serial.Serial(
                self._port,
                BAUD,
                timeout=self._timeout_s,
                write_timeout=self._timeout_s,
                exclusive=True,
            )
            self._line.reset_input_buffer()
            self._owed = 0
        except (serial.SerialException, OSError, ValueError) as error:
            raise DeviceError(f'expected a serial port, got {self._port}: {error}') from error
        status = self._ask(ENABLE)
        if not status & REMOTE:
            raise DeviceError(f'expected remote control, got status {status:#04x}')
        self._ask(DISARM)
        self._set_percent(0)

    def arm(self) -> DeviceStatus:
        """Charge, at intensity zero; refused while the device reports an error or no coil."""
        self._silenced.clear()
        self._set_percent(0)
        status = self._ask(ARM)
        if status & (ERROR | REPLACE_COIL) or not status & COIL_PRESENT or not status & ARMED:
            self.silence()
            raise DeviceError(f'expected an armed device with a coil, got status {status:#04x}')
        return _as_status(status)

    def rest(self) -> None:
        """Set intensity zero."""
        if not self._silenced.is_set():
            self._set_percent(0)

    def silence(self) -> None:
        """Set intensity zero, then disarm; written at once, no answer is waited for."""
        self._silenced.set()
        self._percent = -1
        line = self._line
        if line is None:
            return
        try:
            line.write(framed(power(0.0)) + framed(DISARM))
            with self._count:
                self._owed += 2 * _STATUS_BYTES
        except (serial.SerialException, OSError) as error:
            raise DeviceError(f'expected a device to disarm, got {error}') from error

    def close(self) -> None:
        """Disarm, give back remote control, let go of the port."""
        line = self._line
        if line is None:
            return
        try:
            self.silence()
            line.write(framed(DISABLE))
            line.flush()
        except (serial.SerialException, OSError) as error:
            raise DeviceError(f'expected a device to close, got {error}') from error
        finally:
            self._line = None
            line.close()

    def keep_alive(self) -> DeviceStatus:
        """Ask anything: every exchange is a sign of life."""
        status = _as_status(self._ask(ENABLE))
        reply = self._exchanged(TEMPERATURE)
        try:
            return status._replace(temperature=int(reply[2:5]) / 10)
        except ValueError as error:
            raise DeviceError(f'expected a temperature, got {reply!r}') from error

    def beat(self) -> None:
        """Nobody is told."""

    def prepare(self, intensity: float, spare_s: float = math.inf) -> None:
        """Set the intensity of the next pulse, so that only the trigger is left to send."""
        del spare_s
        if not self._silenced.is_set():
            self._set_percent(round(100 * self.quantized(intensity)))

    def fire(
        self, intensity: float, width_s: float, latest_ns: int | None = None
    ) -> Delivery | None:
        """Trigger; the device has one width."""
        del intensity, width_s
        if latest_ns is not None and self._clock() > latest_ns:
            raise TooLate(f'expected a trigger until {latest_ns} ns, got one at {self._clock()}')
        if self._silenced.is_set():
            return None
        # the device fires when it has the whole frame
        onset_ns = self._clock() + _FRAME_NS
        percent = self._percent
        status = self._ask(FIRE)
        if not status & ARMED:
            return None
        if status & (ERROR | REPLACE_COIL) or not status & COIL_PRESENT or not status & READY:
            raise DeviceError(f'expected a ready device with a coil, got status {status:#04x}')
        unverified = frozenset(('delivery', 'intensity'))
        return Delivery(onset_ns, percent / 100, unverified)

    def _set_percent(self, percent: int) -> None:
        if percent != self._percent:
            self._ask(b'@%03d' % percent)
            self._percent = percent

    def _ask(self, body: bytes) -> int:
        """Send a command; return the status byte of its answer."""
        return self._exchanged(body)[1]

    def _read_owed(self, line: serial.Serial) -> None:
        """Read the answers to disarmings, which nobody has waited for."""
        with self._count:
            owed, self._owed = self._owed, 0
        if owed:
            line.read(owed)

    def _exchanged(self, body: bytes) -> bytes:
        letter = body[:1]
        length = _TEMPERATURE_BYTES if body == TEMPERATURE else _STATUS_BYTES
        line = self._line
        if line is None:
            raise DeviceError('expected an open serial line, got a closed one')
        try:
            with self._exchange:
                self._read_owed(line)
                line.write(framed(body))
                reply: bytes = line.read(length)
        except (serial.SerialException, OSError) as error:
            raise DeviceError(f'expected an answer from {self._port}, got {error}') from error
        if len(reply) != length or reply[:1] != letter or framed(reply[:-1]) != reply:
            raise DeviceError(
                f'expected {length} bytes that begin with {letter!r} and a check byte that fits '
                f'from {self._port}, got {reply!r}'
            )
        return reply


def _as_status(status: int) -> DeviceStatus:
    """Return what a status byte says."""
    return DeviceStatus(
        armed=bool(status & ARMED),
        ready=bool(status & READY),
        coil_present=bool(status & COIL_PRESENT),
        replace_coil=bool(status & REPLACE_COIL),
        error=bool(status & ERROR),
    )
