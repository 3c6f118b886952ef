# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The analysis of a muscle as one JSON object and as text.

In JSON: SI units, rates in Hz; missing numbers are null.
"""

import math
from collections.abc import Sequence
from typing import Any

from rpms_ros.axis import QUANTITIES
from rpms_ros.identification.analysis import (
    FieldAnalysis,
    MuscleAnalysis,
    SummationAnalysis,
    TwitchAnalysis,
)
from rpms_ros.identification.analysis.dynamics import HISTORY_LAW, TrainDynamics, train_dynamics
from rpms_ros.identification.analysis.recruitment_field import Interval
from rpms_ros.identification.analysis.responses import counted_reasons
from rpms_ros.identification.analysis.trains import TrainAnalysis
from rpms_ros.identification.analysis.twitches import LatencyTable
from rpms_ros.printable import counted
from rpms_ros.report.text import labelled, with_interval
from rpms_ros.schema import plain

Document = dict[str, Any]
_SPREADS = 'latency latency_spread time_constant time_constant_spread'
_MODELS = ('equal', 'gains', 'law')


def analysis_document(analysis: MuscleAnalysis) -> Document:
    """Return all results without the traces."""
    clocks = analysis.artifacts
    document: Document = plain(
        {
            **_fields(analysis, 'contents pulses samples sample_rate_hz noise unit'),
            'clocks': clocks
            and {
                **_fields(clocks, 'spread clock_offset'),
                'artifacts_found': clocks.found,
                'artifacts': clocks.count,
                'artifact_after_stamp': clocks.median_offset,
            },
            'twitches': analysis.twitches and _twitches(analysis.twitches),
            'dynamics': train_dynamics(analysis),
            'summation': analysis.summation and _summation(analysis.summation),
            'steady': analysis.steady,
            'recruitment': analysis.recruitment and _field(analysis.recruitment),
            'findings': analysis.findings,
        }
    )
    return document


def _fields(value: object, names: str) -> Document:
    return {name: getattr(value, name) for name in names.split()}


def _twitches(found: TwitchAnalysis) -> Document:
    names = 'rejected shared time_constant time_constant_spread latency crossing_latency'
    return {'count': len(found.fits), 'order': found.choice, **_fields(found, names)}


def _summation(found: SummationAnalysis) -> Document:
    return {
        'count': len(found.trains),
        **_fields(found, f'order rejected {_SPREADS} onsets law'),
        'mean_fit': {model: found.mean_fit(model) for model in _MODELS},
        'mean_fit_held_out': {model: found.mean_fit(model, held_out=True) for model in _MODELS},
        'trains': [_train(train) for train in found.trains],
    }


def _train(train: TrainAnalysis) -> Document:
    return {
        'rate_hz': train.rate_hz,
        'pulses': len(train.response.onset),
        'intensity': train.response.intensity,
        'held_out': train.held_out,
        'fit': {model: getattr(getattr(train, model), 'fit', None) for model in _MODELS},
        **_fields(train.equal, 'latency time_constant'),
        'gain': train.equal.gains[0],
        'gains': train.gains.gains,
    }


def _field(found: FieldAnalysis) -> Document:
    names = 'maximum_force rates_fitted residual worst_interval shape_difference'
    return {
        **_fields(found, f'{names} monotone_intensity monotone_share parameters'),
        'by_intensity': found.recruitment.by_intensity,
        'by_rate': found.recruitment.by_rate,
        'levels': len(found.points),
    }


Row = tuple[str, str]


def analysis_text(analyses: Sequence[MuscleAnalysis], names: Sequence[str]) -> str:
    """Return all results, of one recording after the other."""
    return '\n\n'.join(
        f'{name}\n{labelled(_rows(one))}' for name, one in zip(names, analyses, strict=True)
    )


def _rows(analysis: MuscleAnalysis) -> list[Row]:
    contents = ', '.join(
        counted(count, kind, kind.removesuffix('s') + 's')
        for kind, count in analysis.contents.items()
    )
    unit = analysis.unit
    rate = f'{analysis.samples} samples at {analysis.sample_rate_hz:.0f} Hz'
    rows = [
        ('recording', contents or 'no pulses'),
        (QUANTITIES[unit], f'{rate}, noise {analysis.noise:.3g} {unit}'),
    ]
    if (clocks := analysis.artifacts) is not None:
        seen = f'{clocks.median_offset * 1e3:.2f} +- {clocks.spread * 1e3:.2f} ms after the stamp'
        rows.append(('artifacts', f'{clocks.count}, {seen}' if clocks.found else 'none'))
        if clocks.clock_offset:
            rows.append(('clock offset', f'{clocks.clock_offset * 1e3:.2f} ms, taken out'))
    if analysis.twitches:
        rows += _twitch_rows(analysis.twitches)
    if analysis.summation:
        rows += _train_rows(analysis.summation, train_dynamics(analysis))
    if analysis.recruitment:
        rows += _field_rows(analysis.recruitment, unit)
    return rows


def _with_rejected(found: TwitchAnalysis | SummationAnalysis, count: int) -> str:
    return f'{count}, rejected: {counted_reasons(found.rejected) or "none"}'


def _twitch_rows(found: TwitchAnalysis) -> list[Row]:
    choice, shared = found.choice, found.shared
    free = f'as a real number {_plus_minus(choice.free_order, choice.free_order_spread)}'
    rows = [
        ('twitches', _with_rejected(found, len(found.fits))),
        ('order', f'{choice.order} (held-out error: {choice.held_out_order}; {free})'),
    ]
    for one in choice.evidence:
        error = f'held-out error {one.held_out:.2%}, E_min {one.least_error:.3g}'
        constant = _spread(one.time_constant, one.time_constant_spread)
        text = f'information +{one.information:.0f}, {error}, T_a {constant}'
        rows.append((f'  order {one.order}', text))
    every = _spread(shared.time_constant, shared.time_constant_deviation, 3)
    rows.append(('T_a', _spread(found.time_constant, found.time_constant_spread)))
    rows.append(('T_a, all twitches at once', every))
    rows += _latency_rows('delay of the model', found.latency)
    return rows + _latency_rows('onset, paper', found.crossing_latency)


def _latency_rows(label: str, found: LatencyTable) -> list[Row]:
    how = f'{found.method}, from {found.reference}'
    rows = [(label, f'{_spread(found.mean, found.spread)} of {found.count} ({how})')]
    for row in found.rows if len(found.rows) > 1 else ():
        text = f'{_spread(row.mean, row.spread)} of {row.count}'
        rows.append((f'  {label} at {row.intensity:.0%}', text))
    return rows


def _train_rows(found: SummationAnalysis, stated: TrainDynamics | None) -> list[Row]:
    rows = [
        ('trains', _with_rejected(found, len(found.trains))),
        ('onset of force in trains', _onset(found)),
        *_stated_rows(stated),
        # Those of the history law are others: each belongs to its model.
        ('T_a, equal pulses', _spread(found.time_constant, found.time_constant_spread)),
        ('delay of the model, equal pulses', _spread(found.latency, found.latency_spread)),
        ('fit, equal pulses', f'{found.mean_fit("equal"):.1f} %'),
        ('fit, a gain a pulse', f'{found.mean_fit("gains"):.1f} %'),
    ]
    if found.law is not None:
        rows.append(('fit, history law', f'{found.mean_fit("law"):.1f} %'))
        if any(train.held_out for train in found.trains):
            law, equal = (found.mean_fit(model, held_out=True) for model in ('law', 'equal'))
            text = f'{law:.1f} % (equal pulses {equal:.1f} %)'
            rows.append(('  on trains it has not seen', text))
    return rows


def _stated_rows(stated: TrainDynamics | None) -> list[Row]:
    """Return the rows of the model that `rpms identify` states, if that is not equal pulses."""
    if stated is None or stated.model != HISTORY_LAW:
        return []
    named = {'T_a': stated.twitch_time_constant_s, 'delay of the model': stated.latency_s}
    return [
        (f'{name}, {stated.model}', with_interval(vars(one), 1e3, ' ms'))
        for name, one in named.items()
    ]


def _onset(found: SummationAnalysis) -> str:
    """Return when the force leaves its baseline, from the earliest to the latest train."""
    if not (values := found.onsets):
        return 'hidden by noise'
    low, high = (f'{1e3 * value:.2f}' for value in (min(values), max(values)))
    return f'{low} ms' if low == high else f'{low} to {high} ms'


def _field_rows(found: FieldAnalysis, unit: str) -> list[Row]:
    known = f'known to {found.worst_interval:.2%} of its maximum'
    shape = f'{found.shape_difference:.2%} from a monotone fit'
    rows = [
        ('recruitment', f'{len(found.points)} levels, {known}, {shape}'),
        (f'{QUANTITIES[unit]} at 100 %, 20 Hz', _interval(found.maximum_force, '{:.4g} ' + unit)),
    ]
    shown = dict.fromkeys(('threshold', 'saturation'), '{:.1%}')
    shown |= dict.fromkeys(('threshold_slope', 'saturation_slope'), '{:.3g}')
    if found.rates_fitted:
        shown |= {'rate_saturation': '{:.3g} Hz', 'rate_slope': '{:.3g}'}
    values = found.parameters
    return rows + [(f'  {name}', _interval(values[name], text)) for name, text in shown.items()]


def _interval(interval: Interval, text: str) -> str:
    value, low, high = map(text.format, (interval.value, interval.low, interval.high))
    return f'{value} ({low} to {high})'


def _spread(mean: float, spread: float, digits: int = 2) -> str:
    return f'{_plus_minus(mean * 1e3, spread * 1e3, digits)} ms'


def _plus_minus(mean: float, spread: float, digits: int = 2) -> str:
    """Return a number with its spread, which a single one does not have."""
    interval = '' if math.isnan(spread) else f' +- {spread:.{digits}f}'
    return f'{mean:.{digits}f}{interval}'
