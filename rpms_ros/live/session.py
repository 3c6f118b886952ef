# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Everything that the page shows of one muscle, and what of it a browser does not have yet.

A browser that has taken one frame asks for the next; what it has is its cursor.  So a slow browser
gets larger frames and fewer of them, and nothing is kept for it.
"""

import math
import re
from collections import deque
from collections.abc import Mapping
from itertools import takewhile
from typing import Any
from typing import NamedTuple

import numpy as np

from rpms_ros.identification.estimate import Estimate
from rpms_ros.live.disturbance_course import DisturbanceCourse
from rpms_ros.live.driver_view import STOPPED
from rpms_ros.live.driver_view import driver_view
from rpms_ros.live.estimate_view import estimate_view
from rpms_ros.live.force_bins import BIN_NS
from rpms_ros.live.force_bins import ForceBins
from rpms_ros.live.heard import NEVER
from rpms_ros.live.heard import OK
from rpms_ros.live.heard import SILENT
from rpms_ros.live.heard import Topic
from rpms_ros.live.modelled import ModelledForce
from rpms_ros.live.numbers import number
from rpms_ros.live.numbers import numbers
from rpms_ros.live.numbers import text
from rpms_ros.printable import counted
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray
from rpms_ros.pulses import Pulse

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

    Attributes
    ----------
    button_nodes : mapping of str to str
        Node of each publisher of a stop button, by the identity of the publisher.
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
        self.button_nodes: Mapping[str, str] = {}
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
        view['reason'] = self._with_nodes(view['reason'])
        view['buttons'] = [[self._with_nodes(name), state] for name, state in view['buttons']]
        self.state = view['state']
        if view != self._driver:
            self._driver = view
            self._driver_count += 1

    def _with_nodes(self, words: str) -> str:
        """Return a text of the driver with the nodes of buttons in place of identities."""
        named = _IDENTITY.sub(
            lambda found: self.button_nodes.get(found[0], 'a button not named yet'), words
        )
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
