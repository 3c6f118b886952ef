"""The analysis of one or several recordings as a table for people, side by side."""

import math
from collections.abc import Callable
from collections.abc import Sequence

from rpms_ros.identification.analysis import FieldAnalysis
from rpms_ros.identification.analysis import MuscleAnalysis
from rpms_ros.identification.analysis import SummationAnalysis
from rpms_ros.identification.analysis import TwitchAnalysis
from rpms_ros.identification.analysis.field_fit import Interval
from rpms_ros.identification.analysis.latency import LatencyTable

Row = tuple[str, str]
NOTHING = '-'


def analysis_text(analyses: Sequence[MuscleAnalysis], names: Sequence[str]) -> str:
    """Return one column a recording (at least one)."""
    columns = [dict(_rows(analysis)) for analysis in analyses]
    labels = list(dict.fromkeys(label for column in columns for label in column))
    table = [['', *names]]
    table += [[label, *(column.get(label, NOTHING) for column in columns)] for label in labels]
    widths = [max(len(row[place]) for row in table) for place in range(len(table[0]))]
    lines = (
        '  '.join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        for row in table
    )
    return '\n'.join(line.rstrip() for line in lines)


def _rows(analysis: MuscleAnalysis) -> list[Row]:
    contents = ', '.join(
        f'{count} {_plural(kind, count)}' for kind, count in analysis.contents.items()
    )
    rows = [
        ('recording', contents or 'no pulses'),
        (
            'force',
            (
                f'{analysis.samples} samples at {analysis.sample_rate_hz:.0f} Hz, '
                f'noise {analysis.noise:.3g} N'
            ),
        ),
    ]
    if (clocks := analysis.artifacts) is not None:
        seen = f'{clocks.median_offset * 1e3:.2f} +- {clocks.spread * 1e3:.2f} ms after the stamp'
        rows.append(('artifacts', f'{clocks.count}, {seen}' if clocks.found else 'none'))
        if clocks.clock_offset:
            rows.append(('clock offset', f'{clocks.clock_offset * 1e3:.2f} ms, taken out'))
    if analysis.twitches:
        rows += _twitch_rows(analysis.twitches)
    if analysis.summation:
        rows += _train_rows(analysis.summation)
    if analysis.recruitment:
        rows += _field_rows(analysis.recruitment)
    return rows


def _twitch_rows(found: TwitchAnalysis) -> list[Row]:
    rejected = ', '.join(f'{count} x {reason}' for reason, count in found.rejected.items())
    choice = found.choice
    rows = [
        ('twitches', f'{len(found.fits)}, rejected: {rejected or "none"}'),
        (
            'order',
            (
                f'{choice.order} (held-out error: {choice.held_out_order}; '
                f'as a real number {choice.free_order:.2f} +- {choice.free_order_spread:.2f})'
            ),
        ),
    ]
    rows += [
        (
            f'  order {one.order}',
            (
                f'information +{one.information:.0f}, held-out error '
                f'{one.held_out:.2%}, E_min {one.least_error:.3g}, T_a '
                f'{_spread(one.time_constant, one.time_constant_spread)}'
            ),
        )
        for one in choice.evidence
    ]
    rows.append(('T_a', _spread(found.time_constant, found.time_constant_spread)))
    shared = found.shared
    rows.append(
        (
            'T_a, all twitches at once',
            _spread(shared.time_constant, shared.time_constant_deviation, 3),
        )
    )
    for label, table in (('latency', found.latency), ('latency, paper', found.crossing_latency)):
        rows += _latency_rows(label, table)
    return rows


def _latency_rows(label: str, table: LatencyTable) -> list[Row]:
    how = f'{table.method}, from {table.reference}'
    rows = [(label, f'{_spread(table.mean, table.spread)} of {table.count} ({how})')]
    if len(table.rows) > 1:
        rows += [
            (
                f'  {label} at {row.intensity:.0%}',
                f'{_spread(row.mean, row.spread)} of {row.count}',
            )
            for row in table.rows
        ]
    return rows


def _train_rows(found: SummationAnalysis) -> list[Row]:
    rejected = ', '.join(f'{count} x {reason}' for reason, count in found.rejected.items())
    rows = [
        ('trains', f'{len(found.trains)}, rejected: {rejected or "none"}'),
        ('T_a in trains', _spread(found.time_constant, found.time_constant_spread)),
        ('latency in trains', _spread(found.latency, found.latency_spread)),
        ('fit, equal pulses', f'{found.mean_fit("equal"):.1f} %'),
        ('fit, a gain a pulse', f'{found.mean_fit("gains"):.1f} %'),
    ]
    if found.law is not None:
        rows.append(('fit, history law', f'{found.mean_fit("law"):.1f} %'))
        if any(train.held_out for train in found.trains):
            rows.append(
                (
                    '  on trains it has not seen',
                    (
                        f'{found.mean_fit("law", held_out=True):.1f} % (equal pulses '
                        f'{found.mean_fit("equal", held_out=True):.1f} %)'
                    ),
                )
            )
    return rows


def _field_rows(found: FieldAnalysis) -> list[Row]:
    rows = [
        (
            'recruitment',
            (
                f'{len(found.points)} levels, known to {found.worst_interval:.2%} '
                f'of its maximum, {found.shape_difference:.2%} from a monotone fit'
            ),
        ),
        ('force at 100 %, 20 Hz', _interval(found.maximum_force, lambda x: f'{x:.4g} N')),
    ]
    shown: dict[str, Callable[[float], str]] = {
        'threshold': lambda x: f'{x:.1%}',
        'saturation': lambda x: f'{x:.1%}',
        'threshold_slope': lambda x: f'{x:.3g}',
        'saturation_slope': lambda x: f'{x:.3g}',
    }
    if found.rates_fitted:
        shown['rate_saturation'] = lambda x: f'{x:.3g} Hz'
        shown['rate_slope'] = lambda x: f'{x:.3g}'
    values = dict(found.parameters)
    rows += [(f'  {name}', _interval(values[name], show)) for name, show in shown.items()]
    return rows


def _interval(interval: Interval, show: Callable[[float], str]) -> str:
    return f'{show(interval.value)} ({show(interval.low)} to {show(interval.high)})'


def _spread(mean: float, spread: float, digits: int = 2) -> str:
    if math.isnan(spread):
        return f'{mean * 1e3:.{digits}f} ms'
    return f'{mean * 1e3:.{digits}f} +- {spread * 1e3:.{digits}f} ms'


def _plural(kind: str, count: int) -> str:
    return kind if count == 1 or kind.endswith('s') else f'{kind}s'
