# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses and force samples as arrays: the values that the parts of the package exchange.

Time is an integer number of nanoseconds since an epoch, as in ``header.stamp``: floating-point
seconds since 1970 resolve only 0.2 us, and sums of them depend on their order.
"""

import hashlib
import math
import struct
import threading
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

NANOSECONDS_PER_SECOND = 1_000_000_000
MAGNETIC_PULSE_WIDTH = 100e-6

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]


class Pulse(NamedTuple):
    """One stimulation pulse.

    Attributes
    ----------
    onset_ns : int
        Onset of the pulse [ns].
    intensity : float
        Share of the stimulator's maximum, 0..1.
    sequence : int
        Counter of the driver, +1 a pulse.
    width : float
        Duration [s].
    unverified : int
        Bits ``UNVERIFIED_*`` of rpms_msgs/Pulse: what the device could not confirm; 0 if nothing.
    """

    onset_ns: int
    intensity: float
    sequence: int = 0
    width: float = MAGNETIC_PULSE_WIDTH
    unverified: int = 0


def nanoseconds(seconds: float) -> int:
    """Return a duration [s] in whole nanoseconds."""
    return round(seconds * NANOSECONDS_PER_SECOND)


def stamps(seconds: FloatArray) -> IntArray:
    """Return times [s] in whole nanoseconds."""
    return np.rint(seconds * NANOSECONDS_PER_SECOND).astype(np.int64)


def _whole(name: str, values: npt.ArrayLike) -> IntArray:
    """Return whole numbers (n,) of any kind as int64; times of NumPy or pandas as nanoseconds.

    Raises
    ------
    ValueError
        If they are no whole numbers, or have another shape.
    """
    array = np.asarray(values)
    if array.dtype.kind == 'M':
        array = array.astype('datetime64[ns]')
    elif array.size and array.dtype.kind not in 'iu':
        raise ValueError(
            f'expected whole numbers in {name}, got {array.dtype}: seconds times 1e9, rounded, '
            'are nanoseconds'
        )
    return _in_one_row(name, array).astype(np.int64, copy=False)


def _real(name: str, values: npt.ArrayLike) -> FloatArray:
    """Return numbers (n,) of any kind as float64.

    Raises
    ------
    ValueError
        If they are no numbers, or have another shape.
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except TypeError as error:
        raise ValueError(f'expected numbers in {name}, got {values!r:.80}') from error
    return _in_one_row(name, array)


def _in_one_row(name: str, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    if array.ndim != 1:
        raise ValueError(f'expected {name} of shape (n,), got {array.shape}')
    return array


@dataclass(frozen=True)
class PulseTrain:
    """Pulses in the order in which they were given, as arrays of one length.

    Lists, Series of pandas and arrays of other kinds become the arrays below.

    Attributes
    ----------
    onset_ns : ndarray of int64, shape (pulses,)
        Onsets [ns].
    intensity : ndarray of float64, shape (pulses,)
        Shares of the maximum, 0..1.
    sequence : ndarray of int64, shape (pulses,)
        Counters of the driver.
    width : ndarray of float64, shape (pulses,)
        Durations [s].

    Raises
    ------
    ValueError
        If lengths differ, stamps are no whole numbers, or an array has several dimensions.
    """

    onset_ns: IntArray
    intensity: FloatArray
    sequence: IntArray
    width: FloatArray

    def __post_init__(self) -> None:
        for name in ('onset_ns', 'sequence'):
            object.__setattr__(self, name, _whole(name, getattr(self, name)))
        for name in ('intensity', 'width'):
            object.__setattr__(self, name, _real(name, getattr(self, name)))
        lengths = {len(values) for values in self._arrays}
        if len(lengths) != 1:
            raise ValueError(f'expected arrays of one length, got lengths {sorted(lengths)}')

    @property
    def _arrays(self) -> tuple[npt.NDArray[Any], ...]:
        return self.onset_ns, self.intensity, self.sequence, self.width

    def __len__(self) -> int:
        return len(self.onset_ns)

    def __getitem__(self, selected: slice | BoolArray | IntArray) -> 'PulseTrain':
        return PulseTrain(*(values[selected] for values in self._arrays))

    @classmethod
    def joined(cls, trains: list['PulseTrain']) -> 'PulseTrain':
        """Return the pulses of all trains, one train after the other."""
        parts = zip(*(train._arrays for train in trains), strict=True)
        return cls(*(np.concatenate(part) for part in parts))

    @classmethod
    def numbered(
        cls,
        onset_ns: IntArray,
        intensity: npt.ArrayLike,
        width: npt.ArrayLike = MAGNETIC_PULSE_WIDTH,
        first: int = 0,
    ) -> 'PulseTrain':
        """Return pulses whose numbers count up from `first`; one value may hold for all."""
        sequence = np.arange(first, first + len(onset_ns))
        shares, widths = (np.full(len(sequence), one) for one in (intensity, width))
        return cls(onset_ns, shares, sequence, widths)

    @classmethod
    def regular(
        cls,
        intensity: npt.ArrayLike,
        rate_hz: float,
        start_ns: int = 0,
        width: float = MAGNETIC_PULSE_WIDTH,
    ) -> 'PulseTrain':
        """Return pulses at a constant repetition rate (Eq. 29).

        Parameters
        ----------
        intensity : array_like, shape (pulses,)
            Shares of the maximum, 0..1.
        rate_hz : float
            Repetition rate [Hz].
        start_ns : int
            Onset of the first pulse [ns].
        width : float
            Duration of each pulse [s].

        Raises
        ------
        ValueError
            If the rate is not above zero.
        """
        if not (math.isfinite(rate_hz) and rate_hz > 0):
            raise ValueError(f'expected a repetition rate above 0 Hz, got {rate_hz}')
        values = np.asarray(intensity, dtype=np.float64)
        elapsed = np.rint(np.arange(len(values)) * (NANOSECONDS_PER_SECOND / rate_hz))
        return cls.numbered(start_ns + elapsed.astype(np.int64), values, width)

    @classmethod
    def of(cls, pulses: list[Pulse]) -> 'PulseTrain':
        """Return a train of single pulses."""
        names = ('onset_ns', 'intensity', 'sequence', 'width')
        return cls(*(np.array([getattr(pulse, name) for pulse in pulses]) for name in names))


@dataclass(frozen=True)
class ForceTrace:
    """Force samples in the order in which they were given; other kinds as in `PulseTrain`.

    Attributes
    ----------
    stamp_ns : ndarray of int64, shape (samples,)
        Times of the samples [ns].
    force : ndarray of float64, shape (samples,)
        Force along the measured axis [N].
    frame_id : str
        Name of the sensor's frame.

    Raises
    ------
    ValueError
        If lengths differ, stamps are no whole numbers, or an array has several dimensions.
    """

    stamp_ns: IntArray
    force: FloatArray
    frame_id: str = 'force_sensor'

    def __post_init__(self) -> None:
        object.__setattr__(self, 'stamp_ns', _whole('stamp_ns', self.stamp_ns))
        object.__setattr__(self, 'force', _real('force', self.force))
        if len(self.stamp_ns) != len(self.force):
            raise ValueError(
                f'expected as many stamps as forces, got {len(self.stamp_ns)} and '
                f'{len(self.force)}'
            )

    def __len__(self) -> int:
        return len(self.stamp_ns)


# Onset [ns], intensity, number and width [s], little-endian.
_RECORD = struct.Struct('<qdqd')
_SEQUENCES = 2**32


def _packed(onset_ns: int, intensity: float, sequence: int, width: float) -> bytes:
    return _RECORD.pack(onset_ns, intensity, sequence % _SEQUENCES, width)


class PulseHash:
    """Collects pulses as they are given; any thread may call it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._begin()

    def _begin(self) -> None:
        self._digest = hashlib.sha256()
        self._count = self._first_ns = 0

    def add(self, pulse: Pulse) -> None:
        """Take the next pulse."""
        record = _packed(pulse.onset_ns, pulse.intensity, pulse.sequence, pulse.width)
        with self._lock:
            if not self._count:
                self._first_ns = pulse.onset_ns
            self._count += 1
            self._digest.update(record)

    def for_the_log(self) -> dict[str, object]:
        """Return number, first onset [ns] and hash of the pulses since the last call, if any.

        The hash is the SHA-256 of onset, intensity, number and width of each, as hexadecimal
        digits.
        """
        with self._lock:
            if not self._count:
                return {}
            found = {
                'pulses': self._count,
                'first_pulse_ns': self._first_ns,
                'pulses_sha256': self._digest.hexdigest(),
            }
            self._begin()
            return found


def hash_of(pulses: PulseTrain) -> str:
    """Return the hash that `PulseHash` has after the same pulses, as hexadecimal digits."""
    rows = zip(*(values.tolist() for values in pulses._arrays), strict=True)
    return hashlib.sha256(b''.join(_packed(*row) for row in rows)).hexdigest()
