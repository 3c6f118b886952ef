# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Content of a report on one session, computed before anything is drawn."""

from collections.abc import Callable
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rpms_ros.errors import ReportError
from rpms_ros.identification import Estimator
from rpms_ros.identification import IdentifiedSession
from rpms_ros.identification import identify
from rpms_ros.identification.analysis import SummationAnalysis
from rpms_ros.pulses import BoolArray
from rpms_ros.recording import Recording
from rpms_ros.report.course import Course
from rpms_ros.report.course import course_of
from rpms_ros.report.known_muscle import KnownMuscle
from rpms_ros.report.known_muscle import known_muscle
from rpms_ros.report.recorded import RecordedMessages
from rpms_ros.report.result import IdentificationResult
from rpms_ros.report.result import trains_of
from rpms_ros.report.session.checklist import ChecklistItem
from rpms_ros.report.session.checklist import checklist_of
from rpms_ros.report.session.dose import DeviceLoad
from rpms_ros.report.session.dose import Dose
from rpms_ros.report.session.dose import dose_of
from rpms_ros.report.session.dose import load_of
from rpms_ros.report.session.headline import Headline
from rpms_ros.report.session.headline import headline_of
from rpms_ros.report.session.held_out import HELD_OUT_SHARE
from rpms_ros.report.session.held_out import FrozenFrom
from rpms_ros.report.session.held_out import HeldOutFit
from rpms_ros.report.session.held_out import boundary
from rpms_ros.report.session.held_out import held_out_fit
from rpms_ros.report.session.residuals import ResidualAnalysis
from rpms_ros.report.session.residuals import analyse_residuals
from rpms_ros.stimulation.device_specification import DeviceSpecification


@dataclass(frozen=True)
class ReportSettings:
    """Settings of a report.

    Attributes
    ----------
    held_out_share : float
        Share of the time at the end that is predicted and not learnt from.
    residual_share : float
        Share of the time at the end whose a-priori residuals are analysed.
    device : DeviceSpecification or None
        Device for the energy; None leaves it in units of a pulse at full intensity.
    stated : mapping of str to str or None
        Items of the checklist given by the user.
    command : str
        The command line that makes the report; empty if there is none.
    previous : mapping or None
        JSON of an earlier session of the same person, to compare with.
    """

    held_out_share: float = HELD_OUT_SHARE
    residual_share: float = 0.2
    device: DeviceSpecification | None = None
    stated: Mapping[str, str] | None = None
    command: str = ''
    previous: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class SessionAnalysis:
    """Content of a report.

    Attributes
    ----------
    title : str
        Name of the session.
    recording : Recording
        Where it comes from.
    result : IdentificationResult
        As `rpms identify --json` prints it.
    session : IdentifiedSession
        Estimates and traces.
    dose : Dose
        Schedule and dose.
    load : DeviceLoad or None
        Energy on a device, if one was named.
    recorded : RecordedMessages
        Messages of the nodes in the recording.
    residuals : ResidualAnalysis or None
        None where they cannot be analysed.
    held_out : HeldOutFit or None
        None where nothing could be held out.
    checklist : list of ChecklistItem
        Items of the reporting checklist.
    settings : ReportSettings
        Settings.
    remarks : tuple of str
        Why something is missing.
    headline : Headline
        The first screen.
    truth : KnownMuscle or None
        The true muscle, where the recording was simulated.
    """

    title: str
    recording: Recording
    result: IdentificationResult
    session: IdentifiedSession
    dose: Dose
    load: DeviceLoad | None
    recorded: RecordedMessages
    residuals: ResidualAnalysis | None
    held_out: HeldOutFit | None
    checklist: list[ChecklistItem]
    settings: ReportSettings
    remarks: tuple[str, ...]
    headline: Headline
    truth: KnownMuscle | None = None

    @cached_property
    def trains(self) -> SummationAnalysis | None:
        """Trains of one intensity, if they stand for a recruitment curve."""
        return trains_of(self.recording, self.result)

    @cached_property
    def course(self) -> Course:
        """Quantities of the session over time."""
        return course_of(self.session)


def analyse(
    title: str,
    recording: Recording,
    recorded: RecordedMessages,
    session: IdentifiedSession,
    result: IdentificationResult,
    build_estimator: Callable[[], Estimator],
    settings: ReportSettings | None = None,
    progress: Callable[[int], object] | None = None,
) -> SessionAnalysis:
    """Return the content of a report.

    Parameters
    ----------
    title : str
        Name of the session.
    recording, recorded : Recording, RecordedMessages
        What was recorded.
    session, result : IdentifiedSession, IdentificationResult
        What was identified, and its result.
    build_estimator : callable
        Makes a fresh estimator for the held-out fit, like that of the session.
    settings : ReportSettings, optional
        Settings.
    progress : callable, optional
        Called with the number of samples of the held-out fit processed since the last call.

    Raises
    ------
    ReportError
        If a share is not between 0 and 1, or a given item is not in the checklist.
    """
    settings = settings or ReportSettings()
    dose = dose_of(recording.pulses, int(session.stamp_ns[0]))
    checklist = checklist_of(dose, recording.facts.custom, settings.stated)
    remarks: list[str] = []
    try:
        residuals = _residuals(session, recording, settings)
    except ReportError as error:
        residuals = None
        remarks.append(f'no residual analysis: {error}')
    first_ns = boundary(session.stamp_ns, settings.held_out_share)
    held_out = _held_out(recording, build_estimator, first_ns, progress)
    if held_out is None:
        remarks.append('no held-out fit: expected a force that changes in the held-out part')
    if recorded.unreadable:
        remarks.append(f'{recorded.unreadable} messages of nodes could not be decoded')
    return SessionAnalysis(
        title,
        recording,
        result,
        session,
        dose,
        load_of(dose, settings.device) if settings.device else None,
        recorded,
        residuals,
        held_out,
        checklist,
        settings,
        tuple(remarks),
        headline_of(result, session, settings.previous),
        known_muscle(recorded.truths, recording.facts.custom, session.last.repetition_rate),
    )


def last_part(session: IdentifiedSession, share: float) -> BoolArray:
    """Return which samples (samples,) were learnt from in the last `share` of the time."""
    span = int(session.stamp_ns[-1] - session.stamp_ns[0])
    chosen: BoolArray = session.usable & (
        session.stamp_ns >= session.stamp_ns[-1] - round(share * span)
    )
    return chosen


def _residuals(
    session: IdentifiedSession, recording: Recording, settings: ReportSettings
) -> ResidualAnalysis:
    if not 0.0 < settings.residual_share <= 1.0:
        raise ReportError(
            f'expected a share of residuals above 0 and up to 1, got {settings.residual_share}'
        )
    kept = last_part(session, settings.residual_share)
    residual = (session.force - session.prediction)[kept]
    return analyse_residuals(session.stamp_ns[kept], residual, recording.pulses)


def _held_out(
    recording: Recording,
    build_estimator: Callable[[], Estimator],
    first_ns: int,
    progress: Callable[[int], object] | None,
) -> HeldOutFit | None:
    frozen = FrozenFrom(build_estimator(), first_ns)
    arrival = recording.samples_before_pulse if frozen.on_line else None
    session = identify(
        frozen,
        recording.pulses,
        recording.forces,
        progress=progress,
        samples_before_pulse=arrival,
        foreign=recording.foreign,
    )
    if not np.any(session.stamp_ns < first_ns):
        return None
    return held_out_fit(session, first_ns)
