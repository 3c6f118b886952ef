# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Results as tables of pandas and data sets of xarray, where these are installed."""

from importlib import import_module
from typing import TYPE_CHECKING
from typing import Any

import numpy as np

from rpms_ros.errors import ReportError
from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.pulses import FloatArray

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from rpms_ros.api.identification import Identification

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
