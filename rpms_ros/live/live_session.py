# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Everything that the page shows of one muscle, and what of it a browser does not have yet.

A browser that has taken one frame asks for the next; what it has is its cursor.  So a slow browser
gets larger frames and fewer of them, and nothing is kept for it.
"""

import math
import re
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np

from rpms_ros.identification.analysis.trains import evenly
from rpms_ros.identification.model.estimate import Estimate
from rpms_ros.identification.quality.doubts import MEANING, meaning_of_doubt
from rpms_ros.live.force_course import BIN_NS, ForceBins, ModelledForce
from rpms_ros.live.topic_health import MOST_NAMES, OK, SILENT, Topic, number, numbers, text
from rpms_ros.muscle.recruitment import PARAMETER_NAMES
from rpms_ros.printable import counted
from rpms_ros.pulses import FloatArray, IntArray, Pulse
from rpms_ros.report.text import RATE_WORDS, interval_of, label

_NANOSECONDS = 1e-9
STATES = ('unconfigured', 'disarmed', 'armed', 'running', 'stopped', 'fault')
BUTTONS = ('released', 'pressed', 'silent', 'unknown')
STOPPED = 'stopped'


# Fields of a status of the driver that are shown as they are, by how JSON takes them.
_SHOWN: Mapping[Callable[[Any], object], tuple[str, ...]] = {
    text: ('reason', 'schedule', 'device', 'operator_id'),
    bool: ('enabled',),
    int: ('pulses_delivered', 'pulses_dropped', 'pulses_unverified', 'segments', 'dose_pulses'),
    number: (
        'time_left', 'lateness_max', 'maximum_intensity', 'coil_energy', 'coil_temperature',
        'dose_energy',
    ),
}  # fmt: skip
_NUMBERS = ('output_error', 'confidence', 'disturbance', 'disturbance_deviation')


def driver_view(message: Any) -> dict[str, Any]:
    """Return an rpms_msgs/DriverStatus as JSON takes it."""
    buttons = [_word(BUTTONS, state) for state in message.button_states]
    return {
        **{name: how(getattr(message, name)) for how, names in _SHOWN.items() for name in names},
        'state': _word(STATES, message.state),
        'segment': int(message.segment) + 1 if message.segments else 0,
        'faults': _pairs(message.fault_names, [int(count) for count in message.fault_counts]),
        'buttons': _pairs(message.button_names, buttons),
    }


def _word(words: tuple[str, ...], value: int) -> str:
    return words[value] if 0 <= value < len(words) else f'state {int(value)}'


def _pairs(names: Any, values: list[Any], newest: bool = False) -> list[list[Any]]:
    """Return the first pairs of names and values, or the newest."""
    pairs = [[text(name), value] for name, value in zip(names, values, strict=False)]
    return pairs[-MOST_NAMES:] if newest else pairs[:MOST_NAMES]


class Course:
    """Keeps values of the last half minute, each with its number and its stamp.

    Parameters
    ----------
    most : int
        Values that are kept.

    Attributes
    ----------
    count : int
        Values so far.
    """

    def __init__(self, most: int) -> None:
        self.count = 0
        self._kept: deque[tuple[int, int, tuple[float, ...]]] = deque(maxlen=most)

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest [ns], None without one."""
        return self._kept[-1][1] if self._kept else None

    def add(self, stamp_ns: int, *values: float) -> None:
        """Take values at a stamp [ns]."""
        self.count += 1
        self._kept.append((self.count, stamp_ns, values))

    def any_within(self, first_ns: int, last_ns: int) -> bool:
        """Whether there is one from `first_ns` to `last_ns` [ns]."""
        return any(first_ns <= stamp_ns <= last_ns for _, stamp_ns, _ in self._kept)

    def clear(self) -> None:
        """Forget everything."""
        self._kept.clear()

    def keep_near(self, origin_ns: int) -> None:
        """Forget what is of another clock than that of `origin_ns` [ns]."""
        near = (one for one in self._kept if abs(one[1] - origin_ns) < _NEAR_NS)
        self._kept = deque(near, maxlen=self._kept.maxlen)

    def since(self, count: int, origin_ns: int) -> list[list[float | None]]:
        """Return time after `origin_ns` [s] and values of those after `count`, oldest first."""
        found = [
            [round((stamp_ns - origin_ns) * _NANOSECONDS, 4), *numbers(values)]
            for _, stamp_ns, values in takewhile(lambda one: one[0] > count, reversed(self._kept))
        ]
        return found[::-1]


_IN_MS = ('twitch_time_constant_s', 'latency_s')
PARAMETERS: Mapping[str, str] = {
    **{name: label(name) for name in (*PARAMETER_NAMES, 'order')},
    **{name: f'{label(name)} [ms]' for name in _IN_MS},
    'twitch_peak_n': f'{label("twitch_peak_n")} [{{unit}}]',
}
"""Words for the parameters and what is derived from them; `{unit}` is that of the sensor."""

IDENTIFIABILITY = ('not in the data', 'still moving', 'settled')
"""Words for `NOT_INFORMED`, `INFORMED` and `CONVERGED`."""

# Points of a curve that are sent.
_MOST_POINTS = 101


def estimate_view(estimate: Estimate, origin_ns: int) -> dict[str, Any]:
    """Return an estimate as JSON takes it; times in s after `origin_ns`.

    Each parameter is a row of label, value, lower and upper bound, and what the data say of it. A
    value that the data do not bound is None: it is the value that the estimator began with.
    """
    stamp = (estimate.stamp_ns - origin_ns) * _NANOSECONDS
    unit = text(estimate.unit) or 'N'
    meanings = [_plain(meaning_of_doubt(name)) for name in estimate.doubts[:MOST_NAMES]]
    reasons = [text(one) for one in estimate.reasons if _plain(one) not in meanings]
    return {
        'estimator': text(estimate.estimator),
        'unit': unit,
        'samples': estimate.samples,
        'pulses': estimate.pulses,
        **{name: number(getattr(estimate, name)) for name in _NUMBERS},
        'rate': number(estimate.repetition_rate),
        'curve': _curve(estimate, 'curve', 'intensity'),
        'response': _curve(estimate, 'response', 'time'),
        'parameters': _parameters(estimate, unit),
        'physiology': _bounded(estimate, 'physiology', PARAMETERS, unit),
        'rates': _bounded(estimate, 'rate', RATE_WORDS, unit),
        'changes': estimate.changes,
        'marks': _pairs(estimate.change_kinds, numbers(stamp - estimate.change_ago), newest=True),
        'doubts': _pairs(estimate.doubts, meanings),
        # some are the meaning of a doubt, which is shown with its name
        'reasons': reasons[:MOST_NAMES],
        'faults': [
            [text(name), int(count), _plain(MEANING.get(name, ''))]
            for name, count in list(estimate.faults.items())[:MOST_NAMES]
        ],
    }


def _curve(estimate: Estimate, name: str, along: str) -> dict[str, Any] | None:
    """Return a line of an estimate with its band, None in place of what does not fit to it."""
    lines = {part: getattr(estimate, f'{name}_{part}') for part in ('force', 'lower', 'upper')}
    lines['along'] = getattr(estimate, f'{name}_{along}')
    count = len(lines['along'])
    if not count or len(lines['force']) != count:
        return None
    shown = evenly(count, _MOST_POINTS)
    return {
        part: numbers(line[shown]) if len(line) == count else None for part, line in lines.items()
    }


def _bounded(estimate: Estimate, key: str, known: Mapping[str, str], unit: str) -> list[list[Any]]:
    """Return rows of quantities of an estimate that have a key, a value and two bounds."""
    values = (getattr(estimate, f'{key}{end}') for end in ('', '_lower', '_upper'))
    return _rows(getattr(estimate, f'{key}_names'), known, unit, *values)


def _rows(
    names: Iterable[str], known: Mapping[str, str], unit: str, *found: FloatArray
) -> list[list[Any]]:
    """Return rows of words, value, lower and upper bound, None where there are none.

    A quantity of somebody else's estimator keeps its name.
    """
    values, lower, upper = found
    if not len(lower) == len(upper) == len(values):
        lower = upper = np.full(len(values), np.nan)
    rows: list[list[Any]] = []
    for name, *row in zip(names, values, lower, upper, strict=False):
        words, factor = known.get(name, name), 1e3 if name in _IN_MS else 1.0
        rows.append([text(words.replace('{unit}', unit)), *(number(factor * x) for x in row)])
    return rows[:MOST_NAMES]


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
            bounds[:, place] = interval_of(name, value, deviation, estimate.confidence) or np.nan
    rows = _rows(estimate.nonlinear_names, PARAMETERS, unit, values, *bounds)
    for row, flag in zip(rows, flags, strict=False):
        row.append(IDENTIFIABILITY[flag] if 0 <= flag < len(IDENTIFIABILITY) else '')
        if flag == 0:
            row[1:4] = [None, None, None]
    return rows


FORCE, PULSES, ESTIMATE, DRIVER = 'force', 'pulses', 'estimate', 'driver_status'

# Pulses of half a minute at 50 Hz, and some; so many estimates tell of a disturbance.
_KEPT_PULSES, _KEPT_DISTURBANCES = 2000, 400
# The modelled force waits so long for pulses that come after their force [bins].
_HOLD = 20
_TOPICS_PERIOD = 0.5
# The force begins anew after a jump of the clock or a pause: pulses farther away are not with it.
_NEAR_NS = 10_000_000_000
# Without a pulse in so long there is no force that an error could be a share of [ns].
_REST_NS = 1_500_000_000
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
    """What a browser has: epoch and counters of the courses, and how many changes of the rest."""

    epoch: int = -1
    bin: int = 0
    pulse: int = 0
    disturbance: int = 0
    changes: int = 0


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
        self.title = namespace.strip('/').replace('_', ' ') or 'stimulated muscle'
        self._own = re.compile(rf'(?<!\w){re.escape(own)}(?![\w/])')
        self._first_curve_s = first_curve_s
        self._began: float | None = None
        self.unit, self.topics, self.can_stop = unit, topics, can_stop
        self.bins = ForceBins()
        self.state = ''
        self._ready = -1
        self._epoch = 0
        self._model = ModelledForce()
        self._pulses = Course(_KEPT_PULSES)
        self._disturbance = Course(_KEPT_DISTURBANCES)
        self._bad_pulses = 0
        self._estimate: Estimate | None = None
        self._driver: dict[str, Any] | None = None
        self._next_topics = -math.inf
        self._stop: dict[str, Any] = {}
        # what is sent when it has changed: the number of its newest change, and how it is told
        self._told: dict[str, tuple[int, Callable[[], Any]]] = {}
        self._changes = 0
        self.stop(False, '')

    def confirms_stop(self, now: float) -> bool:
        """Return whether a driver that is heard at `now` [s], a steady clock, has stopped.

        One that is not heard may have ended, or have been started again; what cannot be read may
        say anything.
        """
        driver = self.topics[DRIVER]
        return self.state == STOPPED and not driver.refused and driver.state(now) == OK

    def force(self, stamp_ns: IntArray, force: FloatArray) -> None:
        """Take force samples [ns], [N], each (n,)."""
        for stamp, value in zip(stamp_ns.tolist(), force.tolist(), strict=True):
            self.bins.add(stamp, value)

    def pulse(self, pulse: Pulse) -> None:
        """Take a pulse that was delivered; one of an impossible intensity is counted only."""
        if not 0.0 <= pulse.intensity <= 1.0:
            self._bad_pulses += 1
            return
        self._pulses.add(pulse.onset_ns, pulse.intensity)
        self._model.pulse(pulse.onset_ns, pulse.intensity)

    def estimate(self, estimate: Estimate) -> None:
        """Take an estimate."""
        self._estimate = estimate
        self._tell('estimate', lambda: self._estimate_part(estimate))
        if estimate.unit == self.unit:
            self._model.estimate(estimate)
        value, deviation = estimate.disturbance, estimate.disturbance_deviation
        if not (math.isfinite(value) and math.isfinite(deviation) and deviation > 0.0):
            return
        if estimate.stamp_ns <= (self._disturbance.newest_ns or 0):
            # a clock that has jumped begins anew: a line is drawn over ascending times
            self._disturbance.clear()
        self._disturbance.add(estimate.stamp_ns, value, deviation)

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
            self._tell('driver', lambda: view)

    def _tell(self, name: str, told: Callable[[], Any]) -> None:
        """Have a part sent to every browser that does not have this change of it."""
        self._changes += 1
        self._told[name] = self._changes, told

    def _plain(self, words: str) -> str:
        """Return a text of the driver without identities, and with this page called so."""
        named = _IDENTITY.sub('a button not named yet', words)
        return self._own.sub('this page', named).replace('(this page)', 'by this page')

    def stop(self, pressed: bool, text: str) -> None:
        """Take the state of the page's stop."""
        stop = {'pressed': pressed, 'text': text}
        if stop != self._stop:
            self._stop = stop
            self._tell('stop', lambda: stop)

    def advance(self, now: float) -> None:
        """Work out what can be shown by now [s], a steady clock."""
        if self._epoch != self.bins.epoch or self._ready < self.bins.origin - 1:
            self._epoch = self.bins.epoch
            self._ready = self.bins.origin - 1
            for course in (self._pulses, self._disturbance):
                course.keep_near(self._origin_ns)
            self._model.restart()
        last = self.bins.newest - _HOLD
        if last > self._ready:
            first = max(self._ready + 1, self.bins.oldest)
            # the middle of each bin
            stamps = np.arange(first, last + 1, dtype=np.int64) * BIN_NS + BIN_NS // 2
            measured = self.bins.since(first, last)[:2].mean(axis=0)
            self.bins.model(first, self._model.at(stamps, measured))
            self._ready = last
        if now >= self._next_topics:
            self._next_topics = now + _TOPICS_PERIOD
            views, top = self._views(now), self._head(now)
            self._tell('topics', lambda: views)
            self._tell('top', lambda: top)

    def _head(self, now: float) -> dict[str, Any]:
        """Return what stands above everything else."""
        force, estimate, driver = (self.topics[name] for name in (FORCE, ESTIMATE, DRIVER))
        lost = bool(estimate.refused) or estimate.state(now) == SILENT
        old = self._estimate is not None and lost
        alarms = []
        if old:
            why = 'cannot be read' if estimate.refused else f'silent for {estimate.age(now):.0f} s'
            alarms.append(f'identifier {why}: curve, parameters and doubts are old')
        if self._estimate is not None and self._estimate.unit != self.unit:
            alarms.append(f'identifier tells {self._estimate.unit}, this page reads {self.unit}')
        if force.state(now) == SILENT:
            alarms.append(f'no force for {force.age(now):.0f} s: look at the sensor')
        unheard = driver.state(now) == SILENT or bool(driver.refused)
        return {
            'title': self.title,
            'alarms': alarms,
            'old': old,
            'waiting': self._waiting(now) if self._estimate is None else '',
            'next': _UNHEARD if unheard else _NEXT.get(self.state, ''),
        }

    def _waiting(self, now: float) -> str:
        """Return why there is no estimate yet."""
        self._began = now if self._began is None else self._began
        if self.topics[ESTIMATE].publishers:
            asleep = not self.topics[FORCE].count
            return f'the identifier waits for {"force" if asleep else "pulses"}'
        left = self._first_curve_s - (now - self._began)
        if left > 0.0:
            return f'compiling, first curve in about {5 * math.ceil(left / 5.0)} s'
        return f'no identifier for {now - self._began:.0f} s: is it running, or the machine busy?'

    def frame(self, cursor: Cursor) -> tuple[Cursor, dict[str, Any] | None]:
        """Return what a browser does not have, as JSON takes it, and its new cursor.

        None if it has everything.
        """
        parts: dict[str, Any] = {}
        if cursor == Cursor():
            parts['session'] = {'can_stop': self.can_stop, 'unit': self.unit}
        # times of pulses and changes count from the first sample
        if self._begun:
            have = cursor if cursor.epoch == self._epoch else Cursor()
            if have.epoch < 0 or have.bin < self._ready:
                parts['force'] = self._force_part(have)
            origin_ns = self._origin_ns
            if self._pulses.count > cursor.pulse:
                parts['pulses'] = self._pulses.since(have.pulse, origin_ns)
            if self._disturbance.count > cursor.disturbance:
                parts['disturbance'] = self._disturbance.since(have.disturbance, origin_ns)
        for name, (change, told) in self._told.items():
            if change > cursor.changes:
                parts[name] = told()
        if not parts:
            return cursor, None
        if self._begun:
            cursor = Cursor(self._epoch, self._ready, self._pulses.count, self._disturbance.count)
        return cursor._replace(changes=self._changes), parts

    def _estimate_part(self, estimate: Estimate) -> dict[str, Any]:
        view = estimate_view(estimate, self._origin_ns)
        if not self._pulses.any_within(estimate.stamp_ns - _REST_NS, estimate.stamp_ns):
            # a share of the noise says nothing
            view['output_error'] = None
        return view

    @property
    def _begun(self) -> bool:
        return self._ready >= self.bins.origin

    @property
    def _origin_ns(self) -> int:
        return self.bins.origin * BIN_NS

    def _force_part(self, have: Cursor) -> dict[str, Any]:
        oldest = self.bins.oldest
        first = max(oldest, have.bin + 1) if have.epoch == self._epoch else oldest
        low, high, modelled = map(numbers, self.bins.since(first, self._ready))
        return {
            'epoch': self._epoch,
            'first': first - self.bins.origin,
            'width': BIN_NS * 1e-9,
            'low': low,
            'high': high,
            'modelled': modelled,
        }

    def _views(self, now: float) -> list[dict[str, Any]]:
        """Return what is shown of each topic, and of the data in it that are not used."""
        bad = {
            FORCE: (
                (self.bins.not_finite, 'sample', ' not finite'),
                (self.bins.stray, 'sample', ' stamped far from the others'),
                (self.bins.epoch, 'jump', ' of the clock'),
            ),
            PULSES: ((self._bad_pulses, 'pulse', ' with an intensity outside 0..1'),),
        }
        views = []
        for name, topic in self.topics.items():
            view = topic.view(now)
            words = [counted(n, what) + which for n, what, which in bad.get(name, ()) if n]
            view['text'] = '; '.join([view['text'], *words] if view['text'] else words)
            views.append(view)
        return views
