# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Everything that the page shows of one muscle, and what of it a browser does not have yet.

A browser that has taken one frame asks for the next; what it has is its cursor.  So a slow browser
gets larger frames and fewer of them, and nothing is kept for it.
"""

import math
import re
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from itertools import takewhile
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from rpms_ros.identification.model.estimate import Estimate
from rpms_ros.identification.quality.doubts import MEANING, meaning_of_doubt
from rpms_ros.live.force_course import BIN_NS, ForceBins, ModelledForce
from rpms_ros.live.heard import (
    MOST_NAMES,
    NEVER,
    OK,
    SILENT,
    Topic,
    number,
    numbers,
    text,
    texts,
    thinned,
)
from rpms_ros.printable import counted
from rpms_ros.pulses import FloatArray, IntArray, Pulse
from rpms_ros.report.text import RATE_WORDS, interval_of, label

STATES = ('unconfigured', 'disarmed', 'armed', 'running', 'stopped', 'fault')
BUTTONS = ('released', 'pressed', 'silent', 'unknown')
STOPPED = 'stopped'


def driver_view(message: Any) -> dict[str, Any]:
    """Return an rpms_msgs/DriverStatus as JSON takes it."""
    return {
        'state': _word(STATES, message.state),
        'reason': text(message.reason),
        'schedule': text(message.schedule),
        'segment': int(message.segment) + 1 if message.segments else 0,
        'segments': int(message.segments),
        'time_left': number(message.time_left),
        'commanded': int(message.pulses_commanded),
        'delivered': int(message.pulses_delivered),
        'dropped': int(message.pulses_dropped),
        'unverified': int(message.pulses_unverified),
        'coil_energy': number(message.coil_energy),
        'coil_temperature': number(message.coil_temperature),
        'lateness_max': number(message.lateness_max),
        'device': text(message.device),
        'maximum_intensity': number(message.maximum_intensity),
        'operator': text(message.operator_id),
        'enabled': bool(message.enabled),
        'dose_pulses': int(message.dose_pulses),
        'dose_energy': number(message.dose_energy),
        'faults': _pairs(message.fault_names, [int(count) for count in message.fault_counts]),
        'buttons': _pairs(
            message.button_names, [_word(BUTTONS, state) for state in message.button_states]
        ),
    }


def _word(words: tuple[str, ...], value: int) -> str:
    return words[value] if 0 <= value < len(words) else f'state {int(value)}'


def _pairs(names: Any, values: list[Any]) -> list[list[Any]]:
    return [[text(name), value] for name, value in zip(names, values, strict=False)][:MOST_NAMES]


# Half a minute of estimates, and some.
_KEPT = 400
_NANOSECONDS = 1e-9


class DisturbanceCourse:
    """Keeps what the estimates of the last half minute tell.

    Attributes
    ----------
    count : int
        Estimates so far that told it.
    """

    def __init__(self) -> None:
        self.count = 0
        self._kept: deque[tuple[int, int, float, float]] = deque(maxlen=_KEPT)

    def add(self, estimate: Estimate) -> None:
        """Take an estimate; one that does not know the disturbance is passed over."""
        value, deviation = estimate.disturbance, estimate.disturbance_deviation
        if not (math.isfinite(value) and math.isfinite(deviation) and deviation > 0.0):
            return
        if self._kept and estimate.stamp_ns <= self._kept[-1][1]:
            # a clock that has jumped begins anew: a line is drawn over ascending times
            self._kept.clear()
        self.count += 1
        self._kept.append((self.count, estimate.stamp_ns, value, deviation))

    def since(self, count: int, origin_ns: int) -> list[list[float | None]]:
        """Return time after `origin_ns` [s], value and deviation [N] of those after `count`."""
        return [
            [round((stamp_ns - origin_ns) * _NANOSECONDS, 4), number(value), number(deviation)]
            for counted, stamp_ns, value, deviation in self._kept
            if counted > count and stamp_ns >= origin_ns
        ]


class Label(NamedTuple):
    """How a quantity is shown: its name with its unit, and what its value is multiplied by."""

    text: str
    factor: float = 1.0


PARAMETERS: Mapping[str, Label] = MappingProxyType(
    {
        **{name: Label(label(name)) for name in ('u_thr', 'u_sat', 'alpha_sat', 'alpha_thr')},
        'twitch_time_constant_s': Label(f'{label("twitch_time_constant_s")} [ms]', 1e3),
        'latency_s': Label(f'{label("latency_s")} [ms]', 1e3),
        'order': Label(label('order')),
        'twitch_peak_n': Label(f'{label("twitch_peak_n")} [{{unit}}]'),
    }
)
"""Labels of the parameters and of what is derived from them; `{unit}` is that of the sensor."""

RATES: Mapping[str, Label] = {name: Label(words) for name, words in RATE_WORDS.items()}
"""Labels of the rates of change per minute."""


def label_of(name: str, labels: Mapping[str, Label], unit: str) -> Label:
    """Return how a quantity is shown; one of somebody else's estimator keeps its name."""
    known = labels.get(name)
    return known._replace(text=known.text.replace('{unit}', unit)) if known else Label(name)


IDENTIFIABILITY = ('not in the data', 'still moving', 'settled')
"""Words for `NOT_INFORMED`, `INFORMED` and `CONVERGED`."""

MOST_POINTS = 101
"""Points of a curve that are sent."""


def estimate_view(estimate: Estimate, origin_ns: int) -> dict[str, Any]:
    """Return an estimate as JSON takes it; times in s after `origin_ns`.

    Each parameter is a row of label, value, lower and upper bound, and what the data say of it. A
    value that the data do not bound is None: it is the value that the estimator began with.
    """
    stamp = (estimate.stamp_ns - origin_ns) * _NANOSECONDS
    unit = text(estimate.unit) or 'N'
    meanings = [_plain(meaning_of_doubt(name)) for name in estimate.doubts[:MOST_NAMES]]
    return {
        'estimator': text(estimate.estimator),
        'unit': unit,
        'stamp': number(stamp),
        'samples': estimate.samples,
        'pulses': estimate.pulses,
        'output_error': number(estimate.output_error),
        'confidence': number(estimate.confidence),
        'rate': number(estimate.repetition_rate),
        'curve': _curve(
            estimate.curve_intensity,
            estimate.curve_force,
            estimate.curve_lower,
            estimate.curve_upper,
        ),
        'response': _curve(
            estimate.response_time,
            estimate.response_force,
            estimate.response_lower,
            estimate.response_upper,
        ),
        'parameters': _parameters(estimate, unit),
        'physiology': _rows(
            _labels(estimate.physiology_names, PARAMETERS, unit),
            estimate.physiology,
            estimate.physiology_lower,
            estimate.physiology_upper,
        ),
        'rates': _rows(
            _labels(estimate.rate_names, RATES, unit),
            estimate.rate,
            estimate.rate_lower,
            estimate.rate_upper,
        ),
        'changes': estimate.changes,
        'marks': [
            [text(kind), number(stamp - ago)]
            for kind, ago in zip(estimate.change_kinds, estimate.change_ago, strict=False)
        ][-MOST_NAMES:],
        'disturbance': number(estimate.disturbance),
        'disturbance_deviation': number(estimate.disturbance_deviation),
        'doubts': [
            [text(name), meaning]
            for name, meaning in zip(estimate.doubts[:MOST_NAMES], meanings, strict=True)
        ],
        # some are the meaning of a doubt, which is shown with its name
        'reasons': texts(one for one in estimate.reasons if _plain(one) not in meanings),
        'faults': [
            [text(name), int(count), _plain(MEANING.get(name, ''))]
            for name, count in list(estimate.faults.items())[:MOST_NAMES]
        ],
    }


def _curve(
    along: FloatArray, force: FloatArray, lower: FloatArray, upper: FloatArray
) -> dict[str, Any] | None:
    if not len(force) or len(force) != len(along):
        return None
    shown = thinned(len(along), MOST_POINTS)
    parts = {
        name: line[shown]
        for name, line in (('along', along), ('force', force), ('lower', lower), ('upper', upper))
        if len(line) == len(along)
    }
    values = numbers(np.concatenate(list(parts.values())))
    count = len(values) // len(parts)
    each = {name: values[place * count :][:count] for place, name in enumerate(parts)}
    return {'lower': None, 'upper': None, **each}


def _rows(
    labels: Iterable[Label], values: FloatArray, lower: FloatArray, upper: FloatArray
) -> list[list[Any]]:
    """Return rows of label, value and bounds, None where there are none."""
    bounded = len(lower) == len(upper) == len(values)
    return [
        [
            text(label.text),
            number(label.factor * value),
            number(label.factor * lower[place]) if bounded else None,
            number(label.factor * upper[place]) if bounded else None,
        ]
        for place, (label, value) in enumerate(zip(labels, values, strict=False))
    ][:MOST_NAMES]


def _labels(names: Iterable[str], labels: Mapping[str, Label], unit: str) -> Iterator[Label]:
    return (label_of(name, labels, unit) for name in names)


def _plain(meaning: str) -> str:
    """Return a meaning as a page shows it: names in it are not marked as in documents."""
    return meaning.replace('`', '')


def _parameters(estimate: Estimate, unit: str) -> list[list[Any]]:
    values, flags = estimate.nonlinear, estimate.nonlinear_identifiability
    variance = np.diag(estimate.nonlinear_covariance)
    bounds = np.full((2, len(values)), np.nan)
    if len(variance) == len(values) and 0.5 < 0.5 + 0.5 * estimate.confidence < 1.0:
        deviations = np.sqrt(np.where(variance >= 0.0, variance, np.nan))
        known = zip(estimate.nonlinear_names[:MOST_NAMES], values, deviations, strict=False)
        for place, (name, value, deviation) in enumerate(known):
            ends = interval_of(name, value, deviation, estimate.confidence)
            bounds[:, place] = ends or np.nan
    rows = _rows(_labels(estimate.nonlinear_names, PARAMETERS, unit), values, *bounds)
    for row, flag in zip(rows, flags, strict=False):
        row.append(IDENTIFIABILITY[flag] if 0 <= flag < len(IDENTIFIABILITY) else '')
        if flag == 0:
            row[1:4] = [None, None, None]
    return rows


FORCE, PULSES, ESTIMATE, DRIVER = 'force', 'pulses', 'estimate', 'driver_status'

# Pulses of half a minute at 50 Hz, and some.
_KEPT_PULSES = 2000
# The modelled force waits so long for pulses that come after their force [bins].
_HOLD = 20
_TOPICS_PERIOD = 0.5
# The force begins anew after a jump of the clock or a pause: pulses farther away are not with it.
_NEAR_NS = 10_000_000_000
# Without a pulse in so long there is no force that an error could be a share of [ns].
_REST_NS = 1_500_000_000
_UNNAMED = 'stimulated muscle'
# What a frame of the estimates is called that nobody has named.
_ANY_MUSCLE = 'muscle'
# Identity of a publisher, by which a driver calls a button whose node it does not know yet.
_IDENTITY = re.compile(r'\b[0-9a-f]{32,48}\b')
_NEXT = {
    'unconfigured': 'Configure the driver.',
    'disarmed': 'Arm the driver, by the operator where one is required.',
    'armed': 'Start a schedule, or deactivate the driver.',
    'running': 'Watch the patient, and keep a stop in reach.',
    STOPPED: 'Find the cause and release every stop, then reset the stop at the driver.',
    'fault': 'Read the reason, clean the driver up, then configure it again.',
}
_UNHEARD = 'Use the switch of the stimulator, then look at the driver: it is not heard.'


class Cursor(NamedTuple):
    """What a browser has: counters of the newest part of each kind, the epoch of the force."""

    epoch: int = -1
    bin: int = 0
    pulse: int = 0
    estimate: int = 0
    driver: int = 0
    topics: int = 0
    stop: int = 0
    disturbance: int = 0


class LiveSession:
    """Takes what is heard, and gives what has to be drawn.

    Parameters
    ----------
    namespace : str
        Of the nodes; it names the muscle until the frame of an estimate does.
    topics : mapping of str to Topic
        By `FORCE`, `PULSES`, `ESTIMATE` and `DRIVER`.
    can_stop : bool
        Whether the page offers a stop.
    unit : str
        Of what the sensor measures.
    own : str
        Name of the page's node, with its namespace.
    first_curve_s : float
        How long an identifier takes from its start to its first curve [s].
    """

    def __init__(
        self,
        namespace: str,
        topics: Mapping[str, Topic],
        can_stop: bool = False,
        unit: str = 'N',
        own: str = '/live_page',
        first_curve_s: float = 60.0,
    ) -> None:
        self.title = namespace.strip('/').replace('_', ' ') or _UNNAMED
        self._own = re.compile(rf'(?<!\w){re.escape(own)}(?![\w/])')
        self._first_curve_s = first_curve_s
        self._began = math.nan
        self.unit = unit
        self.topics = topics
        self.can_stop = can_stop
        self.bins = ForceBins()
        self.state = ''
        self._ready = -1
        self._epoch = 0
        self._model = ModelledForce()
        self._pulses: deque[tuple[int, int, float]] = deque(maxlen=_KEPT_PULSES)
        self._pulse_count = 0
        self._bad_pulses = 0
        self._estimate: Estimate | None = None
        self._estimate_count = 0
        self._disturbance = DisturbanceCourse()
        self._driver: dict[str, Any] | None = None
        self._driver_count = 0
        self._topic_views: list[dict[str, Any]] = []
        self._top: dict[str, Any] = {}
        self._topic_count = 0
        self._next_topics = -math.inf
        self._stop: dict[str, Any] = {'pressed': False, 'text': ''}
        self._stop_count = 1

    @property
    def stop_pressed(self) -> bool:
        """Whether the stop of the page is pressed."""
        return bool(self._stop['pressed'])

    @property
    def stopped(self) -> bool:
        """Whether the newest state of the driver is that a stop is latched."""
        return self.state == STOPPED

    def confirms_stop(self, now: float) -> bool:
        """Return whether a driver that is heard at `now` [s], a steady clock, has stopped.

        One that is not heard may have ended, or have been started again; what cannot be read may
        say anything.
        """
        driver = self.topics[DRIVER]
        return self.stopped and not driver.refused and driver.state(now) == OK

    def force(self, stamp_ns: IntArray, force: FloatArray) -> None:
        """Take force samples [ns], [N], each (n,)."""
        self.bins.add_block(stamp_ns, force)

    def pulse(self, pulse: Pulse) -> None:
        """Take a pulse that was delivered; one of an impossible intensity is counted only."""
        if not 0.0 <= pulse.intensity <= 1.0:
            self._bad_pulses += 1
            return
        self._pulse_count += 1
        self._pulses.append((self._pulse_count, pulse.onset_ns, pulse.intensity))
        self._model.pulse(pulse.onset_ns, pulse.intensity)

    def estimate(self, estimate: Estimate) -> None:
        """Take an estimate."""
        self._estimate = estimate
        self._estimate_count += 1
        self._model.estimate(estimate)
        self._disturbance.add(estimate)

    def call(self, frame_id: str) -> None:
        """Take the frame of an estimate: the name of the muscle, if somebody has given it one."""
        if frame_id and frame_id != _ANY_MUSCLE:
            self.title = text(frame_id)

    def driver(self, message: Any) -> None:
        """Take an rpms_msgs/DriverStatus."""
        view = driver_view(message)
        view['reason'] = self._plain(view['reason'])
        view['buttons'] = [[self._plain(name), state] for name, state in view['buttons']]
        self.state = view['state']
        if view != self._driver:
            self._driver = view
            self._driver_count += 1

    def _plain(self, words: str) -> str:
        """Return a text of the driver without identities, and with this page called so."""
        named = _IDENTITY.sub('a button not named yet', words)
        return self._own.sub('this page', named).replace('(this page)', 'by this page')

    def stop(self, pressed: bool, text: str) -> None:
        """Take the state of the page's stop."""
        stop = {'pressed': pressed, 'text': text}
        if stop != self._stop:
            self._stop = stop
            self._stop_count += 1

    def advance(self, now: float) -> None:
        """Work out what can be shown by now [s], a steady clock."""
        if self._epoch != self.bins.epoch or self._ready < self.bins.origin - 1:
            self._epoch = self.bins.epoch
            self._ready = self.bins.origin - 1
            self._forget_pulses()
        last = self.bins.newest - _HOLD
        if last > self._ready:
            first = max(self._ready + 1, self.bins.oldest)
            # the middle of each bin
            stamps = np.arange(first, last + 1, dtype=np.int64) * BIN_NS + BIN_NS // 2
            self.bins.model(first, self._model.at(stamps))
            self._ready = last
        if now >= self._next_topics:
            self._next_topics = now + _TOPICS_PERIOD
            self._topic_views = [topic.view(now) for topic in self.topics.values()]
            self._note_bad_data()
            self._top = self._head(now)
            self._topic_count += 1

    def _head(self, now: float) -> dict[str, Any]:
        """Return what stands above everything else."""
        if math.isnan(self._began):
            self._began = now
        force, estimate, driver = (self.topics[name] for name in (FORCE, ESTIMATE, DRIVER))
        old = self._estimate is not None and (
            bool(estimate.refused) or estimate.state(now) == SILENT
        )
        alarms = []
        if old:
            why = 'cannot be read' if estimate.refused else f'silent for {estimate.age(now):.0f} s'
            alarms.append(f'identifier {why}: curve, parameters and doubts are old')
        if force.state(now) == SILENT:
            alarms.append(f'no force for {force.age(now):.0f} s: look at the sensor')
        lost = driver.state(now) == SILENT or bool(driver.refused)
        return {
            'title': self.title,
            'alarms': alarms,
            'old': old,
            'waiting': self._waiting(now) if self._estimate is None else '',
            'next': _UNHEARD if lost else _NEXT.get(self.state, ''),
        }

    def _waiting(self, now: float) -> str:
        """Return why there is no estimate yet, and when there will be one."""
        if self.topics[ESTIMATE].publishers:
            asleep = self.topics[FORCE].state(now) == NEVER
            return f'the identifier waits for {"force" if asleep else "pulses"}'
        left = self._first_curve_s - (now - self._began)
        if left > 0.0:
            return f'compiling, first curve in about {5 * math.ceil(left / 5.0)} s'
        return (
            f'no identifier for {now - self._began:.0f} s: is it running? One that compiles takes '
            'longer on a busy machine'
        )

    def _forget_pulses(self) -> None:
        """Forget pulses of another clock than that of the force, which has begun anew."""
        near = (pulse for pulse in self._pulses if abs(pulse[1] - self._origin_ns) < _NEAR_NS)
        self._pulses = deque(near, maxlen=_KEPT_PULSES)

    def frame(self, cursor: Cursor) -> tuple[Cursor, dict[str, Any] | None]:
        """Return what a browser does not have, as JSON takes it, and its new cursor.

        None if it has everything.
        """
        parts: dict[str, Any] = {}
        if cursor == Cursor():
            parts['session'] = {
                'can_stop': self.can_stop,
                'unit': self.unit,
            }
        if self._ready >= self.bins.origin and (
            cursor.epoch != self._epoch or cursor.bin < self._ready
        ):
            parts['force'] = self._force_part(cursor)
        # times of pulses and changes count from the first sample
        if self._pulse_count > cursor.pulse and self._begun:
            parts['pulses'] = self._pulse_part(cursor)
        if self._disturbance.count > cursor.disturbance and self._begun:
            have = cursor.disturbance if cursor.epoch == self._epoch else 0
            parts['disturbance'] = self._disturbance.since(have, self._origin_ns)
        if self._estimate is not None and self._estimate_count > cursor.estimate:
            parts['estimate'] = self._estimate_part(self._estimate)
        if self._driver_count > cursor.driver:
            parts['driver'] = self._driver
        if self._topic_count > cursor.topics:
            parts['topics'], parts['top'] = self._topic_views, self._top
        if self._stop_count > cursor.stop:
            parts['stop'] = self._stop
        if not parts:
            return cursor, None
        return self._whole(cursor), parts

    def _estimate_part(self, estimate: Estimate) -> dict[str, Any]:
        view = estimate_view(estimate, self._origin_ns)
        ago = (estimate.stamp_ns - onset_ns for _, onset_ns, _ in self._pulses)
        if not any(0 <= one <= _REST_NS for one in ago):
            # a share of the noise says nothing
            view['output_error'] = None
        return view

    @property
    def _begun(self) -> bool:
        return self._ready >= self.bins.origin

    @property
    def _origin_ns(self) -> int:
        return self.bins.origin * BIN_NS

    def _whole(self, cursor: Cursor) -> Cursor:
        """Return the cursor of a browser that has everything."""
        return Cursor(
            epoch=self._epoch if self._begun else cursor.epoch,
            bin=self._ready,
            pulse=self._pulse_count if self._begun else cursor.pulse,
            estimate=self._estimate_count,
            driver=self._driver_count,
            topics=self._topic_count,
            stop=self._stop_count,
            disturbance=self._disturbance.count if self._begun else cursor.disturbance,
        )

    def _force_part(self, cursor: Cursor) -> dict[str, Any]:
        first = self.bins.oldest
        if cursor.epoch == self._epoch:
            first = max(first, cursor.bin + 1)
        shown = self.bins.since(first, self._ready)
        values, count = numbers(shown.ravel()), shown.shape[1]
        return {
            'epoch': self._epoch,
            'first': first - self.bins.origin,
            'width': BIN_NS * 1e-9,
            'low': values[:count],
            'high': values[count : 2 * count],
            'modelled': values[2 * count :],
        }

    def _pulse_part(self, cursor: Cursor) -> list[list[float | None]]:
        origin_ns = self._origin_ns
        have = cursor.pulse if cursor.epoch == self._epoch else 0
        new = takewhile(lambda pulse: pulse[0] > have, reversed(self._pulses))
        return [
            [round((onset_ns - origin_ns) * 1e-9, 4), number(intensity)]
            for _, onset_ns, intensity in reversed(list(new))
        ]

    def _note_bad_data(self) -> None:
        counts = {
            FORCE: (
                (self.bins.not_finite, 'sample', ' not finite'),
                (self.bins.stray, 'sample', ' stamped far from the others'),
                (self.bins.epoch, 'jump', ' of the clock'),
            ),
            PULSES: ((self._bad_pulses, 'pulse', ' with an intensity outside 0..1'),),
        }
        for view, name in zip(self._topic_views, self.topics, strict=True):
            words = [counted(n, what) + which for n, what, which in counts.get(name, ()) if n]
            view['text'] = '; '.join([view['text'], *words] if view['text'] else words)
