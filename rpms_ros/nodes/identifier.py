# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Node that identifies the muscle: `force` and `pulses` in, `estimate` out.

Callbacks only collect; a timer hands what has come to the stream.  How it is cut into blocks has
no influence on the estimates, so a replay of a recording gives them bit for bit.  What its
services do is not in a recording.

An executor of rclpy hands out messages topic by topic.  Here the subscriptions belong to a second
node that is in no executor; what has come is taken from them, in the order of arrival, when the
identifier looks.
"""

import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger

from rpms_msgs.msg import MuscleEstimate, Pulse as PulseMessage
from rpms_ros import estimate_messages, messages
from rpms_ros.axis import UNITS, unit_vector
from rpms_ros.errors import AxisError, IdentificationError, NodeError, RpmsError
from rpms_ros.identification import (
    DEFAULT_RATE,
    PRESET_NAMES,
    Estimate,
    Estimator,
    IdentificationStream,
    StreamSettings,
)
from rpms_ros.identification.catalogue import estimator_by_name, on_line_names
from rpms_ros.identification.estimation.prior import warm_start
from rpms_ros.identification.model.estimate import HIGHEST_RATE, LOWEST_RATE
from rpms_ros.identification.model.history_law import TemporalSummation
from rpms_ros.identification.model.settings import PEOPLE_PRESET
from rpms_ros.identification.quality import doubts as faults
from rpms_ros.identification.quality.doubts import EXPECTED_FORCE, stated_doubt
from rpms_ros.identification.stream.sensor_checks import monitors_by_name
from rpms_ros.identification.warm_up import warm_up
from rpms_ros.nodes.common import qos, topics
from rpms_ros.nodes.common.diagnostics import (
    PERIOD_S,
    DiagnosticsPublisher,
    Health,
    logger_of,
    plain_text,
)
from rpms_ros.nodes.common.parameters import NodeParameters, declare_parameters, parameter, sensed
from rpms_ros.nodes.common.runner import NodeOfParts, every, run
from rpms_ros.nodes.common.subscriptions import QueuedTopic, Taken
from rpms_ros.nodes.common.topics import MESSAGE_TYPES
from rpms_ros.pulses import ForceTrace, IntArray, PulseTrain

_STREAM = StreamSettings()


@dataclass(frozen=True)
class IdentifierParameters(NodeParameters):
    """Parameters of the identifier."""

    estimator: str = parameter(
        'recursive',
        'Algorithm: recursive (one pass) or tracking (a muscle that changes).',
        choices=on_line_names(),
    )
    preset: str = parameter(
        PEOPLE_PRESET,
        'people fits every muscle, arctan takes the arctangents of the paper alone as '
        'recruitment; the others reproduce tables of the paper and are not for people.',
        choices=PRESET_NAMES,
    )
    repetition_rate: float = parameter(
        DEFAULT_RATE,
        'Rate for which the recruitment curve is stated.',
        unit='Hz',
        bounds=(LOWEST_RATE, HIGHEST_RATE),
    )
    axis: str = parameter(
        'z',
        'Axis of the wrench along which the muscle pulls: x, y, z, -x, -y, -z or 0.6,0,0.8.',
        true_is='y',
    )
    quantity: str = sensed(
        'What the sensor measures: a force, or a torque as an isometric dynamometer does.'
    )
    reorder_delay: float = parameter(
        _STREAM.reorder_delay,
        'How long a sample waits for pulses; one may be late by this less '
        f'{_STREAM.pulse_look_ahead:g} s.',
        unit='s',
        bounds=(_STREAM.pulse_look_ahead, 10.0),
    )
    estimate_period: float = parameter(
        _STREAM.estimate_period, 'Stamps between two estimates.', unit='s', bounds=(0.001, 3600.0)
    )
    largest_force: float = parameter(
        _STREAM.largest_force,
        'Larger forces of either sign are no muscle and are dropped.',
        unit='N',
        bounds=(0.001, 1e6),
    )
    monitors: tuple[str, ...] = parameter(
        _STREAM.monitors, 'Monitors of the stream, of this package or registered by others.'
    )
    frame_id: str = parameter('muscle', 'Frame of the estimate.')
    temporal_summation: str = parameter(
        '',
        'JSON of rpms analyze, or of the numbers of its history law: weighs a pulse by those '
        'before it; empty: by the interval alone. For tracking; '
        'in rpms identify also for batch.',
    )
    start_from: str = parameter(
        '',
        'JSON of rpms identify of an earlier session of the patient; what it says gives way where '
        'it is wrong, and comes back with a reset. For tracking.',
    )

    def __post_init__(self) -> None:
        if self.estimator == 'batch':
            raise NodeError(
                'parameter estimator: expected an estimator that works on line, got batch, which '
                'fits everything anew for each estimate: use tracking here, and rpms identify '
                'for the recording'
            )
        super().__post_init__()
        try:
            monitors_by_name(stream_settings(self).monitors)
            unit_vector(self.axis)
            if self.temporal_summation or self.start_from:
                build_estimator(self)
        except (IdentificationError, AxisError) as error:
            raise NodeError(str(error)) from error


def stream_settings(settings: IdentifierParameters) -> StreamSettings:
    """Return how samples and pulses are brought together."""
    names = ('reorder_delay', 'estimate_period', 'largest_force', 'monitors')
    return StreamSettings(**{name: getattr(settings, name) for name in names})


def build_estimator(settings: IdentifierParameters) -> Estimator:
    """Return a new estimator."""
    path = settings.temporal_summation
    history = TemporalSummation.of_file(Path(path).expanduser()) if path else None
    estimator = estimator_by_name(
        settings.estimator, settings.preset, 0, settings.repetition_rate, history
    )
    if settings.start_from:
        warm_start(estimator, Path(settings.start_from).expanduser(), UNITS[settings.quantity])
    return estimator


def build_stream(settings: IdentifierParameters) -> IdentificationStream:
    """Return a stream with a new estimator."""
    return IdentificationStream(build_estimator(settings), stream_settings(settings))


def _places(forces: list[Taken], others: list[Taken]) -> IntArray:
    """Return how many samples came before each of other messages (messages,), ascending."""
    forces_ns, others_ns = (
        np.array([one.received_ns for one in taken], dtype=np.int64) for taken in (forces, others)
    )
    # A clock that is set back within a look must not change the order within a topic.
    before = np.searchsorted(np.maximum.accumulate(forces_ns), others_ns)
    return np.maximum.accumulate(before)


# Seconds for which a second publisher is a reason to doubt, as other faults are.
_SECONDS = 30


class Publishers:
    """Looks at the publishers on the graph, once a second.

    Parameters
    ----------
    node : Node
        The identifier.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.fault_counts: Counter[str] = Counter()
        self._counts: dict[str, int] = {}
        self._recent: deque[tuple[str, ...]] = deque(maxlen=_SECONDS)

    def look(self) -> None:
        """Note topics with more publishers than one."""
        crowded = []
        watched = {faults.FORCE_PUBLISHERS: topics.FORCE, faults.PULSE_PUBLISHERS: topics.PULSES}
        for name, topic in watched.items():
            found = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(topic))
            count = len({tuple(one.endpoint_gid) for one in found})
            before = self._counts.get(name, 1)
            self._counts[name] = max(count, 1)
            if count > 1:
                crowded.append(name)
                self.fault_counts[name] += max(count - before, 0)
        self._recent.append(tuple(crowded))

    def noted(self, estimate: Estimate) -> Estimate:
        """Return the estimate with what was found here among its faults and doubts."""
        doubts = (*estimate.doubts, *sorted(set(chain(*self._recent))))
        return replace(estimate, doubts=doubts, faults={**estimate.faults, **self.fault_counts})


def identifier_health(
    estimate: Estimate | None, faults: Mapping[str, int], silent: bool, held: bool
) -> Health:
    """Return the health of an identifier.

    Stale while no force comes, a warning while the newest estimate is in doubt, ok otherwise.
    """
    level, text = DiagnosticStatus.OK, 'held: predicts, does not learn' if held else 'identifying'
    figures: dict[str, object] = {'held': held}
    if estimate is None:
        text = 'no estimate yet'
    else:
        if estimate.doubts:
            level, text = DiagnosticStatus.WARN, f'in doubt: {", ".join(estimate.doubts)}'
        figures |= {
            'estimator': estimate.estimator,
            'samples': estimate.samples,
            'pulses': estimate.pulses,
            'output error': f'{estimate.output_error:.4g}',
            'curve known': estimate.curve_known,
            'changes': estimate.changes,
        }
        if estimate.reasons:
            figures['reasons'] = '; '.join(estimate.reasons)
    if silent:
        level, text = DiagnosticStatus.STALE, 'no force'
    figures |= {f'fault {fault}': count for fault, count in faults.items()}
    return Health(text, level, figures)


# Silence of the force after which somebody should look at the sensor [s].
_SILENCE = 5.0
# Between two looks at what has arrived; has no influence on the estimates [s].
_LOOK_PERIOD = 0.02


class Identifier(NodeOfParts):
    """On-line identification; keyword arguments go to `rclpy.node.Node`."""

    settings_type = IdentifierParameters

    def __init__(self, **options: Any) -> None:
        super().__init__('identifier', **options)

    def _build(self) -> None:
        self.settings = declare_parameters(self, IdentifierParameters)
        # nothing may be left to compile while force comes in
        warm_up(
            lambda: build_stream(self.settings).estimator,
            lambda: logger_of(self).info('compiling, once on a machine: one to three minutes'),
        )
        self.stream = build_stream(self.settings)
        self._axis, quantity = unit_vector(self.settings.axis), self.settings.quantity
        self._unit = UNITS[quantity]
        self._reported: dict[str, int] = {}
        self._unread: set[str] = set()
        self._doubted = ''
        self._heard = time.monotonic()
        self._last: Estimate | None = None
        publisher = self.create_publisher
        self._estimate = publisher(MuscleEstimate, topics.ESTIMATE, qos.ESTIMATE_KEPT)
        self._disturbance = publisher(WrenchStamped, topics.DISTURBANCE, qos.DISTURBANCE)
        force, pulses = (self.resolve_topic_name(name) for name in (topics.FORCE, topics.PULSES))
        self._diagnostics = DiagnosticsPublisher(self, 'identification', f'sensor of {force}')
        self._listener = self.second_node()
        self._pulses = QueuedTopic(self, self._listener, PulseMessage, topics.PULSES, qos.PULSES)
        self._force = QueuedTopic(self, self._listener, WrenchStamped, topics.FORCE, qos.FORCE)
        self._sensor_frame = ''
        self._senders = Publishers(self)
        for name, act in (('reset', self._reset), ('hold', self._hold), ('resume', self._resume)):
            self.create_service(Trigger, f'~/{name}', self._answering(act))
        every(self, _LOOK_PERIOD, self._process)
        every(self, PERIOD_S, self._report)
        what = f'{quantity} [{self._unit}] on {force} along {self.settings.axis}'
        by = self.stream.estimator.name
        logger_of(self).info(f'identifying with {by}: {what}; pulses on {pulses}')

    def _reset(self) -> str:
        """Forget everything and start again, as after a change of the electrode or the coil."""
        held, self.stream = self.stream.held, build_stream(self.settings)
        if held:
            self.stream.hold()
        for ear in (self._force, self._pulses):
            ear.taken()
        self._senders = Publishers(self)
        self._reported, self._doubted = {}, ''
        self._last = None
        return f'reset: the identification starts again{", held" if held else ""}'

    def _hold(self) -> str:
        """Predict and do not learn, while somebody moves the coil, say."""
        self._take()
        self.stream.hold()
        return 'held: predicts, does not learn'

    def _resume(self) -> str:
        self._take()
        self.stream.resume()
        return 'resumed: learns'

    def _answering(self, act: Callable[[], str]) -> Callable[[Any, Any], Any]:
        """Return the callback of a service that does something and answers what it did."""

        def answer(_: Any, response: Any) -> Any:
            try:
                response.message, response.success = plain_text(act()), True
                logger_of(self).info(response.message)
            except RpmsError as error:
                response.message = plain_text(error)
                logger_of(self).warning(f'refused: {response.message}')
            return response

        return answer

    def _take(self) -> None:
        """Pass what has come to the stream."""
        # Pulses last: none is handed over later than a sample that came after it.
        forces = self._read(self._force, WrenchStamped)
        pulses = self._read(self._pulses, PulseMessage)
        if self._force.lost:
            self.stream.miss(self._force.lost)
            self._force.lost = 0
        if forces:
            self._heard = time.monotonic()
        train = PulseTrain.of([messages.pulse_of(one) for _, one in pulses])
        places = _places([taken for taken, _ in forces], [taken for taken, _ in pulses])
        # In the order of arrival, as a recorder writes them and a replay reads them.
        self.stream.add(train, self._trace([one for _, one in forces]), places)

    def _read(self, ear: QueuedTopic, kind: Any) -> list[tuple[Taken, Any]]:
        """Return what has come with its messages; what cannot be read is lost."""
        found = []
        for taken in ear.taken():
            try:
                found.append((taken, deserialize_message(taken.data, kind)))
            except Exception as error:  # noqa: BLE001
                # of rmw, of rclpy, or of a text that is none: of another definition
                ear.lost += 1
                if ear.name not in self._unread:
                    wanted = f'expected a {kind.__name__} on {ear.name}'
                    logger_of(self).warning(f'{wanted}, got one that cannot be read: {error}')
                self._unread.add(ear.name)
        return found

    def _trace(self, heard: list[Any]) -> ForceTrace:
        if heard:
            self._sensor_frame = heard[-1].header.frame_id
        found = [messages.force_of(one, self._axis, self.settings.quantity) for one in heard]
        stamp_ns = np.array([stamp for stamp, _ in found], dtype=np.int64)
        return ForceTrace(stamp_ns, np.array([force for _, force in found], dtype=np.float64))

    def _process(self) -> None:
        self._take()
        for estimate in self.stream.advance():
            self._last = replace(self._senders.noted(estimate), unit=self._unit)
            frame_id = self.settings.frame_id
            message = estimate_messages.estimate_message(self._last, MESSAGE_TYPES, frame_id)
            self._estimate.publish(message)
            if estimate.disturbance_deviation > 0.0:
                stamp_ns, value = estimate.stamp_ns, estimate.disturbance
                sensor = self._axis, MESSAGE_TYPES, self._sensor_frame, self.settings.quantity
                self._disturbance.publish(messages.force_message(stamp_ns, value, *sensor))

    def _say_doubts(self) -> None:
        """Log when the estimate begins or ceases to be one that is not to be trusted."""
        last, before = self._last, self._doubted
        doubts = '; '.join(stated_doubt(last, name) for name in last.doubts) if last else ''
        self._doubted = doubts
        if doubts and doubts != before:
            logger_of(self).warning(f'the estimate is not to be trusted: {doubts}')
        elif before and not doubts:
            logger_of(self).info('nothing speaks against the estimate any more')

    def _report(self) -> None:
        # a node that was held up has not looked yet
        self._take()
        self._senders.look()
        for ear in (self._force, self._pulses):
            if said := ear.look():
                logger_of(self).warning(said)
        if foreign := '; '.join(filter(None, (self._force.foreign, self._pulses.foreign))):
            logger_of(self).warning(foreign, throttle_duration_sec=_SILENCE)
        faults = {**self.stream.fault_counts, **self._senders.fault_counts}
        for name, count in faults.items():
            if count != self._reported.get(name):
                logger_of(self).warning(f'{name}: {count} so far')
        self._reported = faults
        self._say_doubts()
        last = self._last
        most = float(np.abs(last.curve_force).max()) if last and last.curve_known else 0.0
        if most > EXPECTED_FORCE:
            usual = f'expected a muscle of at most {EXPECTED_FORCE:g} {self._unit}'
            said = f'{usual}, got {most:.4g}: does the sensor tell grams or millinewtons?'
            logger_of(self).warning(said, once=True)
        silence = time.monotonic() - self._heard
        if silence > _SILENCE:
            publishers = self.count_publishers(self._force.name)
            said = f'no force on {self._force.name} for {silence:.0f} s ({publishers} publishers)'
            logger_of(self).warning(said, throttle_duration_sec=_SILENCE)
        health = identifier_health(self._last, faults, silence > _SILENCE, self.stream.held)
        self._diagnostics.publish(health)


# Runs the identifier as a process.
main = partial(run, Identifier)
