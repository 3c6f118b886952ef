# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Force traces for zooming: the whole session as envelopes, parts of it sample by sample.

A page has to stay small enough to be sent: an hour at 1 kHz is 3.6 million samples.  Where all of
them do not fit, the envelope shows every extreme, and three windows show every sample.
"""

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rpms_ros.axis import QUANTITIES
from rpms_ros.identification import IdentifiedSession
from rpms_ros.identification.output_error import settled
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray

MOST_SAMPLES = 50_000
"""Up to so many samples are kept one by one."""
ENVELOPE_BINS = 4000
WINDOW = 10.0
"""Length of a window that is kept sample by sample [s]."""
_MOST_IN_WINDOW = 10_000


@dataclass(frozen=True)
class Window:
    """A part of a session that is kept sample by sample.

    Attributes
    ----------
    label : str
        What it shows.
    first, last : int
        Slice of the samples.
    """

    label: str
    first: int
    last: int


def windows_of(session: IdentifiedSession) -> list[Window]:
    """Return the parts of a session that are kept sample by sample."""
    count = len(session.stamp_ns)
    if count <= MOST_SAMPLES:
        return [Window('whole session', 0, count)]
    period = (session.stamp_ns[-1] - session.stamp_ns[0]) / (count - 1) / NANOSECONDS_PER_SECOND
    length = min(_MOST_IN_WINDOW, count, max(2, round(WINDOW / period)))
    return [
        Window('start', 0, length),
        _worst(session, length),
        Window('end', count - length, count),
    ]


def force_traces(session: IdentifiedSession) -> dict[str, Any]:
    """Return the traces as JSON takes them: arrays are little-endian float32 in base 64.

    Times are in s after the first sample (`start` of a window, plus `time` within it), forces
    in N; NaN where there is no prediction yet.
    """
    elapsed = (session.stamp_ns - session.stamp_ns[0]) / NANOSECONDS_PER_SECOND
    traces: dict[str, Any] = {
        'end': float(elapsed.max()),
        'residual_limit': _residual_limit(session),
        'unit': session.last.unit,
        'quantity': QUANTITIES[session.last.unit],
        'windows': [_window(session, elapsed, window) for window in windows_of(session)],
    }
    if len(elapsed) > MOST_SAMPLES:
        traces['envelope'] = _envelope(session, elapsed)
    return traces


def _residual_limit(session: IdentifiedSession) -> float | None:
    """Return the height of the residual's axis [N], None to let the plot choose.

    Before an estimator has settled, residuals are as large as the force: they would flatten the
    rest, and may leave the plot.
    """
    kept = settled(session.stamp_ns) & session.usable
    if not kept.any():
        return None
    largest = float(np.abs(session.force - session.prediction)[kept].max())
    return 1.1 * largest if largest > 0.0 else None


def _worst(session: IdentifiedSession, length: int) -> Window:
    """Return the window with the largest mean square of the residual, past the first fifth."""
    square = np.where(session.usable, (session.force - session.prediction) ** 2, 0.0)
    total = np.concatenate([[0.0], np.cumsum(square)])
    energy = total[length:] - total[:-length]
    # The start, before the estimator has settled, is always the worst and has its own window.
    begin = min(len(square) // 5, len(energy) - 1)
    first = begin + int(np.argmax(energy[begin:]))
    return Window('largest residual', first, first + length)


def _window(session: IdentifiedSession, elapsed: FloatArray, window: Window) -> dict[str, Any]:
    part = slice(window.first, window.last)
    start = float(elapsed[window.first])
    return {
        'label': window.label,
        'start': start,
        'time': encoded(elapsed[part] - start),
        'measured': encoded(session.force[part]),
        'modelled': encoded(session.shown_prediction[part]),
    }


def _envelope(session: IdentifiedSession, elapsed: FloatArray) -> dict[str, Any]:
    """Return minimum and maximum, one after the other, of runs of equally many samples."""
    starts = np.unique(np.linspace(0, len(elapsed), ENVELOPE_BINS, endpoint=False).astype(int))
    middles = (starts + np.append(starts[1:], len(elapsed))) // 2
    series = {
        'measured': session.force,
        'modelled': session.shown_prediction,
        'residual': session.force - session.shown_prediction,
    }
    extremes = {
        name: [np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)]
        for name, values in series.items()
    }
    columns = {'time': [elapsed[starts], elapsed[middles]], **extremes}
    return {name: encoded(np.stack(pair, axis=1).ravel()) for name, pair in columns.items()}


def encoded(values: npt.NDArray[Any]) -> str:
    """Return numbers as little-endian float32 in base 64."""
    return base64.b64encode(np.asarray(values, dtype='<f4').tobytes()).decode('ascii')
