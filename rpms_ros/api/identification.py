# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What was found of the muscle: curve, response, parameters, figure, tables."""

import html
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpms_ros.api.session import Session, new_figure
from rpms_ros.errors import ReportError
from rpms_ros.identification import IdentifiedSession
from rpms_ros.identification.quality.explained_force import Stated
from rpms_ros.identification.quality.verdict import Verdict
from rpms_ros.report.result import (
    ONE_INTENSITY,
    Curve,
    IdentificationResult,
    ImpulseResponse,
    result_rows,
)
from rpms_ros.report.text import labelled, write_text
from rpms_ros.schema import plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rpms_ros.report.known_muscle import KnownMuscle


@dataclass(frozen=True)
class Parameter(Stated):
    """A parameter of the muscle with its interval.

    Attributes
    ----------
    value, lower, upper : float
        Estimate and ends of the interval, in `unit`; the ends are NaN if the estimator states
        none.
    unit : str
        ``1`` for a share of the maximum and other plain numbers, ``s`` or ``N``.
    determined : str
        Whether the data determine it: ``converged``, ``informed``, ``not informed``, or empty if
        the estimator does not say.
    """

    unit: str
    determined: str = ''


@dataclass(frozen=True)
class Identification:
    """Recruitment and dynamics of the muscle of one session; made by `Session.identify`.

    Attributes
    ----------
    session : Session
        What was identified.
    estimates : IdentifiedSession
        Every estimate that was kept, and the trace of force and prediction.
    result : IdentificationResult
        What `to_dict` returns, as an object.
    """

    session: Session
    estimates: IdentifiedSession
    result: IdentificationResult

    @property
    def estimator(self) -> str:
        """Name of the algorithm."""
        return self.result.estimator

    @property
    def verdict(self) -> Verdict:
        """Whether the result may be used: ``grade``, ``reasons`` and both in one ``line``.

        The grade is ``good``, ``doubtful`` (look at the reasons first) or ``no`` (do not use it);
        the gravest reason comes first.  `rpms identify` begins with the same words.

        Examples
        --------
        >>> import rpms_ros
        >>> verdict = rpms_ros.load('bags/sample').identify().verdict
        >>> verdict.grade
        'good'
        >>> len(verdict.reasons)
        1
        >>> verdict.line.startswith('good: the identified muscle explains')
        True
        """
        return self.result.verdict

    @property
    def curve(self) -> Curve | None:
        """Recruitment curve as steady mean force at ``result.rate_hz``, with its interval.

        None if the data do not tell it, as pulses of nearly one intensity.
        """
        return self.result.curve

    @property
    def response(self) -> ImpulseResponse:
        """Force after one pulse at full intensity, with its interval."""
        return self.result.impulse_response

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Parameters of the recruitment curve and of the response, by name.

        Intervals are on the level ``result.confidence``.  That of a sharpness is symmetric in its
        logarithm, in which it is estimated.  Of trains of one intensity: time constant and latency
        of the model that stands for them.
        """
        found = {}
        flags = self.result.identifiability or {}
        for name, value in (self.result.recruitment or {}).items():
            ends = self.result.interval(name) or (np.nan, np.nan)
            found[name] = Parameter(value, *ends, '1', flags.get(name, ''))
        for name, stated in (self.result.physiology or {}).items():
            # the name ends with the unit
            unit = {'s': 's', 'n': self.result.unit}.get(name.rpartition('_')[2], '1')
            found[name] = Parameter(stated.value, stated.lower, stated.upper, unit)
        if (trains := self.result.dynamics) is not None:
            for name in ('twitch_time_constant_s', 'latency_s'):
                found[name] = Parameter(**vars(getattr(trains, name)), unit='s')
        return found

    def force_at(self, intensity: float) -> Stated:
        """Return the steady mean force at an intensity with its interval [N].

        Parameters
        ----------
        intensity : float
            Share of the stimulator's maximum, 0 to 1.

        Returns
        -------
        Stated
            ``value``, ``lower`` and ``upper``; the ends are NaN if the estimator states none.

        Raises
        ------
        ReportError
            If the intensity is not one number from 0 to 1, or the data do not tell the curve.
        """
        given = np.asarray(intensity)
        if given.ndim:
            raise ReportError(f'expected one intensity, got {given.size}; `curve` has 101 of them')
        if given.dtype.kind not in 'buif' or not 0 <= given <= 1:
            raise ReportError(f'expected an intensity from 0 to 1, got {intensity!r}')
        if self.curve is None and ONE_INTENSITY in self.result.notes:
            raise ReportError('expected pulses of several intensities, got nearly one intensity')
        if self.curve is None:
            fault = 'expected data that determine a recruitment curve'
            raise ReportError(f'{fault}, got {self.verdict.line}')
        return self.curve.at(float(given))

    def plot(self, figure: 'Figure | None' = None) -> 'Figure':
        """Draw time courses, force, recruitment curve and response; return the figure.

        Of trains of one intensity: the trains with their models.

        Parameters
        ----------
        figure : matplotlib.figure.Figure, optional
            An empty figure to draw into; else one is made by ``matplotlib.pyplot``, which shows
            it in a notebook, and in a script with ``plt.show()``.
        """
        from rpms_ros.report.figures import draw_session

        one = self.session
        found = (self.estimates, one.pulses, self._truth(), one.name, self.result.trains)
        return draw_session(*found, figure or new_figure(8.4))

    def _truth(self) -> 'KnownMuscle | None':
        """Return the muscle of a simulated session."""
        from rpms_ros.report.known_muscle import of_subject
        from rpms_ros.report.recorded import true_muscle

        one, rate = self.session, self.result.rate_hz
        if one.truth is not None:
            return one.truth
        if one.subject is not None:
            return of_subject(one.subject, rate)
        return true_muscle(one.recording, rate) if one.recording.facts.path.exists() else None

    def to_dict(self) -> dict[str, Any]:
        """Return the result as ``rpms identify --json`` prints it: plain values, None for NaN."""
        return dict(plain(self.result))

    def to_json(self, path: str | Path | None = None) -> str:
        """Return the result as JSON, and write it to `path` if one is given.

        Raises
        ------
        ReportError
            If the file cannot be written.
        """
        text = json.dumps(self.to_dict(), allow_nan=False, indent=1)
        if path is not None:
            write_text(Path(path), text)
        return text

    def __repr__(self) -> str:
        return f'Identification({self.session.name!r}, {self.estimator!r}, {self.verdict.line!r})'

    def __str__(self) -> str:
        return f'{self.session.name}\n{labelled(result_rows(self.result))}'

    def _repr_html_(self) -> str:
        return f'<pre>{html.escape(str(self))}</pre>'
