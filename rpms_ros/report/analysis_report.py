# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The analysis of a muscle as one JSON object and as text.

In JSON: SI units, rates in Hz; missing numbers are null.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

from rpms_ros.axis import QUANTITIES
from rpms_ros.identification.analysis import (
    FieldAnalysis,
    MuscleAnalysis,
    SummationAnalysis,
    TwitchAnalysis,
)
from rpms_ros.identification.analysis.dynamics import TrainDynamics, train_dynamics
from rpms_ros.identification.analysis.responses import counted_reasons
from rpms_ros.identification.analysis.twitches import LatencyTable
from rpms_ros.printable import counted
from rpms_ros.report.result import train_rows
from rpms_ros.report.text import labelled, with_interval
from rpms_ros.schema import plain


def analysis_document(analysis: MuscleAnalysis) -> dict[str, Any]:
    """Return all results without the traces, and the dynamics that `rpms identify` states."""
    return {**plain(analysis), 'dynamics': plain(train_dynamics(analysis))}


Row = tuple[str, str]


def analysis_text(analyses: Sequence[MuscleAnalysis], names: Sequence[str]) -> str:
    """Return all results, of one recording after the other."""
    return '\n\n'.join(
        f'{name}\n{labelled(_rows(one))}' for name, one in zip(names, analyses, strict=True)
    )


def _rows(analysis: MuscleAnalysis) -> Iterator[Row]:
    contents = ', '.join(
        counted(count, kind, kind.removesuffix('s') + 's')
        for kind, count in analysis.contents.items()
    )
    unit = analysis.unit
    rate = f'{analysis.samples} samples at {analysis.sample_rate_hz:.0f} Hz'
    yield 'recording', contents or 'no pulses'
    yield QUANTITIES[unit], f'{rate}, noise {analysis.noise:.3g} {unit}'
    if (clocks := analysis.artifacts) is not None:
        seen = f'{clocks.median_offset * 1e3:.2f} +- {clocks.spread * 1e3:.2f} ms after the stamp'
        yield 'artifacts', f'{clocks.count}, {seen}' if clocks.found else 'none'
        if clocks.clock_offset:
            yield 'clock offset', f'{clocks.clock_offset * 1e3:.2f} ms, taken out'
    if analysis.twitches:
        yield from _twitch_rows(analysis.twitches)
    if analysis.summation:
        yield from _train_rows(analysis.summation, train_dynamics(analysis), unit)
    if analysis.recruitment:
        yield from _field_rows(analysis.recruitment, unit)


def _twitch_rows(found: TwitchAnalysis) -> Iterator[Row]:
    choice, shared = found.choice, found.shared
    rejected = counted_reasons(found.rejected) or 'none'
    yield 'twitches', f'{len(found.fits)}, rejected: {rejected}'
    yield 'order', f'{choice.order} (held-out error: {choice.held_out_order})'
    for one in choice.evidence:
        error = f'held-out error {one.held_out:.2%}, E_min {one.least_error:.3g}'
        constant = _spread(one.time_constant, one.time_constant_spread)
        text = f'information +{one.information:.0f}, {error}, T_a {constant}'
        yield f'  order {one.order}', text
    every = _spread(shared.time_constant, shared.time_constant_deviation, 3)
    yield 'T_a', _spread(found.time_constant, found.time_constant_spread)
    yield 'T_a, all twitches at once', every
    yield from _latency_rows('delay of the model', found.latency)
    yield from _latency_rows('onset, paper', found.crossing_latency)


def _latency_rows(label: str, found: LatencyTable) -> Iterator[Row]:
    how = f'{found.method}, from {found.reference}'
    yield label, f'{_spread(found.mean, found.spread)} of {found.count} ({how})'
    for row in found.rows if len(found.rows) > 1 else ():
        text = f'{_spread(row.mean, row.spread)} of {row.count}'
        at = 'unknown intensity' if math.isnan(row.intensity) else f'{row.intensity:.0%}'
        yield f'  {label} at {at}', text


def _train_rows(
    found: SummationAnalysis, stated: TrainDynamics | None, unit: str
) -> Iterator[Row]:
    yield 'trains rejected', counted_reasons(found.rejected) or 'none'
    yield from train_rows(stated, unit) if stated else ()
    if any(train.held_out for train in found.trains):
        law, equal = (found.mean_fit(model, held_out=True) for model in ('law', 'equal'))
        text = f'{law:.1f} % on trains it has not seen (equal pulses {equal:.1f} %)'
        yield 'fit, history law', text


def _field_rows(found: FieldAnalysis, unit: str) -> Iterator[Row]:
    known = f'known to {found.worst_interval:.2%} of its maximum'
    fit, top = f'fitted to {found.residual:.2%}', vars(found.maximum_force)
    yield 'recruitment', f'{len(found.points)} levels, {known}, {fit}'
    yield f'{QUANTITIES[unit]} at 100 %, 20 Hz', with_interval(top, 1.0, f' {unit}')
    units = dict.fromkeys(('threshold', 'saturation'), (100.0, ' %'))
    units['rate_saturation'] = 1.0, ' Hz'
    for name, one in found.parameters.items():
        # offsets are no numbers of the paper
        if not name.endswith('_offset') and (found.rates_fitted or not name.startswith('rate_')):
            yield f'  {name}', with_interval(vars(one), *units.get(name, (1.0, '')))


def _spread(mean: float, spread: float, digits: int = 2) -> str:
    """Return a time [s] with its spread, which a single one does not have."""
    interval = '' if math.isnan(spread) else f' +- {1e3 * spread:.{digits}f}'
    return f'{1e3 * mean:.{digits}f}{interval} ms'
