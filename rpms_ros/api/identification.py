# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What was found of the muscle: curve, response, parameters, figure, tables.

Results as tables of pandas and data sets of xarray, where these are installed.
"""

import json
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpms_ros.api.session import Session, as_html
from rpms_ros.axis import QUANTITIES
from rpms_ros.errors import ReportError
from rpms_ros.identification import IdentifiedSession
from rpms_ros.identification.quality.verdict import Verdict
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, FloatArray
from rpms_ros.report.result import Curve, IdentificationResult, ImpulseResponse, Stated
from rpms_ros.report.text import interval_of, with_interval
from rpms_ros.schema import plain

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from rpms_ros.report.known_muscle import KnownMuscle

NAN = float('nan')


@dataclass(frozen=True)
class Parameter:
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

    value: float
    lower: float
    upper: float
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
        flags, deviations = self.result.identifiability or {}, self.result.deviation or {}
        for name, value in (self.result.recruitment or {}).items():
            ends = interval_of(name, value, deviations.get(name), self.result.confidence)
            found[name] = Parameter(value, *(ends or (NAN, NAN)), '1', flags.get(name, ''))
        for name, stated in (self.result.physiology or {}).items():
            found[name] = Parameter(
                stated.value, stated.lower, stated.upper, _unit(name, self.result.unit)
            )
        dynamics = self.result.dynamics
        for name in () if dynamics is None else ('twitch_time_constant_s', 'latency_s'):
            ends = getattr(dynamics, name)
            found[name] = Parameter(ends.value, ends.lower, ends.upper, 's')
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
        curve = self.curve
        if curve is None:
            raise ReportError(self.result.without_curve)

        def at(values: FloatArray | None) -> float:
            return NAN if values is None else float(np.interp(intensity, curve.intensity, values))

        return Stated(at(curve.force), at(curve.lower), at(curve.upper))

    def plot(self, figure: 'Figure | None' = None) -> 'Figure':
        """Draw time courses, force, recruitment curve and response; return the figure.

        Of trains of one intensity: the trains with their models.

        Parameters
        ----------
        figure : matplotlib.figure.Figure, optional
            An empty figure to draw into; else one is made by ``matplotlib.pyplot``, which shows
            it in a notebook, and in a script with ``plt.show()``.
        """
        from rpms_ros.report.result import trains_of
        from rpms_ros.report.session.session_figure import fill_session_figure

        if figure is None:
            from matplotlib import pyplot as plt

            figure = plt.figure(figsize=(12.0, 8.4), layout='constrained')
        one = self.session
        trains = trains_of(one.recording, self.result)
        fill_session_figure(figure, self.estimates, one.pulses, self._truth(), one.name, trains)
        return figure

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
        document: dict[str, Any] = plain(self.result)
        return document

    def to_json(self, path: str | Path | None = None) -> str:
        """Return the result as JSON, and write it to `path` if one is given.

        Raises
        ------
        ReportError
            If the file cannot be written.
        """
        text = json.dumps(self.to_dict(), allow_nan=False, indent=1)
        if path is not None:
            try:
                Path(path).write_text(text, encoding='utf-8')
            except OSError as error:
                raise ReportError(f'expected to write {path}, got {error}') from error
        return text

    def to_pandas(self, table: str = 'parameters') -> 'pd.DataFrame':
        """Return one of the results as a table; needs pandas.

        Parameters
        ----------
        table : str
            ``parameters`` (one row each: value, lower, upper, unit, determined), ``curve`` (by
            intensity), ``response`` (by time after the pulse [s]) or ``force`` (by time after the
            first sample [s]: force, prediction and whether the sample was used).

        Raises
        ------
        ReportError
            If there is no such table, the data do not tell it, or pandas is not installed.
        """
        return as_frame(self, table)

    def to_xarray(self) -> 'xr.Dataset':
        """Return all results as one data set with units; needs xarray.

        Returns
        -------
        xarray.Dataset
            ``curve`` over ``intensity``, ``response`` over ``response_time``, ``parameter_value``
            over ``parameter``, each with ``..._lower`` and ``..._upper``; ``force``,
            ``prediction`` and ``usable`` over ``time``.

        Raises
        ------
        ReportError
            If xarray is not installed.
        """
        return as_dataset(self)

    def __repr__(self) -> str:
        return f'Identification({self.session.name!r}, {self.estimator!r}, {self.verdict.line!r})'

    def __str__(self) -> str:
        rows = [': '.join(filter(None, row)) for row in self._rows()]
        return '\n  '.join([f'{self.session.name}: {self.estimator}', self.verdict.line, *rows])

    def _repr_html_(self) -> str:
        about = ('session', f'{self.session.name}: {self.estimator}')
        return as_html(f'verdict {self.verdict.line}', [about, *self._rows()])

    def _rows(self) -> list[tuple[str, str]]:
        """Return what was found, notes and faults."""
        # What must not be used is not there to be copied.
        found = self._found() if self.verdict.grade != 'no' else []
        faults = [(name, str(count)) for name, count in self.faults.items()]
        return [*found, *(('', note) for note in self.result.notes), *faults]

    def _found(self) -> list[tuple[str, str]]:
        """Return each parameter, and the force at half and full intensity."""
        unit, rows = self.result.unit, []
        for name, one in self.parameters.items():
            known = {'value': one.value, 'lower': one.lower, 'upper': one.upper}
            text = with_interval(known, unit='' if one.unit == '1' else f' {one.unit}')
            rows.append((name, text + (f', {one.determined}' if one.determined else '')))
        if self.curve is not None:
            for share in (0.5, 1.0):
                text = with_interval(asdict(self.force_at(share)), unit=f' {unit}')
                rows.append((f'{QUANTITIES[unit]} at intensity {share:g}', text))
        return rows

    @property
    def faults(self) -> dict[str, int]:
        """What was wrong with the data, and how often."""
        return dict(self.result.faults)


def _unit(name: str, force: str) -> str:
    """Return the unit in which a number of the response is given; its name ends with it."""
    return {'s': 's', 'n': force}.get(name.rpartition('_')[2], '1')


TABLES = ('parameters', 'curve', 'response', 'force')


def as_frame(result: 'Identification', table: str) -> 'pd.DataFrame':
    """Return a table of `TABLES`; see `Identification.to_pandas`.

    Raises
    ------
    ReportError
        If there is no such table, the data do not tell it, or pandas is not installed.
    """
    if table not in TABLES:
        raise ReportError(f'expected a table of {", ".join(TABLES)}, got {table!r}')
    pandas = _installed('pandas')
    columns: dict[str, Any]
    if table == 'parameters':
        found = result.parameters
        columns = {
            name: [getattr(one, name) for one in found.values()]
            for name in ('value', 'lower', 'upper', 'unit', 'determined')
        }
        index = pandas.Index(list(found), name='parameter')
    elif table == 'curve':
        if result.curve is None:
            raise ReportError(result.result.without_curve)
        columns = _banded(result.curve.force, result.curve.lower, result.curve.upper)
        index = pandas.Index(result.curve.intensity, name='intensity')
    elif table == 'response':
        response = result.response
        columns = _banded(response.force, response.lower, response.upper)
        index = pandas.Index(response.time_s, name='time_s')
    else:
        columns = _trace(result)
        index = pandas.Index(_time(result), name='time_s')
    frame: pd.DataFrame = pandas.DataFrame(columns, index=index)
    return frame


def as_dataset(result: 'Identification') -> 'xr.Dataset':
    """Return all results as a data set; see `Identification.to_xarray`.

    Raises
    ------
    ReportError
        If xarray is not installed.
    """
    xarray = _installed('xarray')
    found, response = result.parameters, result.response
    variables: dict[str, Any] = {}
    newton = {'units': result.result.unit}
    for name, values in _banded(
        response.force, response.lower, response.upper, 'response'
    ).items():
        variables[name] = ('response_time', values, newton)
    if (curve := result.curve) is not None:
        for name, values in _banded(curve.force, curve.lower, curve.upper, 'curve').items():
            variables[name] = ('intensity', values, newton)
    for name in ('value', 'lower', 'upper'):
        values = np.array([getattr(one, name) for one in found.values()], dtype=np.float64)
        variables[f'parameter_{name}'] = ('parameter', values)
    variables['parameter_unit'] = ('parameter', [one.unit for one in found.values()])
    variables['parameter_determined'] = ('parameter', [one.determined for one in found.values()])
    for name, values in _trace(result).items():
        variables[name] = ('time', values, {} if name == 'usable' else newton)
    coordinates: dict[str, Any] = {
        'response_time': ('response_time', response.time_s, {'units': 's'}),
        'parameter': list(found),
        'time': ('time', _time(result), {'units': 's'}),
    }
    if curve is not None:
        coordinates['intensity'] = ('intensity', curve.intensity, {'units': '1'})
    one = result.result
    attributes = {
        'session': result.session.name,
        'session_hash': one.session_hash,
        'estimator': one.estimator,
        'rate_hz': one.rate_hz,
        'confidence': one.confidence or np.nan,
        'output_error_n': one.output_error_n,
    }
    dataset: xr.Dataset = xarray.Dataset(variables, coordinates, attributes)
    return dataset


def _banded(
    force: FloatArray, lower: FloatArray | None, upper: FloatArray | None, name: str = ''
) -> dict[str, FloatArray]:
    """Return a force with its interval as columns; NaN where there is no interval."""
    nothing = np.full(len(force), np.nan)
    prefix = f'{name}_' if name else ''
    return {
        name or 'force': force,
        f'{prefix}lower': nothing if lower is None else lower,
        f'{prefix}upper': nothing if upper is None else upper,
    }


def _time(result: 'Identification') -> FloatArray:
    """Return the time of each processed sample after the first (samples,) [s]."""
    stamps = result.estimates.stamp_ns
    time: FloatArray = (stamps - stamps[0]) / NANOSECONDS_PER_SECOND
    return time


def _trace(result: 'Identification') -> dict[str, Any]:
    kept = result.estimates
    return {'force': kept.force, 'prediction': kept.prediction, 'usable': kept.usable}


def _installed(name: str) -> Any:
    """Return a module that the package does not depend on."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise ReportError(
            f'expected {name} to be installed, got none; pip install "rpms_ros[notebooks]"'
        ) from error
