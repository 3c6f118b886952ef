# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the identifier, and the stream that they describe."""

from dataclasses import dataclass
from pathlib import Path

from rpms_ros import messages
from rpms_ros.axis import FORCE, UNITS
from rpms_ros.errors import IdentificationError, MessageError, NodeError
from rpms_ros.identification import (
    DEFAULT_RATE,
    PRESET_NAMES,
    Estimator,
    IdentificationStream,
    StreamSettings,
)
from rpms_ros.identification.catalogue import estimator_by_name, on_line_names
from rpms_ros.identification.estimation.prior import warm_start
from rpms_ros.identification.model.estimate import HIGHEST_RATE, LOWEST_RATE
from rpms_ros.identification.model.settings import PEOPLE_PRESET, check_preset
from rpms_ros.identification.model.summation import TemporalSummation
from rpms_ros.identification.stream.sensor_checks import monitors_by_name
from rpms_ros.nodes.common.parameters import NodeParameters, parameter

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
        'people fits every muscle; the others reproduce tables of the paper and are not for '
        'people.',
        choices=PRESET_NAMES,
    )
    repetition_rate: float = parameter(
        DEFAULT_RATE,
        'Rate for which the recruitment curve is stated.',
        unit='Hz',
        minimum=LOWEST_RATE,
        maximum=HIGHEST_RATE,
    )
    axis: str = parameter(
        'z',
        'Axis of the wrench along which the muscle pulls: x, y, z, -x, -y, -z or 0.6,0,0.8.',
        true_is='y',
    )
    quantity: str = parameter(
        FORCE,
        'What the sensor measures: a force, or a torque as an isometric dynamometer does.',
        choices=tuple(UNITS),
    )
    best_effort_force: bool = parameter(
        False,
        'Hear a force sensor that publishes best effort from the start; without it, from a second '
        'after it was found. Samples may be lost.',
    )
    reorder_delay: float = parameter(
        _STREAM.reorder_delay,
        'How long a sample waits for pulses; one may be late by this less '
        f'{_STREAM.pulse_look_ahead:g} s.',
        unit='s',
        minimum=_STREAM.pulse_look_ahead,
        maximum=10.0,
    )
    estimate_period: float = parameter(
        _STREAM.estimate_period,
        'Stamps between two estimates; may be changed while the node runs.',
        unit='s',
        minimum=0.001,
        maximum=3600.0,
        dynamic=True,
    )
    longest_gap: float = parameter(
        _STREAM.longest_gap,
        'Longest pause of the force that does not count as a gap.',
        unit='s',
        minimum=0.001,
        maximum=3600.0,
    )
    largest_force: float = parameter(
        _STREAM.largest_force,
        'Larger forces of either sign are no muscle and are dropped.',
        unit='N',
        minimum=0.001,
        maximum=1e6,
    )
    monitors: tuple[str, ...] = parameter(
        _STREAM.monitors, 'Monitors of the stream, of this package or registered by others.'
    )
    state_folder: str = parameter(
        '', 'Folder in which save_state and load_state keep their files; empty refuses both.'
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
        'Saved state or JSON of rpms identify of an earlier session of the patient; what it says '
        'gives way where it is wrong, and comes back with a reset. For tracking.',
    )

    def __post_init__(self) -> None:
        if self.estimator == 'batch':
            raise NodeError(
                'parameter estimator: expected an estimator that works on line, got batch, which '
                'fits everything anew for each estimate: use tracking here, and rpms identify '
                'for the recording'
            )
        try:
            check_preset(self.preset)
        except IdentificationError as error:
            raise NodeError(f'parameter preset: {error}') from error
        super().__post_init__()
        try:
            monitors_by_name(stream_settings(self).monitors)
            messages.axis_of(self.axis)
            if self.temporal_summation or self.start_from:
                build_estimator(self)
        except (IdentificationError, MessageError) as error:
            raise NodeError(str(error)) from error


def stream_settings(settings: IdentifierParameters) -> StreamSettings:
    """Return how samples and pulses are brought together."""
    return StreamSettings(
        reorder_delay=settings.reorder_delay,
        estimate_period=settings.estimate_period,
        longest_gap=settings.longest_gap,
        largest_force=settings.largest_force,
        monitors=settings.monitors,
    )


def build_estimator(settings: IdentifierParameters) -> Estimator:
    """Return a new estimator."""
    path = settings.temporal_summation
    estimator = estimator_by_name(
        settings.estimator,
        settings.preset,
        0,
        settings.repetition_rate,
        TemporalSummation.of_file(Path(path).expanduser()) if path else None,
    )
    if settings.start_from:
        warm_start(estimator, Path(settings.start_from).expanduser())
    return estimator


def build_stream(settings: IdentifierParameters) -> IdentificationStream:
    """Return a stream with a new estimator."""
    return IdentificationStream(build_estimator(settings), stream_settings(settings))
